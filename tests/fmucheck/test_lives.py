"""An FMU in C with one mistake at a time: which stage of its life finds it, and with which words."""

import os
import platform
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path
from time import monotonic

import pytest

from ps_fmu.cli import main
from ps_fmu.fmucheck import fmu_check
from ps_fmu.fmucheck.fmu_check import check_fmu
from ps_fmu.fmucheck.reading import read_description
from ps_fmu.fmucheck.verdicts import NOT_RUN, OK
from ps_fmu.native import find_compiled
from ps_fmu.native.build import FOLDER, PROGRAMS, find_fmi_headers
from ps_fmu.slavekit.pack import stages

SOURCES = Path(__file__).parent / "native"
DESCRIPTION = (SOURCES / "modelDescription.xml").read_text()
STAGES = [
    *("load", "instantiate", "initialise", "steps", "second instance", "get and set state", "serialise state"),
    *("reset", "inputs never set", "terminate and free", "resources at file:/", "unload", "host unchanged"),
    "end of the process",
]


def compiled(folder: Path, *flags: str) -> Path:
    library = folder / "Tank.so"
    command = ["cc", "-std=c99", "-D_GNU_SOURCE", "-O1", "-Wall", "-Wextra", "-Werror"]
    command += ["-fPIC", "-shared", "-I", str(find_fmi_headers()), *flags, str(SOURCES / "tank.c"), "-o", str(library)]
    subprocess.run([*command, "-lm"], check=True)
    return library


@pytest.fixture(scope="module")
def library(tmp_path_factory):
    return compiled(tmp_path_factory.mktemp("tank"))


@pytest.fixture(autouse=True)
def without_fmutool(monkeypatch):
    """It takes a second."""
    monkeypatch.setattr(fmu_check, "FMUTOOL", "no_such_module")


@pytest.fixture
def tank(library, tmp_path):
    """``tank("{fault}")``: the FMU with this mistake; further: the library, and changes of the description."""

    def build(fault: str, library: Path = library, changes: tuple[tuple[str, str], ...] = ()) -> Path:
        text = DESCRIPTION.replace("{right}", fault)
        for old, new in changes:
            assert old in text
            text = text.replace(old, new)
        with zipfile.ZipFile(tmp_path / "Tank.fmu", "w", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr("modelDescription.xml", text)
            archive.write(library, "binaries/linux64/Tank.so")
        return tmp_path / "Tank.fmu"

    return build


def c_host(fmu: Path, **environment: str) -> dict[str, str]:
    """Problem by stage."""
    content = zipfile.ZipFile(fmu).read("modelDescription.xml")
    host, description = fmu_check.find_c_host(), read_description(content, fmu)
    return dict(fmu_check.live_in_c_host(host, fmu, description, **environment))


def test_an_fmu_of_another_maker_passes_everything(tank):
    rows = {row.check: row for row in check_fmu(tank("{right}"))}
    assert {check: row.details for check, row in rows.items() if row.verdict != OK}.keys() == {"fmutool -check"}
    assert [check.removeprefix("C host: ") for check in rows if check.startswith("C host")] == STAGES
    assert "FMPy: end of the process" in rows


def test_a_warning_is_no_failure(tank, capsys):
    """As the reference FMU BouncingBall has it, which all other checkers accept: a dependency on a parameter."""
    g = 'name="g" valueReference="6" causality="parameter" variability="fixed"'
    changes = (
        ("  </ModelVariables>", f'<ScalarVariable {g}><Real start="1"/></ScalarVariable></ModelVariables>'),
        ('<Outputs><Unknown index="1"/>', '<Outputs><Unknown index="1" dependencies="2 6"/>'),
    )
    assert main(["check", "--no-run", str(tank("{right}", changes=changes))]) == 0
    text = capsys.readouterr().out
    assert ["model", "description", "warning"] in map(str.split, text.splitlines())
    assert "warning: line " in text
    assert "unknown 1 (level) depends on g (parameter)" in text
    assert "FAILED" not in text


@pytest.mark.parametrize(
    ("fault", "stage", "words"),
    [
        ("{not finite}", "initialise", "output level is not finite"),
        ("{discard}", "steps", "fmi2DoStep answers fmi2Discard"),
        ("{crash}", "steps", "the process was killed by SIGSEGV"),
        ("{shared}", "second instance", "after initialisation: output steps is 10, before it was 0"),
        ("{state}", "get and set state", "the same steps from the same state: output steps is 30, before it was 20"),
        ("{moved}", "serialise state", "fmi2DeSerializeFMUstate answers fmi2Error"),
        ("{reset}", "reset", "after initialisation: output level is "),
        ("{other start}", "inputs never set", "after the steps: output level is 3.75, before it was 2.5"),
        ("{slashes}", "resources at file:/", "fmi2Instantiate returns no instance (resources at file:/"),
        ("{unload}", "unload", "the process was killed by SIGABRT"),
        ("{handler}", "host unchanged", "the FMU changed the handler of SIGINT, which belongs to the host"),
        ("{rounding}", "host unchanged", "the FMU changed the rounding of floating-point numbers"),
    ],
)
def test_a_mistake_is_found_in_its_stage(fault, stage, words, tank):
    found = c_host(tank(fault))
    assert [name for name, problem in found.items() if problem] == [stage]
    assert found[stage].startswith(words)
    assert list(found) == (STAGES if stage == "host unchanged" else STAGES[: STAGES.index(stage) + 1])


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        ("{right}", ""),
        ("{not provided}", ""),
        ("{derivative}", "the derivative of level by inflow is 0.125; expected "),
        ("{no number}", "the derivative of level by inflow is nan; expected a finite number"),
        ("{refused}", "fmi2GetDirectionalDerivative of level by inflow answers status 3; expected 0 (fmi2OK), or 2"),
    ],
)
def test_directional_derivatives_are_compared_with_differences(fault, words, tank):
    claims = 'providesDirectionalDerivative="true" canHandleVariableCommunicationStepSize="true" canSerializeFMUstate'
    found = dict(stages.live_in_fmpy(tank(fault, changes=(("canSerializeFMUstate", claims),)), "whole"))
    problem = found["derivatives"]
    assert words in problem
    assert bool(problem) == bool(words) == ("end of the process" not in found)


