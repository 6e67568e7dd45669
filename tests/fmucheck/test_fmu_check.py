"""``ps-fmu check``: clean on our FMUs, and a fault of another maker's FMU is found, named and survived."""

import os
import shutil
import sys
import zipfile
from pathlib import Path

import pytest
from pythonfmu.builder import FmuBuilder

from ps_fmu.cli import main, parser
from ps_fmu.fmucheck import fmu_check
from ps_fmu.fmucheck.fmu_check import check_fmu
from ps_fmu.fmucheck.verdicts import FAILED, LONGEST, NOT_RUN, OK, SHOWN, WARNING, CheckResult, write_table

TOYS = Path(__file__).parent / "toys"
LIFE = ["load", "initialise", "steps", "get and set state", "serialise state", "reset", "second instance"]


@pytest.fixture(scope="module")
def toys(tmp_path_factory) -> dict[str, Path]:
    """FMUs as plain pythonfmu makes them."""
    folder = tmp_path_factory.mktemp("toys")
    options = {"forgetful": {"canGetAndSetFMUstate": True}}
    return {
        source.stem: Path(FmuBuilder.build_FMU(source, dest=folder, **options.get(source.stem, {})))
        for source in sorted(TOYS.glob("*.py"))
    }


@pytest.fixture
def rows(monkeypatch):
    """``rows(path)``: the rows by check, as if fmutool, which takes a second, were not installed."""
    monkeypatch.setattr(fmu_check, "FMUTOOL", "no_such_module")
    return lambda path: {row.check: row for row in check_fmu(path)}


def rewritten(source: Path, target: Path, change) -> Path:
    """A copy of an archive; ``change(name, content)`` gives new content, or None to leave the member out."""
    with zipfile.ZipFile(source) as old, zipfile.ZipFile(target, "w") as new:
        for name in old.namelist():
            if (content := change(name, old.read(name))) is not None:
                new.writestr(name, content)
    return target


def test_our_fmus_pass_everything(built_fmus, capsys, rows, monkeypatch):
    monkeypatch.setenv("PATH", str(Path(sys.executable).parent), prepend=os.pathsep)  # of a host with Python and numpy
    fmus = sorted(built_fmus.glob("*.fmu"))
    code = main(["check", *map(str, fmus)])
    text = capsys.readouterr().out
    assert code == 0, text
    counts = [line for line in text.splitlines() if " ok, " in line]
    assert len(fmus) == len(counts) >= 4
    assert {line.partition(" ok, ")[2] for line in counts} == {"1 not run"}  # fmutool: tests/fmus
    for check in (f"{host}: {stage}" for stage in LIFE for host in ("FMPy", "C host")):
        assert text.count(f"  {check} ") == len(fmus)
    assert text.count("  FMPy: derivatives ") == 5  # plant, isolator, pointing, coils, accelerometers


def test_a_plain_pythonfmu_fmu_runs_but_is_not_described_well(toys, rows):
    found = rows(toys["plain"])
    for check in ("model description", "FMPy validate"):
        assert found[check].verdict == FAILED
        assert any("InitialUnknowns" in detail for detail in found[check].details)
    assert found["fmutool -check"].verdict == NOT_RUN
    assert found["fmutool -check"].details == ("fmu-manipulation-toolbox is not installed",)
    # pythonfmu's library releases a pointer twice at exit, which now and then ends the process with SIGABRT.
    stages = {check: row.verdict for check, row in found.items() if check.startswith("FMPy: ")}
    stages.pop("FMPy: end of the process")
    assert set(stages.values()) == {OK}
    assert "FMPy: get and set state" not in found


def test_a_plain_pythonfmu_fmu_does_not_load_where_there_is_no_python(toys, rows):
    found = rows(toys["plain"])["C host: load"]
    assert found.verdict == FAILED
    assert "undefined symbol: _Py" in found.details[0]


def test_a_state_that_is_not_all_of_it_is_noticed(toys, rows):
    found = rows(toys["forgetful"])["FMPy: get and set state"]
    assert found.verdict == FAILED
    assert "30.0 instead of 20.0" in found.details[0]


def test_a_crash_ends_with_its_stage_and_signal(toys, rows):
    found = rows(toys["crashing"])
    assert found["FMPy: steps"].verdict == FAILED
    assert found["FMPy: steps"].details[0] == "the process was killed by SIGKILL"
    assert "FMPy: reset" not in found


def test_fmutool_is_asked(toys, tmp_path):
    assert fmu_check._run_fmutool(toys["plain"], "2.0").verdict == OK
    broken = rewritten(
        toys["plain"], tmp_path / "broken.fmu", lambda name, content: content.replace(b'causality="input"', b"")
        .replace(b'<Unknown index="2"', b'<Unknown index="1"') if name.endswith(".xml") else content
    )  # fmt: skip
    assert fmu_check._run_fmutool(broken, "2.0").verdict == FAILED
    assert fmu_check._run_fmutool(broken, "1.0").verdict == NOT_RUN


