"""What is compiled in the package belongs to its source."""

import dataclasses
import hashlib
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import ps_fmu
from ps_fmu.cosim.isolation.program import ISOLATION
from ps_fmu.cosim.native import LOOP
from ps_fmu.fmucheck.host.compile import HOST
from ps_fmu.interface.numerics_program import NUMERICS
from ps_fmu.reduction.native import REDUCTION
from ps_fmu.slavekit.launcher import c_program
from ps_fmu.slavekit.launcher.compile import LAUNCHER

PROGRAMS = {program.name: program for program in (LAUNCHER, HOST, LOOP, ISOLATION, REDUCTION, NUMERICS)}
# For Windows zig compiles its C library first: a minute on a machine that has not done so before.
LEFT_OUT = () if os.environ.get("PS_FMU_COMPILE") == "all" else ("win64",)
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
    copied.path("linux64").parent.mkdir()
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
        with pytest.raises(OSError, match=r"reduction\.so: is damaged, or of another version: install ps_fmu again"):
            program.find_whole("linux64")
    path.unlink()
    with pytest.raises(FileNotFoundError):
        program.find_whole("linux64")


@pytest.mark.parametrize("cut", [1000, 20_000])
def test_work_goes_on_in_numpy_with_damaged_libraries(tmp_path, cut):
    """In a copy of the package whose folder has a space in its name."""
    package = tmp_path / "a copy" / "ps_fmu"
    shutil.copytree(Path(ps_fmu.__file__).parent, package, ignore=shutil.ignore_patterns("__pycache__"))
    for program in (NUMERICS, REDUCTION, LOOP):
        path = package / program.path("linux64").relative_to(Path(ps_fmu.__file__).parent)
        path.write_bytes(path.read_bytes()[:cut] if cut < path.stat().st_size else b"")
    script = (
        f"import sys; sys.path.insert(0, {str(package.parent)!r})\n"
        "from ps_fmu.numerics import library; from ps_fmu.reduction.library import find_library\n"
        "from ps_fmu.cosim.compiled import is_available\n"
        "assert library.__file__.startswith(sys.path[0])\n"
        "print(library.find_arithmetic(), find_library(), is_available())\n"
    )
    found = subprocess.run([sys.executable, "-I", "-c", script], capture_output=True, text=True, check=False)
    assert (found.returncode, found.stdout) == (0, "None None False\n"), found.stderr