def test_messages_of_the_fmu_are_repeated(tank):
    problem = c_host(tank("{slashes}"))["resources at file:/"]
    assert "third, status 3, logStatusError: 100 % of URIs have three slashes: file:/" in problem


def test_functions_that_are_not_there(tank, tmp_path):
    found = c_host(tank("{right}", compiled(tmp_path, "-DWITHOUT_STATUS")))
    assert found.pop("load").startswith("the library lacks fmi2GetStatus fmi2GetRealStatus fmi2GetIntegerStatus")
    assert list(found) == STAGES[1:]  # the life goes on
    assert not any(found.values())
    missing = c_host(tank("{right}", compiled(tmp_path, "-DWITHOUT_STEP")))
    assert missing == {"load": "the library lacks fmi2DoStep"}


@pytest.mark.parametrize(
    ("change", "missing"),
    [
        (("canSerializeFMUstate", "canRunAsynchronuously"), {"serialise state"}),
        (("canGetAndSetFMUstate", "canRunAsynchronuously"), {"serialise state", "get and set state"}),
        (("canGetAndSetFMUstate", "canBeInstantiatedOnlyOncePerProcess"),
         {"serialise state", "get and set state", "second instance", "resources at file:/"}),
        (('"input"', '"local" initial="exact"'), {"inputs never set"}),
    ],
)  # fmt: skip
def test_what_the_description_does_not_promise_is_not_asked(change, missing, tank):
    found = c_host(tank("{right}", changes=(change,)))
    assert set(STAGES) - set(found) == missing
    assert not any(found.values())


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ('start="2"', 'start="much"'),
        ('valueReference="2"', 'valueReference="-2"'),
        ('valueReference="2"', 'valueReference="4294967298"'),
        ('valueReference="2"', 'valueReference="2&#10;library /elsewhere.so"'),
    ],
)
def test_inputs_that_make_no_sense_are_left_out(old, new, tank):
    found = c_host(tank("{right}", changes=((old, new),)))
    assert list(found) == [stage for stage in STAGES if stage != "inputs never set"]
    assert not any(found.values())


def test_the_host_has_path_and_home_and_nothing_else(tank, monkeypatch):
    asked = []
    monkeypatch.setattr(fmu_check, "watch_stages", lambda *given: asked.append(given[2]) or [("x", "")])
    monkeypatch.setenv("PATH", "/one:/two")
    monkeypatch.setenv("HOME", "/home/someone")
    monkeypatch.setenv("LD_PRELOAD", "")
    c_host(tank("{right}"))
    c_host(tank("{right}"), PS_FMU_PYTHON="/x")
    assert asked[0] == {"PATH": "/one:/two", "HOME": "/home/someone"}
    assert asked[1] == asked[0] | {"PS_FMU_PYTHON": "/x"}


def test_where_no_host_was_compiled_for(tank, monkeypatch):
    monkeypatch.setattr(platform, "machine", lambda: "riscv64")
    rows = {row.check: row for row in check_fmu(tank("{right}"))}
    assert rows["test run in a C host"].verdict == NOT_RUN
    assert rows["test run in a C host"].details == ("the host was not compiled for linux on riscv64",)
    assert rows["FMPy: end of the process"].verdict == OK


