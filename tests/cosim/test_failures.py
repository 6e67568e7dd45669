"""FMUs and observers that fail, Ctrl-C: what was computed arrives, the error says where and when.

Statuses that a pythonfmu slave cannot return safely come from a stand-in for the library function.
"""

import ctypes
import logging
import os
import re
import signal
import subprocess
import sys
import tempfile
import textwrap
from pathlib import Path

import numpy as np
import pytest
from fmpy.fmi2 import FMU2Slave, fmi2CallbackLoggerTYPE
from support import archives
from support.archives import drop, put

from ps_fmu.cosim import Master, RecorderError, SlaveError, SystemFileError
from ps_fmu.cosim.fmu_instance import FmuInstance, InstancePhase
from ps_fmu.cosim.messages import KEPT, REMEMBERED, MessageLog, forget, listen

H = 0.01


@pytest.fixture
def failing(make_system):
    """A mass that goes on, and a clock that fails at 0.05 s in the given mode."""

    def make(mode, model="ToyFailing"):
        system = make_system({"mass": "ToyMass", "clock": model}, [])
        return system.with_parameters({"clock.mode": mode} if model == "ToyFailing" else {})

    return make


def run(system, collect, **options):
    """Run 0.1 s; return the master and what was raised."""
    master = Master(system, H, **options)
    with pytest.raises(BaseException) as caught, master:
        master.initialise()
        master.run(0.1, [collect])
    return master, caught.value


@pytest.mark.usefixtures("not_ended")
@pytest.mark.parametrize("scheme", ["jacobi", "gauss-seidel"])
@pytest.mark.parametrize("block_rows", [3, 1000])
def test_discard_keeps_all_complete_rows(failing, collect, scheme, block_rows):
    master, error = run(failing("discard"), collect, scheme=scheme, block_rows=block_rows)
    assert isinstance(error, SlaveError)
    assert (error.component, error.function, error.status) == ("clock", "fmi2DoStep", 2)
    assert error.time == pytest.approx(0.05)
    text = str(error)
    repeat = "cannot be repeated in smaller ones: mass cannot be set back to a state (canGetAndSetFMUstate is false)"
    last = "last successful time 0.05 s"
    for part in ("clock", "0.05 s", "fmi2Discard", last, "cannot go on", "smaller step", repeat):
        assert part in text
    assert "stopped at t = 0.05 s" in error.__notes__[0]
    np.testing.assert_allclose(collect.time, np.arange(6) * H)
    assert master.phases["clock"] is InstancePhase.FREED


def test_a_value_that_is_not_finite_ends_the_run_before_it(failing, collect):
    _, error = run(failing("nan"), collect)
    assert isinstance(error, SlaveError)
    assert error.component == "clock"
    assert error.variables == ("clock.clock",)
    assert error.time == pytest.approx(0.06)
    assert "not a finite number at t = 0.06 s: clock.clock" in str(error)
    assert len(collect.time) == 6
    assert np.isfinite(collect.values).all()


def test_the_source_of_a_nan_is_named_and_not_its_victim(make_system, collect, answer):
    """An FMU that refuses a NaN is not to blame for it."""
    system = make_system({"clock": "ToyFailing", "gain": "ToyGain"}, ["clock.clock -> gain.u"])
    answer("gain", "fmi2SetReal", 3, n=6)
    _, error = run(system.with_parameters({"clock.mode": "nan"}), collect)
    assert isinstance(error, SlaveError)
    assert error.component == "clock"
    assert isinstance(error.__cause__, SlaveError)
    assert error.__cause__.component == "gain"
    assert error.__cause__.variables == ("u",)
    assert len(collect.time) == 6


def test_warnings_are_shown_once_and_counted(failing, collect, caplog):
    system = failing("warn")
    with caplog.at_level(logging.WARNING), Master(system, H) as master:
        master.initialise()
        master.run(0.1, [collect])
    assert len(collect.time) == 11
    assert [r.getMessage() for r in caplog.records] == ["clock: [fmi2Warning] getting warm"]


