"""What is compiled in the package belongs to its source."""

import dataclasses
import hashlib
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path, PurePosixPath

import pytest

import ps_fmu
from ps_fmu.compiled_files import NotCompiledError
from ps_fmu.cosim.errors import CosimError
from ps_fmu.cosim.isolation import guest_process
from ps_fmu.cosim.isolation.guest_process import ISOLATION
from ps_fmu.cosim.native import LOOP
from ps_fmu.fmucheck import lives
from ps_fmu.fmucheck.host.compile import HOST
from ps_fmu.interface.numerics_program import NUMERICS
from ps_fmu.reduction.native import REDUCTION
from ps_fmu.slavekit.launcher import c_program
from ps_fmu.slavekit.launcher.compile import LAUNCHER
from ps_fmu.slavekit.pack import launch
from ps_fmu.slavekit.pack.errors import BuildError
from ps_fmu.slavekit.pack.sources import collect_imported

PROGRAMS = {program.name: program for program in (LAUNCHER, HOST, LOOP, ISOLATION, REDUCTION, NUMERICS)}
# For Windows zig compiles its C library first: a minute on a machine that has not done so before.
LEFT_OUT = () if os.environ.get("PS_FMU_SOAK") else ("win64",)
TARGETS = [(name, p) for name, program in PROGRAMS.items() for p in program.targets if p not in LEFT_OUT]


@pytest.mark.parametrize("name", PROGRAMS)
def test_the_record_describes_sources_and_results(name):
    program = PROGRAMS[name]
    made = {platform: program.path(platform).read_bytes() for platform in program.targets}
    assert program.record.read_text() == program.recorded(made), "sources have changed: make launcher"


@pytest.mark.parametrize(("name", "platform"), TARGETS)
def test_compiling_gives_the_same_bytes(name, platform):
    program = PROGRAMS[name]
    content = program.compiled(platform)
    recorded = json.loads(program.record.read_text())["made"][platform]
    assert hashlib.sha256(content).hexdigest() == recorded, "make launcher"


def test_another_compiler_is_refused(monkeypatch):
    monkeypatch.setattr(c_program, "COMPILER", "0.0.1")
    with pytest.raises(c_program.CompileError, match=r"pip install ziglang==0\.0\.1"):
        LAUNCHER.compiled("linux64")


def test_a_mistake_in_the_source_is_told(tmp_path):
    (tmp_path / "wrong.c").write_text("int main(void) { return nothing; }\n")
    linux = dataclasses.replace(LAUNCHER.targets["linux64"], flags=(), libraries=())
    program = c_program.Program("wrong", tmp_path, ("wrong.c",), (), {"linux64": linux})
    with pytest.raises(c_program.CompileError, match="wrong for linux64: the compiler says:"):
        program.compiled("linux64")


def test_a_platform_that_nothing_was_made_for():
    assert LAUNCHER.path("linux32") is None


def copy_program(program, folder):
    """The library for Linux and its record alone."""
    copied = dataclasses.replace(program, folder=folder)
    copied.path("linux64").parent.mkdir(exist_ok=True)
    copied.path("linux64").write_bytes(program.path("linux64").read_bytes())
    copied.record.write_bytes(program.record.read_bytes())
    return copied


def test_a_library_that_is_not_the_recorded_one_is_not_loaded(tmp_path):
    """Cut short, or that of another program: to load it would end this process by SIGBUS, or a call by SIGSEGV."""
    program = copy_program(REDUCTION, tmp_path)
    path = program.path("linux64")
    assert program.find_whole("linux64") == path
    for content in (path.read_bytes()[:1000], LOOP.path("linux64").read_bytes()):
        path.write_bytes(content)
        with pytest.raises(OSError, match=r"reduction\.so: is damaged, or of another version") as caught:
            program.find_whole("linux64")
        recorded = json.loads(program.record.read_text())["made"]["linux64"]
        for word in (recorded, hashlib.sha256(content).hexdigest(), "install ps_fmu again", "make launcher"):
            assert word in str(caught.value)
    path.unlink()
    with pytest.raises(NotCompiledError, match=r"reduction\.so: No such file or directory: .*'make launcher'"):
        program.find_whole("linux64")


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"made": {}, "targets": {"linux64": {}}}'])
def test_a_record_that_is_none_is_named(tmp_path, text):
    program = copy_program(REDUCTION, tmp_path)
    program.record.write_text(text)
    with pytest.raises(OSError, match=r"reduction\.json: is damaged, or says nothing of linux64"):
        program.find_whole("linux64")