@pytest.mark.parametrize("module", ["fmu_manipulation_toolbox/cli/fmutool.py", "fmpy/validation.py", "pathlib.py"])
def test_modules_in_the_current_directory_are_not_run(module, toys, tmp_path, monkeypatch):
    planted = tmp_path / module
    planted.parent.mkdir(parents=True, exist_ok=True)
    planted.write_text(f"open({str(tmp_path / 'run')!r}, 'w').close()\n")
    for folder in planted.relative_to(tmp_path).parents:
        (tmp_path / folder / "__init__.py").touch()
    monkeypatch.chdir(tmp_path)
    found = {row.check: row for row in check_fmu(toys["plain"], run=False)}
    assert not (tmp_path / "run").exists()
    assert found["fmutool -check"].verdict == OK
    assert any("InitialUnknowns" in detail for detail in found["FMPy validate"].details)


def test_a_checker_without_end_is_a_row(toys, monkeypatch):
    monkeypatch.setattr(fmu_check, "TIME_LIMIT", 1e-3)
    found = fmu_check._run_fmpy(toys["plain"])
    assert found == CheckResult("FMPy validate", FAILED, ("did not end within 0.001 s",))


def test_the_help_says_that_code_runs(capsys):
    with pytest.raises(SystemExit):
        parser().parse_args(["check", "--help"])
    assert "runs its code" in " ".join(capsys.readouterr().out.split())


LONG = {
    "a variable of 100 kB": (b'"y"', b'"' + b"y" * 100_000 + b'"'),
    "a unit of 100 kB": (b"<ModelV", b'<UnitDefinitions><Unit name="%b"/></UnitDefinitions><ModelV' % (b"/" * 100_000)),
}


@pytest.mark.parametrize("case", LONG)
def test_long_names_in_the_description_end_in_a_row(case, toys, tmp_path, rows, capsys, monkeypatch):
    monkeypatch.setattr(fmu_check, "TIME_LIMIT", 3.0)  # s; FMPy takes a minute to parse such a name
    change = LONG[case]
    path = rewritten(toys["plain"], tmp_path / "A.fmu", lambda n, c: c.replace(*change) if n.endswith(".xml") else c)
    assert main(["check", str(path)]) == 1
    lines = capsys.readouterr().out.splitlines()
    assert "FAILED" in lines[-1]
    assert ["FMPy:", "steps", "ok"] in map(str.split, lines)
    assert max(map(len, lines)) < 2 * LONGEST


@pytest.mark.parametrize("name", ["resources/" + "x" * 4000, "d/" * 3000 + "x", "d/" * 900 + "x"])
def test_long_names_of_members_end_in_a_row(name, toys, tmp_path, capsys):
    path = shutil.copy(toys["plain"], tmp_path / "long.fmu")
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr(name, "x")
    assert main(["check", str(path)]) == 1
    _, _, problem, count = capsys.readouterr().out.splitlines()
    assert "is too long: at most 1000 bytes, 255 between two slashes, are unpacked" in problem
    assert len(problem) < 2 * LONGEST
    assert count == "  1 FAILED"


def test_archives_that_are_not_safe_are_not_opened(toys, tmp_path, rows):
    """No other check is made; nothing leaves the archive."""
    cut, outside, empty = (tmp_path / f"{name}.fmu" for name in ("cut", "outside", "empty"))
    cut.write_bytes(toys["plain"].read_bytes()[:10_000])
    rewritten(toys["plain"], outside, lambda _, content: content)
    with zipfile.ZipFile(outside, "a") as archive:
        archive.writestr("../outside.txt", "x")
    zipfile.ZipFile(empty, "w").close()
    for path, reason in ((cut, "ZIP"), (outside, "leaves the target folder"), (empty, "has no modelDescription.xml")):
        found = rows(path)
        assert list(found) == ["archive"]
        assert found["archive"].verdict == FAILED
        assert reason in found["archive"].details[0]
    assert main(["check", str(cut)]) == 1


BOMB = "".join(f'<!ENTITY e{n + 1} "{f"&e{n};" * 10}">' for n in range(12))
ATTRIBUTES = "".join(f' a{n}=""' for n in range(1001)).encode()  # fmutool takes minutes for 200,000
DOCTYPE = f'<!DOCTYPE a [<!ENTITY e0 "x">{BOMB}<!ENTITY f SYSTEM "file:///etc/passwd">]>'.encode()


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda n, c: c[:500] if n.endswith("Description.xml") else c, "not well-formed"),
        (lambda n, c: b"\xff" + c if n.endswith("Description.xml") else c, "not well-formed"),
        (lambda n, c: c.replace(b"?>", b"?>" + DOCTYPE, 1) if n.endswith("Description.xml") else c, "DOCTYPE"),
        (lambda n, c: c.replace(b"UTF-8", b"none", 1) if n.endswith("Description.xml") else c, "encoding"),
        (lambda n, c: b"<a>" * 100_000 if n.endswith("Description.xml") else c, "nested deeper than 100"),
        (
            lambda n, c: c.replace(b"<CoSimulation", b"<CoSimulation" + ATTRIBUTES),
            "an element CoSimulation has more than 1000 attributes",
        ),
    ],
)
def test_descriptions_that_are_not_read(change, reason, toys, tmp_path, rows):
    (row,) = rows(rewritten(toys["plain"], tmp_path / "changed.fmu", change)).values()
    assert row.verdict == FAILED
    assert reason in row.details[0]


