"""Phases, initialisation, messages, mistakes of a host."""

import math
import subprocess
import sys
from pathlib import Path

import pytest

from ps_fmu.slavekit.author.guard import FmuError
from ps_fmu.slavekit.author.slave import ModelError, Port, Refused, Slave

# --- Phases, initialisation, messages -----------------------------------------------------------------------------

def test_a_whole_life(toys):
    slave = toys["oscillator"](instance_name="o")
    slave.setup_experiment(1.0, 2.0, 1e-6)
    slave.enter_initialization_mode()
    slave.exit_initialization_mode()
    assert slave.do_step(1.0, 0.5)
    assert slave.do_step(1.5, 0.5)
    slave.terminate()
    assert slave.get_real([0]) == [slave.y[0]]


CALLS = {
    "setup_experiment": (0.0,),
    "enter_initialization_mode": (),
    "exit_initialization_mode": (),
    "terminate": (),
}


@pytest.mark.parametrize(
    ("history", "call"),
    [
        ([], "enter_initialization_mode"),
        ([], "exit_initialization_mode"),
        ([], "terminate"),
        (["setup_experiment"], "exit_initialization_mode"),
        (["setup_experiment", "enter_initialization_mode"], "setup_experiment"),
        (["setup_experiment", "enter_initialization_mode"], "enter_initialization_mode"),
        (["setup_experiment", "enter_initialization_mode"], "terminate"),
        (list(CALLS)[:3], "setup_experiment"),
        (list(CALLS)[:3], "enter_initialization_mode"),
        (list(CALLS)[:3], "exit_initialization_mode"),
        (list(CALLS), "terminate"),
        (list(CALLS), "setup_experiment"),
    ],
)
def test_calls_in_a_wrong_phase_are_refused(toys, history, call):
    slave = toys["oscillator"](instance_name="o")
    for earlier in history:
        getattr(slave, earlier)(*CALLS[earlier])
    before = slave._get_fmu_state().clock
    with pytest.raises(Refused, match=f"{call}"):
        getattr(slave, call)(*CALLS[call])
    assert slave._get_fmu_state().clock == before


@pytest.mark.parametrize(
    ("arguments", "problem"),
    [
        ((math.nan, None, None), "start time nan s"),
        ((math.inf, None, None), "start time inf s"),
        ((1.0, 1.0, None), "stop time 1.0 s: expected a number above the start time 1.0 s"),
        ((1.0, math.nan, None), "stop time nan s"),
    ],
)
def test_impossible_experiments_are_refused(toys, arguments, problem):
    slave = toys["oscillator"](instance_name="o")
    with pytest.raises(Refused, match=problem):
        slave.setup_experiment(*arguments)


def test_outputs_are_right_at_any_get_before_the_first_step(make, put):
    slave = make("oscillator", until="initialisation")
    assert slave.get_real([0]) == [0.1]
    put(slave, start__position=0.7)
    assert slave.get_real([0, 1]) == [0.7, 0.0]
    put(slave, engage=False)
    assert slave.get_boolean([2]) == [False]
    slave.exit_initialization_mode()
    assert slave.get_real([0]) == [0.7]


def test_outputs_set_by_configure_itself(make, put):
    slave = make("limiter", until="initialisation")
    put(slave, signal=3.0)
    assert slave.get_real([0, 1]) == [1.0, 0.0]


def test_the_start_time_belongs_to_the_configuration(toys):
    slave = toys["waves"](instance_name="w")
    assert slave.get_real([1]) == [0.0]
    slave.setup_experiment(5.0)
    assert slave.get_real([1]) == [5.0]


def test_what_is_not_set_is_not_configured_again(make, put):
    slave = make("waves", until="initialisation")
    calls = []
    slave.configure = lambda: calls.append(1)
    slave.get_real([0])
    slave.get_real([0, 1])
    put(slave, gain=1.0)  # as it was
    slave.get_real([0])
    slave.exit_initialization_mode()
    slave.get_real([0])
    assert len(calls) == 1


def test_a_configuration_that_fails_can_be_put_right(make, put):
    slave = make("oscillator", until="initialisation", note="impossible")
    for call in (slave.exit_initialization_mode, lambda: slave.get_real([0])):
        with pytest.raises(ModelError, match="note"):
            call()
    put(slave, note="possible")
    slave.exit_initialization_mode()
    assert slave.do_step(0.0, 0.01)


