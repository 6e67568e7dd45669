"""Steps by the launcher and steps in Python alone: every output and the state, bit for bit."""

import os
from collections.abc import Callable, Iterator, Sequence
from math import radians, sin
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.cosim import Collect
from support.host import unpack
from support.models import COMPONENTS, MODELS, slave_class
from support.twins import InFmpy, InPython

from ps_fmu.cosim import Master, System, read_system

ROOT = Path(__file__).parents[2]
STEP = 1e-4  # s
LOOP_STEPS = 100_000 if os.environ.get("PS_FMU_SOAK") else 20_000  # in the closed loop

Inputs = Callable[[int], dict[str, Any]]


@pytest.fixture(scope="module")
def unpacked(built_fmus, tmp_path_factory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("same_bits")
    return {model: unpack(built_fmus / f"{model}.fmu", folder / model) for model in MODELS}


def twins(model: str, unpacked: dict[str, Path], start: dict[str, Any]) -> tuple[InFmpy, InPython]:
    """An instance of each kind with the same start values, in their stepping phase."""
    pair = InFmpy(unpacked[model]), InPython(slave_class(MODELS[model]))
    for instance in pair:
        instance.set(start)
        instance.initialise()
    return pair


def shaking(k: int) -> dict[str, float]:
    """Something for the inputs that are not events."""
    return {f"base_force.{axis}": 5.0 * sin(0.3 * k + i) for i, axis in enumerate("xyz")} | {
        f"fine_force_{i}": 0.1 * sin(0.05 * k * i) for i in (1, 2, 3)
    }


def measured(k: int) -> dict[str, float]:
    """The same for the isolator."""
    return {f"base_acceleration.{axis}": 1e-2 * sin(0.3 * k + i) for i, axis in enumerate("xyz")}


def commanded(k: int) -> dict[str, float]:
    """The coarse legs move, fast enough for several linear models, and come to rest."""
    return shaking(k) | {f"coarse_command_{i}": 2e-4 * min(k // 100, 10) for i in (1, 2, 3)}


def turned(k: int) -> dict[str, Any]:
    """The platform turns; the isolator is switched off and on."""
    return measured(k) | {"orientation.roll": 1e-5 * min(k, 800), "enabled": not 900 <= k < 1000}


def aimed(k: int) -> dict[str, float]:
    """A slew, and another one before it has ended."""
    return {"target.roll": radians(0.5) if k >= 100 else 0.0, "target.yaw": radians(1.0) if k >= 1500 else 0.0}


def driven(k: int) -> dict[str, float]:
    """Commands that meet the current limit of coils, and motions that reach the stops."""
    sizes = {"force_command": 8.0, "added_force_command": 4.0, "fine_displacement": 2.2e-3, "fine_velocity": 0.1}
    return {
        f"{name}_{i}": size * sin(0.2 * k * (i + shift) + i)
        for shift, (name, size) in enumerate(sizes.items()) for i in (1, 2, 3)
    }  # fmt: skip


def moved(k: int) -> dict[str, float]:
    """A base that turns and meets the range of the accelerometers."""
    return {"base_acceleration.x": 6e-3 * sin(0.01 * k), "base_angular_velocity.y": 1e-2 * sin(0.03 * k)}


def sighted(k: int) -> dict[str, float]:
    """A target that moves, and is hidden for a while."""
    half = 5e-6 * sin(0.03 * k)  # rad
    return {"target_attitude.w": (1.0 - half**2) ** 0.5, "target_attitude.x": half, "target_visible": not 60 <= k < 80}


def erring(k: int) -> dict[str, float]:
    """A pointing error that meets the limit of the force."""
    return {f"line_of_sight_error.{axis}": 1e-5 * sin(0.05 * k * (i + 1) + i) for i, axis in enumerate("xyz")}


def nothing(k: int) -> dict[str, float]:
    return {}


CASES: dict[str, tuple[str, dict[str, Any], Inputs]] = {
    "plant": ("ManipulatorPlant", {}, shaking),
    "plant, re-linearised": ("ManipulatorPlant", {"payload.mass": 40.0}, commanded),
    "isolator, turned and switched": ("FeedforwardIsolator", {}, turned),
    "isolator, limited": ("FeedforwardIsolator", {"force_limit": 0.05}, turned),
    "isolator, delayed and limited": ("FeedforwardIsolator", {"force_limit": 0.05, "delay": 20 * STEP}, measured),
    "isolator, sampled": ("FeedforwardIsolator", {"sample_time": 10 * STEP}, turned),
    "commander": ("PointingCommander", {}, aimed),
    "disturbance": ("DisturbanceSource", {"rise_time": 0.1, "wheel_1.enabled": True}, nothing),
    "disturbance, speed from a file": (
        "DisturbanceSource",
        {"rise_time": 0.1, "wheel_1.enabled": True, "wheel_1.speed_profile": str(ROOT / "tests/data/wheel_speed.csv")},
        nothing,
    ),
    "coils": ("VoiceCoils", {"coil.ripple": 0.05, "driver.supply_voltage": 6.0, "driver.noise": 1e-3}, driven),
    "sensors": (
        "InertialSensors",
        {"sample_time": 2 * STEP, "latency": 4 * STEP, "accelerometer.range": 5e-3, "rate_sensor.enabled": True},
        moved,
    ),
    "tracker": (
        "LineOfSightSensor", {"acquisition_time": 10 * STEP, "sample_time": 5 * STEP, "latency": 7 * STEP}, sighted
    ),
    "controller": (
        "PointingController", {"force_limit": 0.01, "delay": 5 * STEP, "sample_time": 4 * STEP}, erring
    ),
}  # fmt: skip
MOST_IN_PYTHON = {"plant": 1, "disturbance": 300, "disturbance, speed from a file": 300, "coils": 60}
"""Steps: the first one, and those with a part of a table; the disturbance makes tables of 16 to 4096 rows."""


def time_points(n: int, alternating: bool) -> Iterator[tuple[int, float, float]]:
    """Number, start and size of each step; half of them the double size, if alternating."""
    t = 0.0
    for k in range(n):
        h = STEP * (1 + (alternating and k // 7 % 2))
        yield k, t, h
        t += h


@pytest.mark.parametrize("alternating", [False, True], ids=["", "two step sizes"])
@pytest.mark.parametrize("case", CASES)
def test_each_fmu_alone(unpacked, case: str, alternating: bool) -> None:
    model, start, inputs = CASES[case]
    native, python = twins(model, unpacked, start)
    for k, t, h in time_points(600 if alternating else 2600, alternating):
        for instance in (native, python):
            instance.set(inputs(k))
            instance.step(t, h)
        assert native.outputs() == python.outputs(), k
    assert native.state() == python.state()
    native_steps, python_steps = native.steps()
    assert native_steps + python_steps == k + 1
    if not alternating:
        assert python_steps <= MOST_IN_PYTHON.get(case, k)
    native.free()


@pytest.mark.parametrize("case", CASES)
def test_states_go_from_one_kind_to_the_other(unpacked, case: str) -> None:
    """After 250 steps, and 150 more with the state of either kind in new instances of both, and in the old ones."""
    model, start, inputs = CASES[case]
    old = twins(model, unpacked, start)

    def go_on(instances: Sequence[InFmpy | InPython], first: int, n: int) -> list[list[float]]:
        rows = []
        for k in range(first, first + n):
            for instance in instances:
                instance.set(inputs(k))
                instance.step(k * STEP, STEP)
            rows.append(instances[0].outputs())
            assert all(instance.outputs() == rows[-1] for instance in instances), k
        return rows

    go_on(old, 0, 250)
    contents = [instance.state() for instance in old]
    assert contents[0] == contents[1]
    expected = go_on(old, 250, 150)
    new = InFmpy(unpacked[model], "new"), InPython(slave_class(MODELS[model]), "new")
    for instance in (*old, *new):
        instance.restore(contents[0])
    assert go_on([*old, *new], 250, 150) == expected
    old[0].fmu.reset()
    old[0].set(start)
    old[0].initialise()
    fresh = InPython(slave_class(MODELS[model]), "fresh")
    fresh.set(start)
    fresh.initialise()
    go_on([old[0], fresh], 0, 150)
    for instance in (old[0], new[0]):
        instance.free()


def test_the_closed_loop(built_fmus) -> None:
    """All outputs of the default system; the master with FMUs, and a loop over Python objects with the same wiring.

    The isolator is switched twice, the platform begins to turn 200 steps before the end.
    """
    system = read_system(ROOT / "system" / "SystemStructure.ssd", built_fmus)
    changes = {
        LOOP_STEPS // 3: ("isolator", {"enabled": False}),
        LOOP_STEPS // 2: ("isolator", {"enabled": True}),
        LOOP_STEPS - 200: ("commander", {"target.roll": radians(1.0)}),
    }
    events = [(k * STEP, f"{name}.{v}", value) for k, (name, vs) in changes.items() for v, value in vs.items()]
    kept = Collect()
    with Master(system, STEP, "jacobi") as master:
        master.initialise()
        columns = [column.name for column in master.columns]
        master.run(LOOP_STEPS * STEP, [kept], events=events)
    expected = in_python(system, columns, changes)
    assert kept.values.shape == expected.shape
    differs = np.flatnonzero((kept.values != expected).any(axis=1))
    assert differs.size == 0, f"from row {differs[0]} on"
    assert np.ptp(expected[:, columns.index("plant.payload_rotation.x")]) > 0.0


def in_python(system: System, columns: list[str], changes: dict[int, tuple[str, dict[str, Any]]]) -> np.ndarray:
    """Outputs of the default system with slaves as Python objects, stepped by Jacobi."""
    slaves = {name: InPython(slave_class(MODELS[model]), name) for name, model in COMPONENTS.items()}
    layout = {name: instance.slave.layout for name, instance in slaves.items()}
    wires: dict[str, tuple[list[int], list[int]]] = {name: ([], []) for name in slaves}  # targets, columns
    for wire in system.connections:
        targets, sources = wires[wire.target.component]
        targets.append(layout[wire.target.component].find(wire.target.variable))
        sources.append(columns.index(str(wire.source)))
    own = {
        name: [columns.index(f"{name}.{layout[name].by_reference[r].name}") for r in (*i.reals, *i.booleans)]
        for name, i in slaves.items()
    }
    rows = np.empty((LOOP_STEPS + 1, len(columns)))

    def exchange(row: np.ndarray) -> None:
        for name, (targets, sources) in wires.items():
            slaves[name].slave.set_real(targets, row[sources].tolist())

    for instance in slaves.values():
        instance.slave.setup_experiment(0.0)
        instance.slave.enter_initialization_mode()
    for _ in slaves:  # so many passes reach the end of every chain
        for name, instance in slaves.items():
            rows[0, own[name]] = instance.outputs()
        exchange(rows[0])
    for instance in slaves.values():
        instance.slave.exit_initialization_mode()
    for k in range(LOOP_STEPS):
        if k in changes:
            name, values = changes[k]
            slaves[name].set(values)
        exchange(rows[k])
        for name, instance in slaves.items():
            instance.step(k * STEP, STEP)
            rows[k + 1, own[name]] = instance.outputs()
    return rows
