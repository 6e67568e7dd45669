"""What is compiled in the package belongs to its source."""

import dataclasses
import hashlib
import json
import os

import pytest

from ps_fmu.blocks.native import BLOCKS
from ps_fmu.cosim.isolation.program import ISOLATION
from ps_fmu.cosim.native import LOOP
from ps_fmu.fmucheck.host.compile import HOST
from ps_fmu.interface.numerics_program import NUMERICS
from ps_fmu.slavekit.launcher import c_program
from ps_fmu.slavekit.launcher.compile import LAUNCHER

PROGRAMS = {program.name: program for program in (LAUNCHER, HOST, LOOP, ISOLATION, BLOCKS, NUMERICS)}
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