def test_a_host_that_cannot_be_started(tank, monkeypatch, tmp_path):
    (tmp_path / "host").write_bytes(b"\x7fELF for another machine")
    monkeypatch.setattr(fmu_check, "find_compiled", lambda name: tmp_path / name)
    row = next(row for row in check_fmu(tank("{right}")) if row.check == "test run in a C host")
    assert row.verdict == NOT_RUN
    assert row.details[0].startswith("the host cannot be started: ")


def test_our_fmus_say_which_python_they_got(built_fmus, monkeypatch):
    """A machine without Python is no fault of the FMU; with one named to it, its life goes well."""
    monkeypatch.setenv("PATH", "/nonexistent")
    monkeypatch.delenv("PS_FMU_PYTHON", raising=False)
    found = {row.check: row for row in check_fmu(built_fmus / "DisturbanceSource.fmu")}
    told = found["C host, nothing set"]
    assert told.verdict == NOT_RUN
    assert told.details[0] == f"once more with PS_FMU_PYTHON={sys.executable}"
    assert any("PATH: no python3 in /nonexistent" in detail for detail in told.details)
    assert found["C host: end of the process"].verdict == OK


def is_running(pid: str) -> bool:
    """Neither gone nor a zombie, whose parent has not looked yet."""
    try:
        return "State:\tZ" not in Path("/proc", pid, "status").read_text()
    except (FileNotFoundError, ProcessLookupError):
        return False


def test_a_process_without_end_is_killed_with_its_children(tmp_path):
    """The child would keep the output open for ever."""
    script = """printf '["fork", ""]\\n["wait", null]\\n' >"$1"; tail -f /dev/null & echo $!; wait"""
    report = tmp_path / "report"
    found = dict(stages.watch_stages(["/bin/sh", "-c", script, "sh", str(report)], report, limit=2.0))
    assert found["fork"] == ""
    problem, pid = found["wait"].splitlines()
    assert problem == "did not end within 2 s"
    deadline = monotonic() + 30.0  # s; a signal takes its time to arrive
    while is_running(pid):
        assert monotonic() < deadline


@pytest.mark.parametrize(("code", "exit_code"), [("print('no FMU today'); exit(1)", 1), ("print('no FMU today')", 0)])
def test_a_process_that_says_nothing(code, exit_code, tmp_path):
    """Also the FMU may end it, with any exit code."""
    found = stages.watch_stages([sys.executable, "-c", code], tmp_path / "report")
    assert found == [("start", f"the process exited with {exit_code}\nno FMU today")]


def test_no_run_loads_no_library(tank, tmp_path, capsys):
    (tmp_path / "poison.h").write_text(
        "#include <fcntl.h>\n#include <unistd.h>\n__attribute__((constructor)) static void poison(void)"
        f'{{ close(open("{tmp_path / "run"}", O_CREAT | O_WRONLY, 0600)); }}\n'
    )
    fmu = tank("{right}", compiled(tmp_path, "-include", str(tmp_path / "poison.h")))
    assert main(["check", "--no-run", str(fmu)]) == 0
    assert capsys.readouterr().out.count("not run  --no-run: the FMU is not loaded") == 2
    assert not (tmp_path / "run").exists()
    stages.live_in_fmpy(fmu, "whole")
    assert (tmp_path / "run").exists()


def test_the_host_under_checks_of_memory_and_undefined_behaviour(tank, tmp_path, monkeypatch):
    """gcc or clang as cc."""
    command = ["cc", "-std=c99", "-D_GNU_SOURCE", "-g", "-fsanitize=address,undefined", "-fno-sanitize-recover=all"]
    command += ["-I", str(find_fmi_headers())]
    command += [str(FOLDER / name) for name in PROGRAMS["host"].list_sources("linux64")]
    subprocess.run([*command, "-o", str(tmp_path / "host"), "-ldl", "-lm"], check=True)
    monkeypatch.setattr(fmu_check, "find_compiled", lambda name: tmp_path / name)
    settings = {"ASAN_OPTIONS": "detect_leaks=0:exitcode=99", "UBSAN_OPTIONS": "exitcode=99"}
    for fault in ("{right}", "{reset}", "{slashes}"):
        found = c_host(tank(fault), **settings)
        assert "Sanitizer" not in "".join(found.values()), found
        assert list(found) == STAGES or any(found.values())


@pytest.mark.parametrize("task", ["", "guid x", "library x\nguid x\nresources x\nstep 0", "output Complex 1 z"])
def test_a_file_that_is_no_task(task, tmp_path):
    (tmp_path / "task").write_text(task)
    program = shutil.copy(find_compiled("host"), tmp_path / "host")
    os.chmod(program, 0o755)
    run = subprocess.run([program, tmp_path / "task", tmp_path / "report"], capture_output=True, text=True)
    assert run.returncode == 2
    assert "is no task" in run.stderr