def test_an_archive_with_damaged_content_is_not_unpacked(toys, tmp_path, rows):
    path = rewritten(toys["plain"], tmp_path / "damaged.fmu", lambda _, content: content)
    raw = bytearray(path.read_bytes())
    raw[raw.index(b"\x7fELF") + 5000] ^= 1
    path.write_bytes(raw)
    (row,) = rows(path).values()
    assert row.verdict == FAILED
    assert "is damaged: its checksum does not fit" in row.details[0]


def test_what_pythonfmu_takes_for_granted(toys, tmp_path, rows):
    path = rewritten(toys["plain"], tmp_path / "A.fmu", lambda n, c: None if n == "resources/plain.py" else c)
    found = rows(path)
    assert found["archive"].verdict == FAILED
    assert "no 'resources/plain.py'" in found["archive"].details[0]
    assert found["FMPy: load"].details[0] == "the process was killed by SIGSEGV"


@pytest.mark.parametrize("identifier", ["../../../tmp/Plain", "Plain&#10;library /tmp/evil", "", "größe"])
def test_a_model_identifier_that_leads_elsewhere_is_not_loaded(identifier, toys, tmp_path, rows, monkeypatch):
    monkeypatch.setattr(fmu_check, "live_in_fmpy", None)
    old, new = b'modelIdentifier="Plain"', f'modelIdentifier="{identifier}"'.encode()
    found = rows(rewritten(toys["plain"], tmp_path / "A.fmu", lambda n, c: c.replace(old, new)))
    for check in ("test run in FMPy", "test run in a C host"):
        assert found[check].verdict == NOT_RUN
        assert "is not a C identifier" in found[check].details[0]


@pytest.mark.parametrize(
    ("change", "check", "reason"),
    [
        (lambda n, c: None if n.startswith("binaries") else c, "archive", "neither a library"),
        (lambda n, c: None if n.startswith("binaries/linux64") else c, "test run in FMPy", "no library for"),
        (lambda n, c: c.replace(b'fmiVersion="2.0"', b'fmiVersion="3.0"'), "test run in FMPy", "FMI 3.0 is not"),
        (lambda n, c: c.replace(b"CoSimulation", b"ModelExchange"), "test run in FMPy", "for model exchange"),
        (lambda n, c: b"" if n.endswith(".so") else c, "FMPy: load", ""),
    ],
)
def test_what_cannot_be_run_says_why(change, check, reason, toys, tmp_path, rows):
    found = rows(rewritten(toys["plain"], tmp_path / "changed.fmu", change))
    assert found[check].verdict == (NOT_RUN if check == "test run in FMPy" else FAILED)
    assert reason in found[check].details[0]
    if check == "test run in FMPy":
        assert found["test run in a C host"] == CheckResult("test run in a C host", NOT_RUN, found[check].details)


def test_the_table_counts_and_shortens():
    written: list[str] = []
    many = tuple(f"problem {k}" for k in range(SHOWN + 3))
    bad = CheckResult("two", FAILED, many)
    rows = [CheckResult("one", OK, ("fine",)), CheckResult("three", NOT_RUN, ("why", "and more of it"))]
    rows.append(CheckResult("four", WARNING, ("this",)))
    assert write_table("A.fmu", rows, written.append) is True
    assert written[0] == "A.fmu"
    assert [line.split() for line in written[1:4]] == [["one", "ok", "fine"], ["three", "not", "run", "why"],
                                                       ["and", "more", "of", "it"]]  # fmt: skip
    assert [line.split() for line in written[4:]] == [
        ["four", "warning"], ["this"], ["1", "ok,", "1", "warning,", "1", "not", "run"],
    ]  # fmt: skip
    assert write_table("A.fmu", [*rows, bad], written.append) is False
    assert written[-1] == "  1 ok, 1 warning, 1 FAILED, 1 not run"
    assert "    and 3 more" in written


def test_the_table_has_no_control_characters_and_no_endless_lines():
    written: list[str] = []
    hostile = "\x1b[2J\x9b2J\u202etxt\ud800" + "x" * 100_000
    write_table("A.fmu", [CheckResult("one", FAILED, (hostile,))], written.append)
    assert written[2].startswith(r"    \x1b[2J\x9b2J\u202etxt\ud800xxx")
    assert "xxx ... xxx" in written[2]
    assert LONGEST < len(written[2]) < 2 * LONGEST