def test_a_warning_status_lets_the_run_go_on(failing, collect, caplog, answer):
    answer("clock", "fmi2DoStep", 1)
    with caplog.at_level(logging.WARNING), Master(failing("none"), H) as master:
        master.initialise()
        master.run(0.1, [collect])
        assert master.warnings == {"mass": 0, "clock": 5}
    assert len(collect.time) == 11
    assert [r.getMessage() for r in caplog.records] == ["clock: fmi2DoStep returned fmi2Warning, first at t = 0.05 s"]


@pytest.mark.parametrize(
    ("status", "name", "phase"),
    [
        (3, "fmi2Error", InstancePhase.FREED),
        (4, "fmi2Fatal", InstancePhase.FATAL),
        (5, "fmi2Pending", InstancePhase.FREED),
        (-7, "not an fmi2Status", InstancePhase.FREED),
    ],
)
def test_errors_name_component_function_and_time(failing, collect, answer, status, name, phase):
    calls = answer("clock", "fmi2DoStep", status)
    master, error = run(failing("none"), collect)
    assert isinstance(error, SlaveError)
    assert (error.component, error.status) == ("clock", status)
    assert "clock: fmi2DoStep at t = 0.05 s returned" in str(error)
    assert name in str(error)
    assert len(collect.time) == 6
    assert len(calls) == 6  # nothing is stepped after a failure
    assert master.phases["clock"] is phase
    assert master.phases["mass"] is InstancePhase.FREED


def test_fatal_silences_every_instance_of_the_fmu(make_system, collect, answer, monkeypatch):
    """After fmi2Fatal no function of that FMU may be called, not even to free an instance."""
    phases = {}
    free = FmuInstance.free
    monkeypatch.setattr(FmuInstance, "free", lambda self: (phases.setdefault(self.name, self.phase), free(self)))
    answer("b", "fmi2DoStep", 4)
    run(make_system({"a": "ToyGain", "b": "ToyGain", "mass": "ToyMass"}, []), collect)
    assert phases == {"a": InstancePhase.FATAL, "b": InstancePhase.FATAL, "mass": InstancePhase.TERMINATED}


def test_get_and_set_failures_name_the_variables(failing, collect, answer):
    answer("mass", "fmi2GetReal", 3)
    _, error = run(failing("none"), collect)
    assert isinstance(error, SlaveError)
    assert error.variables == ("position", "velocity")
    assert "fmi2GetReal at t = 0.06 s" in str(error)
    assert "position, velocity" in str(error)
    assert len(collect.time) == 6


class Refusing:
    """Observer that fails in its second block."""

    def __init__(self):
        self.blocks = 0

    def block(self, first_index, time, values):
        self.blocks += 1
        if self.blocks == 2:
            raise RecorderError("no space")


def test_an_observer_that_raises_does_not_rob_the_others(failing, collect):
    master = Master(failing("none"), H, block_rows=4)
    with pytest.raises(RecorderError, match="no space") as caught, master:
        master.initialise()
        master.run(0.1, [Refusing(), collect])
    assert len(collect.time) == 8
    assert "Refusing" in caught.value.__notes__[0]
    assert "stopped at t = 0.07 s" in caught.value.__notes__[1]
    assert master.phases["mass"] is InstancePhase.FREED


@pytest.mark.usefixtures("not_ended")
def test_a_failing_observer_does_not_hide_the_failing_fmu(failing, collect):
    master = Master(failing("discard"), H, block_rows=4)
    with pytest.raises(SlaveError) as caught, master:
        master.initialise()
        master.run(0.1, [Refusing(), collect])
    assert len(collect.time) == 6
    assert any("Refusing failed, too: no space" in note for note in caught.value.__notes__)


def test_ctrl_c_inside_an_fmu_ends_the_run_after_the_step(failing, collect):
    before = signal.getsignal(signal.SIGINT)
    master, error = run(failing("", "ToyInterrupting"), collect)
    assert isinstance(error, KeyboardInterrupt)
    assert "stopped at t = 0.06 s" in error.__notes__[0]
    np.testing.assert_allclose(collect.time, np.arange(7) * H)
    np.testing.assert_allclose(collect.values[:, 2], np.arange(7) * H)
    assert master.phases["clock"] is InstancePhase.FREED
    assert signal.getsignal(signal.SIGINT) is before


