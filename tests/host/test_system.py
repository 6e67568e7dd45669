"""The four FMUs of this project, wired, in a C host with nothing set but where Python is, or not even that.

``make soak`` tries all 24 load orders.
"""

import itertools
import os
import shutil
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support.host import told, unpack
from support.wired import run_master, wired

from ps_fmu.cosim import PortName
from ps_fmu.cosim.structure import Connection
from ps_fmu.slavekit.pack.build import build_one

FMUS = Path(__file__).parents[2] / "fmus"
WITH_PYTHON = {"PS_FMU_PYTHON": sys.executable}
WITHOUT = {"PATH": "/nonexistent"}
ONE_THREAD = {**WITH_PYTHON, "OMP_NUM_THREADS": "1"}  # quicker
STEP, STEPS = 1e-4, 200  # s
COMPONENTS = ("disturbance", "commander", "plant", "isolator")
ORDERS = list(itertools.permutations(COMPONENTS))[:: 1 if os.environ.get("PS_FMU_SOAK") else 6]
# Something of every kind: a slew; the isolator's period, delay and limit; a file; a connection of Booleans.
VALUES = {
    "disturbance.seed": 7,
    "isolator.sample_time": 2e-4,  # s
    "isolator.delay": 3e-4,  # s
    "isolator.force_limit": 0.05,  # N
    "plant.payload.mass": 40.0,  # kg
}
SWITCH = Connection(PortName("commander", "moving"), PortName("isolator", "enabled"), 0)
EVENTS = [(20 * STEP, "commander.target.roll", 0.01)]
RECORDING = """\
time [s],force.x [N],force.y [N],force.z [N],torque.x [N.m],torque.y [N.m],torque.z [N.m]
0.00, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
0.01, 20.0, 5.0, 0.0, 3.0, 1.0, -5.0
0.05, -10.0, 0.0, 5.0, 2.0, 2.0, 2.0
"""


@pytest.fixture(scope="module")
def lively(system, tmp_path_factory):
    """The system of this project with more going on in few steps."""
    recording = tmp_path_factory.mktemp("recording") / "a file.csv"
    recording.write_text(RECORDING)
    lively = system.with_parameters({**VALUES, "disturbance.recording.path": str(recording)})
    return replace(lively, connections=(*lively.connections, SWITCH))


@pytest.fixture(scope="module")
def expected(lively, tmp_path_factory):
    """Its outputs by name, as they are in the master at each step."""
    return run_master(lively, STEP, 2 * STEPS * STEP, EVENTS, tmp_path_factory.mktemp("master"))


@pytest.fixture(scope="module")
def ten_seconds(system, tmp_path_factory):
    """The system, events (a slew; the isolator goes off), and the outputs that the master gives."""
    seeded = system.with_parameters({"disturbance.seed": 7})
    events = [(8.0, "commander.target.roll", 0.02), (9.0, "isolator.enabled", False)]
    return seeded, events, run_master(seeded, STEP, 10.0, events, tmp_path_factory.mktemp("ten_seconds"))


@pytest.fixture
def file(lively, unpacked, tmp_path):
    return wired(tmp_path / "system.txt", lively, unpacked, STEP, events=EVENTS)


def printed(run):
    assert (run.returncode, run.stderr) == (0, "")
    return [[float(word) for word in line.split()] for line in run.stdout.splitlines()]


def at(step, outputs):
    return [column[step] for column in outputs.values()]


def test_all_takes_part(expected):
    """What rests would show nothing in the tests below."""
    for name in ("base_acceleration.x", "payload_rotation.y", "los.x"):
        assert len(set(expected[f"plant.{name}"])) > STEPS
    assert 0 < expected["isolator.saturated"].sum() < 2 * STEPS
    assert expected["commander.moving"].tolist() == 21 * [0] + 380 * [1]
    assert not expected["isolator.fine_force_1"][:22].any()
    assert expected["isolator.fine_force_1"][30:].all()


@pytest.mark.parametrize(
    ("folders", "environment", "steps"), [("unpacked", WITH_PYTHON, 100_000), ("bundles", WITHOUT, 10_000)]
)
def test_ten_seconds_equal_the_master(ten_seconds, folders, environment, steps, system_host, tmp_path, request):
    """With the Pythons that FMUs bring, one second of them."""
    system, events, columns = ten_seconds
    due = [event for event in events if event[0] < steps * STEP]
    file = wired(tmp_path / "system.txt", system, request.getfixturevalue(folders), STEP, events=due)
    every, result = 10, tmp_path / "rows"
    run = system_host("run", steps, file, every, result, **environment)
    assert (run.returncode, run.stdout, run.stderr) == (0, "", "")
    rows = np.fromfile(result).reshape(-1, len(columns))
    assert len(rows) == steps // every + 1
    np.testing.assert_array_equal(rows, np.column_stack(list(columns.values()))[: steps + 1 : every])


@pytest.mark.parametrize(("mode", "systems"), [("threads", 8), ("reload", 10)])
def test_a_system_in_each_of_eight_threads_and_ten_reloads(file, expected, system_host, mode, systems):
    assert printed(system_host(mode, STEPS, file, **ONE_THREAD)) == systems * [at(STEPS, expected)]


@pytest.mark.parametrize("order", ORDERS, ids="-".join)
def test_every_load_order_with_two_instances_of_each(lively, unpacked, expected, system_host, tmp_path, order):
    file = wired(tmp_path / "system.txt", lively, unpacked, STEP, order, EVENTS)
    assert printed(system_host("pair", 30, file, **ONE_THREAD)) == [at(30, expected)]


def test_a_state_continues_bit_for_bit(file, expected, system_host, tmp_path):
    """In the same instances, in others, and in another process."""
    states = tmp_path / "states"
    assert printed(system_host("states", STEPS, file, states, **ONE_THREAD)) == [at(2 * STEPS, expected)]
    assert printed(system_host("resume", STEPS, file, states, **ONE_THREAD)) == [at(2 * STEPS, expected)]


def test_two_versions_of_an_fmu(unpacked, host, tmp_path):
    """The second has twice the force."""
    source = shutil.copytree(FMUS / "feedforward_isolator", tmp_path / "feedforward_isolator")
    script = source / "feedforward_isolator.py"
    old = "        if self.delay:\n"
    new = "        elements.append(Linear(force, 2.0 * np.eye(3), force))\n" + old
    text = script.read_text().replace("Hold, Product", "Hold, Linear, Product")
    assert old in text
    script.write_text(text.replace(old, new))
    second = unpack(build_one(source, tmp_path), tmp_path / "second")
    files = [told(unpacked["isolator"], step=STEP), told(second, step=STEP)]
    forces = np.array(printed(host("run", STEPS, *files, **ONE_THREAD)))
    assert forces[0].all()
    assert forces[1].tolist() == (2.0 * forces[0]).tolist()