def test_a_configuration_that_is_not_finite_is_refused(make):
    slave = make("oscillator", until="initialisation")
    configure = slave.configure

    def bad():
        configure()
        slave.x[1] = math.nan

    slave.configure = bad
    with pytest.raises(ModelError, match="state 1 is not finite"):
        slave.exit_initialization_mode()


def test_inputs_cannot_be_set_after_the_end(make, put):
    slave = make("oscillator")
    slave.do_step(0.0, 0.1)
    slave.terminate()
    with pytest.raises(Refused, match="terminated"):
        put(slave, force=1.0)
    with pytest.raises(Refused, match="terminated"):
        slave.do_step(0.1, 0.1)


def test_messages_are_safe_as_printf_formats(make, capfd):
    slave = make("oscillator")
    slave.warning("50 % of %s")
    slave.error("100 %n")
    assert [(m.status, m.category, m.msg) for m in slave.log_queue] == [
        (1, "logStatusWarning", "Oscillator 'oscillator': 50 %% of %%s"),
        (3, "logStatusError", "Oscillator 'oscillator': 100 %%n"),
    ]
    assert capfd.readouterr().err == "Oscillator 'oscillator': 100 %n\n"


@pytest.mark.parametrize("name", ["terminate", "exit_initialization_mode", "setup_experiment", "get_real", "do_step"])
@pytest.mark.parametrize("inherited", [False, True])
def test_exceptions_of_overridden_methods_do_not_reach_the_library(toys, capfd, name, inherited):
    def fail(self, *arguments):
        raise KeyError("a slip of the author, 100 % sure")

    if inherited:
        broken = type("Broken", (type("Mixin", (), {name: fail}), toys["oscillator"]), {})
    else:
        broken = type("Broken", (toys["oscillator"],), {name: fail})
    slave = broken(instance_name="b")
    slave.hosted = True
    with pytest.raises(FmuError, match="Broken 'b': KeyError: 'a slip of the author, 100 %% sure'"):
        getattr(slave, name)()
    assert "Traceback" in capfd.readouterr().err


def test_mistakes_in_a_class_are_told_at_its_definition():
    with pytest.raises(TypeError, match="Mine: expected no __init__"):

        class Mine(Slave):
            def __init__(self, **kwargs):
                super().__init__(**kwargs)


def test_contradictions_between_ports_are_told_at_the_definition():
    with pytest.raises(ValueError, match="Twice: declared twice: a"):

        class Twice(Slave):
            ports = (Port("a", "input"), Port("a", "output"))

    with pytest.raises(ValueError, match="Unknown: y depends on v, not among the inputs"):

        class Unknown(Slave):
            ports = (Port("u", "input"), Port("y", "output", depends_on=("u", "v")))


# --- Ends of Python hosts that instantiate FMUs in threads of their own -------------------------------------------

HOST = """
import _thread, sys

sys.modules.pop("threading", None)
done, never = _thread.allocate_lock(), _thread.allocate_lock()
done.acquire(), never.acquire()

def worker():
    from ps_fmu.slavekit.author.slave import _forget_host_thread as forget_host_thread
    forget_host_thread()
    done.release()
    never.acquire()

_thread.start_new_thread(worker, ())
done.acquire()
import threading
print(threading.main_thread().ident == _thread.get_ident())
"""


def test_python_ends_though_a_worker_imported_threading_first():
    """The worker waits for ever, as those of thread pools do until the host has freed them."""
    run = subprocess.run([sys.executable, "-c", HOST], capture_output=True, text=True, timeout=300)
    assert (run.returncode, run.stderr) == (0, "")
    assert run.stdout == ("True\n" if sys.version_info >= (3, 13) else "False\n")


# --- Mistakes of a host neither crash the process nor use up its memory -------------------------------------------

FAULTS = Path(__file__).parent / "hosts" / "faults.py"


def test_hundreds_of_faults_at_every_entry_point(built, make):
    run = subprocess.run(
        [sys.executable, str(FAULTS), str(built["oscillator"]), "300"], capture_output=True, text=True, timeout=120
    )
    assert run.returncode == 0, run.stderr[-3000:]
    growth, position = run.stdout.split()[-2:]
    assert int(growth) < 1000  # kB, over 2500 faults
    slave = make("oscillator", reference=0.0)
    slave.set_real([slave.layout.find("reference")], [0.5])
    for i in range(10):
        assert slave.do_step(i * 0.1, 0.1)
    assert float(position) == slave.value("position")
    assert "input force = nan: expected a finite number N" in run.stderr
    assert "reference = 2.0 m: expected at most 1 m" in run.stderr