def test_ctrl_c_inside_the_initialisation_of_an_fmu(failing, collect):
    master, error = run(failing("", "ToyInterrupting").with_parameters({"clock.at": -1.0}), collect)
    assert isinstance(error, KeyboardInterrupt)
    assert master.phases["clock"] is InstancePhase.FREED
    assert collect.time.size == 0


@pytest.mark.parametrize(("pressed", "rows"), [(4, 8), (8, 11)])
def test_ctrl_c_while_an_observer_takes_a_block_or_the_last_one(failing, collect, pressed, rows):
    class Pressing:
        def block(self, first_index, time, values):
            if first_index == pressed:
                os.kill(os.getpid(), signal.SIGINT)

    master = Master(failing("none"), H, block_rows=4)
    with pytest.raises(KeyboardInterrupt), master:
        master.initialise()
        master.run(0.1, [Pressing(), collect])
    assert len(collect.time) == rows


def test_an_exception_of_a_stock_slave_is_fatal_and_reported(toys, tmp_path):
    """In a process of its own: the wrapper of pythonfmu releases objects that are still in use."""
    script = """
        import sys
        sys.path.insert(0, sys.argv[3])
        from support.cosim import Collect, ssd_text
        from pathlib import Path
        from ps_fmu.cosim import Master, SlaveError, read_system
        path = Path(sys.argv[2]) / "test.ssd"
        path.write_text(ssd_text({"clock": "ToyFailing", "mass": "ToyMass"}, []))
        system = read_system(path, Path(sys.argv[1])).with_parameters({"clock.mode": "exception"})
        collect = Collect()
        try:
            with Master(system, 0.01) as master:
                master.initialise()
                master.run(0.1, [collect])
        except SlaveError as error:
            told = "the model broke" in str(error)
            print(error.component, error.status, round(error.time, 9), len(collect.time), told)
    """
    result = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(script), toys, tmp_path, Path(__file__).parents[1]],
        capture_output=True, text=True, timeout=300, check=False,
    )  # fmt: skip
    assert result.stdout.split() == ["clock", "4", "0.05", "6", "True"], result.stderr


def test_a_failing_initialisation_frees_what_was_loaded(make_system, answer, monkeypatch):
    freed = []
    free = FmuInstance.free
    monkeypatch.setattr(FmuInstance, "free", lambda self: (freed.append(self.name), free(self)))
    monkeypatch.setattr(
        FmuInstance, "exit_initialisation", lambda self, time: self.check("fmi2ExitInitializationMode", 3, time)
    )
    master = Master(make_system({"mass": "ToyMass", "gain": "ToyGain"}, []), H)
    with pytest.raises(SlaveError, match="fmi2ExitInitializationMode at t = 0 s returned fmi2Error"):
        master.initialise()
    assert freed == ["mass", "gain"]


def test_an_fmu_that_cannot_be_instantiated_or_loaded(make_system, rewrite, toys, monkeypatch):
    identifier = {'modelIdentifier="ToyGain"': 'modelIdentifier="Nothing"'}
    system = make_system({"gain": "ToyGain"}, [], rewrite(toys / "ToyGain.fmu", identifier).parent)
    directory = os.getcwd()
    with pytest.raises(SystemFileError, match="component 'gain' cannot be loaded on this platform"):
        Master(system, H).initialise()
    assert os.getcwd() == directory

    def refuse(self, **options):
        raise Exception("Failed to instantiate model")  # what FMPy raises for a null pointer

    monkeypatch.setattr(FMU2Slave, "instantiate", refuse)
    with pytest.raises(SlaveError, match="gain: fmi2Instantiate failed"):
        Master(make_system({"gain": "ToyGain"}, []), H).initialise()


