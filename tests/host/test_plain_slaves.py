"""Plain slaves of pythonfmu, wrapped and built, in hosts that know nothing of Python."""

import os
import shutil
import sys
from math import sin
from pathlib import Path

import pytest
from fmpy import read_model_description, simulate_fmu
from support.fmi_calls.caller import ERROR, OK, Caller, double, listed, text
from support.host import told, unpack
from support.page import build_with_pythonfmu, write_example

from ps_fmu.slavekit.pack.foreign import build_script, wrap

DRAIN = (("class Tank", "class Drain"), ("0.1 * math.sqrt(level)", "0.3 * level"), ("level < 0.0", "level != level"))


@pytest.fixture(scope="module")
def tanks(tmp_path_factory):
    """The example of docs/own-fmu.md by both ways, and another slave with modules of the same names; unpacked."""
    folder = tmp_path_factory.mktemp("tanks")
    built, _ = build_script(write_example(folder / "source"), output=folder / "built")
    wrapped, _ = wrap(build_with_pythonfmu(write_example(folder / "stock")), folder / "wrapped.fmu")
    drain, _ = build_script(write_example(folder / "other", *DRAIN), output=folder)
    fmus = {"built": built, "wrapped": wrapped, "drain": drain}
    return {name: unpack(fmu, folder / f"{name} unpacked") for name, fmu in fmus.items()}


@pytest.fixture
def bare_host(host, tmp_path):
    """``bare_host("run", 10, told(folder))``: nothing is set but PATH and HOME."""
    path = f"{Path(sys.executable).parent}{os.pathsep}/usr/bin{os.pathsep}/bin"
    return lambda *arguments: host(*arguments, PATH=path, HOME=str(tmp_path))


def test_the_example_of_the_page_gives_the_same_bits_everywhere(bare_host, tanks):
    runs = [bare_host("run", 50, told(tanks[name])) for name in ("built", "wrapped")]
    assert [(run.returncode, run.stderr) for run in runs] == [(0, ""), (0, "")]
    levels = {float(run.stdout) for run in runs}
    level = 1.0
    for i in range(50):
        level += 0.01 * (sin(0.01 * i) - 0.1 * level**0.5) / 2.0
    assert len(levels) == 1
    assert levels.pop() == pytest.approx(level, rel=1e-12)


def test_several_fmus_in_one_process_each_have_their_own_modules(bare_host, tanks):
    alone = {name: bare_host("run", 50, told(tanks[name])).stdout for name in ("wrapped", "drain")}
    assert alone["wrapped"] != alone["drain"]
    for order in (("wrapped", "drain"), ("drain", "wrapped")):
        run = bare_host("run", 50, *(told(tanks[name]) for name in order))
        assert (run.returncode, run.stderr) == (0, "")
        assert run.stdout == "".join(alone[name] for name in order)
    levels = [simulate_fmu(str(tanks[name]), stop_time=0.5, output_interval=0.1)["level"] for name in alone]
    assert levels[0][-1] > levels[1][-1]


@pytest.mark.parametrize("mode", ["keep", "threads", "leave", "reload"])
def test_hosts_that_end_in_their_own_ways(bare_host, tanks, mode):
    run = bare_host(mode, 5, told(tanks["drain"]))
    assert (run.returncode, run.stderr) == (0, "")


def test_a_bundled_one_runs_where_there_is_no_python(host, tanks, tmp_path):
    requirements = tmp_path / "requirements.txt"
    requirements.write_text("# packages\npythonfmu>=0.7\nMarkdown>=3  # as text\npywin32; sys_platform == 'win32'\n")
    fmu, _ = build_script(write_example(tmp_path / "source"), [requirements], tmp_path, bundled=True)
    run = host("run", 50, told(unpack(fmu, tmp_path / "bundled")), PATH="/nonexistent")
    assert (run.returncode, run.stderr) == (0, "")
    expected = host("run", 50, told(tanks["built"]), PS_FMU_PYTHON=sys.executable)
    assert run.stdout == expected.stdout
    packages = tmp_path / "bundled" / "binaries" / "linux64" / "python" / "lib" / "site-packages"
    assert (packages / "markdown" / "__init__.pyc").is_file()
    assert not (packages / "pythonfmu").exists()
    assert b'needsExecutionTool="false"' in (tmp_path / "bundled" / "modelDescription.xml").read_bytes()


