"""FMUs in processes of their own: the same results, nothing left behind, and the options of commands."""

import argparse
import contextlib
import gc
import os
import signal
import subprocess
import sys
import textwrap
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from support import faulty
from support.cosim import OSCILLATOR, Collect
from support.processes import wait_until

from ps_fmu.cosim import Master, SlaveError, UsageError, read_system
from ps_fmu.cosim.fmu_instance import InstancePhase
from ps_fmu.cosim.isolation.instance import IsolatedInstance, Isolation, add_isolation_options, make_isolation

ROOT = Path(__file__).parents[2]
H = 0.01


@pytest.fixture
def mixed(make_system):
    """Reals, Integers and Booleans, in a loop of two and in a chain."""
    components = {"mass": "ToyMass", "first": "ToyCounter", "spring": "ToySpring", "second": "ToyCounter"}
    chain = ["first.odd -> second.enabled", "first.count -> second.increment"]
    return make_system(components, [*OSCILLATOR[1], *chain])


def simulate(system, isolation, steps=200, events=(), **options):
    """Rows of a run in two parts, with an input that is cut loose in between."""
    collect = Collect()
    with Master(system, H, isolation=isolation, **options) as master:
        master.initialise()
        master.run(steps // 2 * H, [collect], events)
        master.set("mass.force", 0.5)
        master.run(steps // 2 * H, [collect])
        master.reset({"mass.mass": 3.0})
        master.initialise()
        master.run(10 * H, [collect])
    return collect.values


@pytest.mark.parametrize("scheme", ["jacobi", "gauss-seidel"])
def test_rows_are_the_same_bit_for_bit(mixed, scheme):
    events = [(0.5, "first.increment", 3), (0.3, "second.enabled", False)]
    inside, isolated, mingled = (
        simulate(mixed, isolation, events=events, scheme=scheme)
        for isolation in (None, Isolation(), Isolation(frozenset({"spring", "second"})))
    )
    assert len(inside) == 201 + 11
    np.testing.assert_array_equal(isolated, inside)
    np.testing.assert_array_equal(mingled, inside)


def test_the_default_system_gives_the_same_bits(built_fmus):
    system = read_system(ROOT / "system" / "SystemStructure.ssd", built_fmus)
    found = []
    for isolation in (None, Isolation()):
        collect = Collect()
        with Master(system, 1e-4, isolation=isolation) as master:
            master.initialise()
            master.run(0.05, [collect])
        found.append(collect.values)
    assert found[0].shape[0] == 501
    assert np.ptp(found[0], axis=0).any()
    np.testing.assert_array_equal(*found)


def test_only_the_named_ones_are_isolated(mixed):
    with Master(mixed, H, isolation=Isolation(frozenset({"spring"}))) as master:
        master.initialise()
        kinds = {name: isinstance(i, IsolatedInstance) for name, i in master.instances.items()}
    assert kinds == {"mass": False, "first": False, "spring": True, "second": False}


def test_strings_and_numbers_of_all_types(make_system):
    system = make_system({"clock": "ToyFailing", "count": "ToyCounter"}, [])
    with Master(system.with_parameters({"clock.mode": "grün"}), H, isolation=Isolation()) as master:
        master.initialise()
        master.set("count.enabled", True)
        master.set("count.increment", -7)
        master.run(2 * H)
        assert master.get("clock.mode") == "grün"
        assert (master.get("count.count"), master.get("count.odd")) == (-14, False)


def test_states_of_any_size_go_through_the_pipe(tmp_path, make_system):
    system = make_system({"good": "Faulty"}, [], faulty.build(tmp_path).parent)
    with Master(system, H, isolation=Isolation()) as master:
        master.initialise()
        master.run(2 * H)
        instance = master.instances["good"]
        state = instance.write_state()
        master.run(H)
        with pytest.raises(SlaveError, match="good: fmi2DeSerializeFMUstate returned fmi2Error"):
            instance.read_state(bytes(32 << 20))  # it has another size
        instance.read_state(state)
        assert master.get("good.y") == pytest.approx(2 * H)


def test_a_component_that_is_not_there(mixed):
    with pytest.raises(UsageError, match="there is no component 'nobody'; expected one of mass, first"):
        Master(mixed, H, isolation=Isolation(frozenset({"nobody"})))


def list_guests(parent):
    """Processes of isolated FMUs, by their ids, that were started by a process."""
    found = []
    for folder in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):
            words = (folder / "cmdline").read_bytes().split(b"\0")
            if any(word.endswith(b"/guest.py") for word in words) and str(parent).encode() in words:
                found.append(int(folder.name))
    return found


def list_descriptors():
    """What is open in this process, but for TCP: a cluster of other tests may live in it, and opens and closes some."""
    tables = [Path(f"/proc/self/net/{name}").read_text().splitlines()[1:] for name in ("tcp", "tcp6")]
    tcp = {f"socket:[{line.split()[9]}]" for lines in tables for line in lines}
    found = []
    for number in os.listdir("/proc/self/fd"):
        with contextlib.suppress(FileNotFoundError):  # the folder that is listed, or closed in between
            found.append(os.readlink(f"/proc/self/fd/{number}"))
    return Counter(link for link in found if link not in tcp)


def test_processes_end_with_their_master(mixed):
    with Master(mixed, H, isolation=Isolation()) as first:  # unpacks the FMUs: the lock of their folder stays
        first.initialise()
    gc.collect()  # what earlier tests have left may have descriptors
    descriptors = list_descriptors()
    master = Master(mixed, H, isolation=Isolation())
    master.initialise()
    guests = list_guests(os.getpid())
    assert len(guests) == 4
    master.close()
    assert not list_guests(os.getpid())
    for guest in guests:  # no zombies
        with pytest.raises(ChildProcessError):
            os.waitpid(guest, os.WNOHANG)
    assert set(master.phases.values()) == {InstancePhase.FREED}
    del master
    gc.collect()
    assert not list_descriptors() - descriptors


def test_an_instance_that_cannot_be_loaded_leaves_no_process(tmp_path, make_system):
    system = make_system({"other": "Faulty", "refuses": "Faulty"}, [], faulty.build(tmp_path).parent)
    with pytest.raises(Exception, match="no licence"), Master(system, H, isolation=Isolation()) as master:
        master.initialise()
    assert not list_guests(os.getpid())


def test_processes_end_with_a_master_that_is_killed(tmp_path, make_system):
    system = make_system({"hang_busy": "Faulty"}, [], faulty.build(tmp_path).parent)
    script = f"""
        from ps_fmu.cosim import Master, read_system
        from ps_fmu.cosim.isolation.instance import Isolation
        with Master(read_system({str(system.path)!r}, {str(tmp_path)!r}), {H}, isolation=Isolation()) as master:
            master.initialise()
            print("ready", flush=True)
            master.run(1.0)
    """
    with subprocess.Popen([sys.executable, "-I", "-c", textwrap.dedent(script)], stdout=subprocess.PIPE) as process:
        process.stdout.readline()
        assert len(list_guests(process.pid)) == 1
        process.send_signal(signal.SIGKILL)
    wait_until(lambda: not list_guests(process.pid))


def parse(*arguments):
    parser = argparse.ArgumentParser()
    add_isolation_options(parser)
    given = parser.parse_args(arguments)
    return make_isolation(given.isolate or given.isolate_only, given.step_timeout, given.call_timeout)


def test_options():
    assert parse() is None
    assert parse("--isolate") == Isolation()
    assert parse("--isolate-only=a", "--isolate-only", "b") == Isolation(frozenset({"a", "b"}))
    assert parse("--isolate", "--step-timeout", "2.5") == Isolation(step_timeout_s=2.5)
    assert parse("--isolate", "--call-timeout", "2.5") == Isolation(call_timeout_s=2.5)
    assert parse("--isolate").timeouts_s == (60.0, 60.0)
    assert parse("--isolate", "--step-timeout", "5").timeouts_s == (5.0, 60.0)
    assert parse("--isolate", "--step-timeout", "600").timeouts_s == (600.0, 600.0)
    assert parse("--isolate", "--step-timeout", "600", "--call-timeout", "1").timeouts_s == (600.0, 1.0)


@pytest.mark.parametrize("value", ["0", "-1", "nan", "inf", "1e7"])
@pytest.mark.parametrize("name", ["--step-timeout", "--call-timeout"])
def test_a_timeout_that_is_no_time(name, value):
    with pytest.raises(UsageError, match=rf"{name}: expected a time above 0 s and up to 1e\+06 s, got"):
        parse("--isolate", f"{name}={value}")


@pytest.mark.parametrize("name", ["--step-timeout", "--call-timeout"])
def test_a_timeout_without_isolation(name):
    with pytest.raises(UsageError, match=f"{name}: needs --isolate"):
        parse(name, "1")


@pytest.mark.parametrize(
    ("fault", "timeouts", "error"),
    [
        # Steps before, and to instantiate, which starts a process, must take less on a busy machine, too.
        ("hang_asleep", {"step_timeout_s": 2.0}, r"fmi2DoStep at t = 0\.05 s did not return within 2 s"),
        ("hang_in_terminate", {"call_timeout_s": 5.0}, r"fmi2Terminate at t = 0\.1 s did not return within 5 s"),
    ],
)
def test_each_call_has_its_own_timeout(tmp_path, make_system, fault, timeouts, error):
    system = make_system({fault: "Faulty"}, [], faulty.build(tmp_path).parent)
    with (
        pytest.raises(SlaveError, match=f"{error}; its process has been ended"),
        Master(system, H, isolation=Isolation(**timeouts)) as master,
    ):
        master.initialise()
        master.run(10 * H)