@pytest.mark.parametrize(
    ("member", "content", "reason"),
    [
        ("resources/slavemodule.txt", None, "there is no resources/slavemodule.txt"),
        ("resources/slavemodule.txt", b"", "there is no 'resources/.py'"),
        ("resources/slavemodule.txt", b"../toy_gain\n", "there is no 'resources/../toy_gain.py'"),
        ("resources/slavemodule.txt", b"\xff\0", "there is no 'resources/"),
        ("resources/toy_gain.py", None, "there is no 'resources/toy_gain.py', the module of the slave"),
    ],
)
def test_a_plain_pythonfmu_fmu_that_is_not_complete_is_refused(make_system, toys, tmp_path, member, content, reason):
    """Its library would end this process with SIGSEGV."""
    archives.rewrite(toys / "ToyGain.fmu", tmp_path, drop(member) if content is None else put(member, content))
    with pytest.raises(SystemFileError, match=re.escape(reason)):
        Master(make_system({"gain": "ToyGain"}, [], tmp_path), H).initialise()


def test_a_temporary_folder_that_fmus_cannot_read_is_refused(make_system, tmp_path, monkeypatch):
    folder = tmp_path / "größe"
    folder.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    with pytest.raises(SystemFileError, match="TMPDIR"):
        Master(make_system({"gain": "ToyGain"}, []), H).initialise()
    assert list(folder.iterdir()) == []


def test_messages_are_shown_once(caplog):
    messages = MessageLog("plant")
    with caplog.at_level(logging.WARNING):
        for _ in range(3):
            messages.add(1, "logStatusWarning", "getting warm\n")
            messages.add(0, "logAll", "all is well")
    assert [record.getMessage() for record in caplog.records] == ["plant: [fmi2Warning] getting warm"]


def test_errors_are_left_to_the_exception_that_they_explain(caplog):
    messages = MessageLog("plant")
    with caplog.at_level(logging.WARNING):
        messages.add(3, "", "the mass is negative")
        assert messages.take() == ("[fmi2Error] the mass is negative",)
        messages.show_held()
        assert caplog.records == []
        messages.add(3, "", "nobody asked")
        messages.show_held()
    assert [record.getMessage() for record in caplog.records] == ["plant: [fmi2Error] nobody asked"]


def test_a_chatty_fmu_does_not_fill_the_memory(caplog):
    messages = MessageLog("plant")
    with caplog.at_level(logging.WARNING):
        for number in range(10 * REMEMBERED):
            messages.add(1, "", f"number {number}")
    assert messages.take()[-1] == f"[fmi2Warning] number {10 * REMEMBERED - 1}"
    assert len(messages.take()) == KEPT
    assert len(caplog.records) == REMEMBERED + 2
    assert "more different messages than are shown" in caplog.records[-1].getMessage()


def test_messages_cannot_drive_the_terminal_or_forge_lines(caplog):
    messages = MessageLog("plant")
    with caplog.at_level(logging.WARNING):
        messages.add(1, "", "a\x1b[2J\x07\x9b1m é\r\nps-fmu: done\rps-fmu: done")
    shown = r"plant: [fmi2Warning] a\x1b[2J\x07\x9b1m é" + 2 * "\n    ps-fmu: done"
    assert [record.getMessage() for record in caplog.records] == [shown]
    assert messages.take() == (shown.removeprefix("plant: ").replace("\n    ", "\n"),)


def test_each_instance_is_heard_and_others_go_to_fmpy(capfd):
    first, second = MessageLog("first"), MessageLog("second")
    callbacks = [listen(first), listen(second)]
    speak = [fmi2CallbackLoggerTYPE(ctypes_address(c.logger)) for c in callbacks]
    speak[0](callbacks[0].componentEnvironment, b"first", 3, None, b"\xff from the first")
    speak[1](callbacks[1].componentEnvironment, b"second", 3, b"category", b"from the second")
    forget(callbacks[0])
    speak[0](callbacks[0].componentEnvironment, b"first", 3, None, b"from nobody")
    forget(callbacks[1])
    assert first.take() == ("[fmi2Error] \ufffd from the first",)
    assert second.take() == ("[fmi2Error] from the second",)
    assert "[ERROR] from nobody" in capfd.readouterr().out


def ctypes_address(function):
    return ctypes.cast(function, ctypes.c_void_p).value