class TestFaults:
    """The author's code fails: each call is an error with its traceback, the instance and the host live on."""

    @pytest.fixture
    def call(self, calls_program, tanks, tmp_path):
        """The example in a process, instantiated; the file ``fails`` makes its constructor fail."""
        change = ("super().__init__(**kwargs)", "super().__init__(**kwargs)\n        assert not self.fails(), '100%s'")
        test = f"__import__('os').path.exists({str(tmp_path / 'fails')!r})"
        method = ("    def do_step", f"    def fails(self):\n        return {test}\n\n    def do_step")
        fmu, _ = build_script(write_example(tmp_path / "source", change, method), output=tmp_path)
        folder = unpack(fmu, tmp_path / "unpacked")
        library = folder / "binaries" / "linux64" / "Tank.so"
        caller = Caller(calls_program, library, {"PS_FMU_PYTHON": sys.executable})
        guid, uri = read_model_description(str(folder)).guid, (folder / "resources").as_uri()
        assert caller("Instantiate", 0, text("tank"), 1, text(guid), text(uri), 1, 1).status == OK
        yield caller
        caller.kill()

    @staticmethod
    def begin(call):
        for function in ("SetupExperiment", "EnterInitializationMode", "ExitInitializationMode"):
            times = (0, double(0.0), double(0.0), 0, double(0.0)) if function == "SetupExperiment" else ()
            assert call(function, 0, *times).status == OK

    def test_a_thousand_steps_that_raise_then_a_reset_and_a_correct_step(self, call):
        self.begin(call)
        assert call("SetReal", 0, 1, "[0]", listed("Real", [-1e6])).status == OK
        assert call("DoStep", 0, double(0.0), double(0.1)).status == OK
        for _ in range(1000):
            answer = call("DoStep", 0, double(0.1), double(0.1))
            assert answer.status == ERROR
        (message,) = answer.messages
        assert "Traceback" in message[2]
        assert 'valve.py", line 6, in compute_flow' in message[2]
        assert "slavekit" not in message[2]
        assert call("GetReal", 0, 1, "[999]", "+").status == ERROR
        assert call("Reset", 0).status == OK
        self.begin(call)
        assert call("DoStep", 0, double(0.0), double(0.1)).status == OK
        assert call("FreeInstance", 0).status == OK
        assert call.close() == 0

    def test_a_constructor_that_fails_in_a_reset(self, call, tmp_path):
        (tmp_path / "fails").touch()
        assert call("Reset", 0).status == OK
        for _ in range(10):
            answer = call("EnterInitializationMode", 0)
            assert answer.status == ERROR
            assert "the reset has failed: AssertionError: 100%s" in answer.messages[0][2]
        (tmp_path / "fails").unlink()
        assert call("Reset", 0).status == OK
        self.begin(call)
        assert call("FreeInstance", 0).status == OK
        assert call.close() == 0

    def test_an_import_that_fails(self, host, tanks, tmp_path):
        folder = shutil.copytree(tanks["wrapped"], tmp_path / "broken")
        (folder / "resources" / "valve.py").write_text("import math\nraise ValueError('100 %n')\n")
        run = host("run", 1, told(folder), PS_FMU_PYTHON=sys.executable)
        assert run.returncode == 3
        logged = run.stderr[run.stderr.index("logStatusError: ") :]
        assert "Traceback" in logged
        assert "ValueError: 100 %n" in logged
        assert "slavekit" not in logged
        assert "importlib" not in logged