def damage(program, folder):
    """A copy of a program whose file for Linux has one other byte."""
    copied = copy_program(program, folder)
    path = copied.path("linux64")
    path.write_bytes(path.read_bytes()[:-1] + b"?")
    return copied


def test_isolation_refuses_a_damaged_library(tmp_path, monkeypatch):
    monkeypatch.setattr(guest_process, "ISOLATION", damage(ISOLATION, tmp_path))
    with pytest.raises(CosimError, match=r"^isolation: .*isolation\.so: is damaged, or of another version"):
        guest_process.find_library()


def test_no_fmu_gets_a_damaged_launcher(tmp_path, monkeypatch):
    monkeypatch.setattr(launch, "LAUNCHER", damage(LAUNCHER, tmp_path))
    with pytest.raises(BuildError, match=r"launcher\.so: is damaged, or of another version"):
        launch.put_launcher_in_front({PurePosixPath("binaries/linux64/Plant.so"): b"pythonfmu's"}, "Plant")


def test_no_fmu_gets_a_damaged_library_of_the_physics(tmp_path, monkeypatch):
    shutil.copytree(NUMERICS.folder, tmp_path / "numerics")
    damage(NUMERICS, tmp_path / "numerics")
    with pytest.raises(OSError, match=r"numerics\.so: is damaged, or of another version"):
        collect_imported(["numerics.library"], {"numerics": tmp_path / "numerics"})


def test_a_damaged_host_is_not_run(tmp_path, monkeypatch):
    monkeypatch.setattr(lives, "HOST", damage(HOST, tmp_path))
    with pytest.raises(OSError, match=r"host: is damaged, or of another version"):
        lives.find_c_host("linux64")


@pytest.mark.parametrize("cut", [1000, 20_000])
def test_a_damaged_library_is_refused_with_the_command_that_makes_it(tmp_path, cut):
    """In a copy of the package whose folder has a space in its name."""
    package = tmp_path / "a copy" / "ps_fmu"
    shutil.copytree(Path(ps_fmu.__file__).parent, package, ignore=shutil.ignore_patterns("__pycache__"))
    for program in (NUMERICS, REDUCTION, LOOP):
        path = package / program.path("linux64").relative_to(Path(ps_fmu.__file__).parent)
        path.write_bytes(path.read_bytes()[:cut] if cut < path.stat().st_size else b"")
    script = (
        f"import sys; sys.path.insert(0, {str(package.parent)!r})\n"
        "from ps_fmu.compiled_files import NotCompiledError\n"
        "from ps_fmu.cosim.guard import find_library as find_loop\n"
        "from ps_fmu.numerics import library\n"
        "from ps_fmu.reduction.library import find_library\n"
        "print(find_loop())\n"
        "for find in (library.find_arithmetic, find_library):\n"
        "    try: find()\n"
        "    except NotCompiledError as error: print(error)\n"
    )
    found = subprocess.run([sys.executable, "-I", "-c", script], capture_output=True, text=True, check=False)
    assert found.returncode == 0, found.stderr
    loop, *refused = found.stdout.splitlines()
    assert loop == "None"
    names = "numerics/linux64/numerics.so", "reduction/native/linux64/reduction.so"
    for line, name in zip(refused, names, strict=True):
        assert line.startswith(f"{package}/{name}: is damaged")
        assert line.endswith("run 'make launcher'")
