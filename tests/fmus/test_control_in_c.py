"""Isolator, pointing controller and commander: no step enters Python, whatever changes from step to step."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.host import unpack
from support.models import slave_class
from support.twins import InFmpy, InPython

H = 1e-3  # s
RPY = ("roll", "pitch", "yaw")
Inputs = Callable[[int], dict[str, Any]]


def turn(k: int, name: str = "orientation") -> dict[str, float]:
    """An orientation that changes in each step, and rests for a while."""
    angles = 0.08 * np.sin(1e-2 * min(k, 300) * np.array([1.0, 0.7, 1.3]))
    return {f"{name}.{axis}": float(angle) for axis, angle in zip(RPY, angles, strict=True)}


def isolate(k: int) -> dict[str, Any]:
    names = [f"base_acceleration.{axis}" for axis in "xyz"] + [f"base_angular_acceleration.{axis}" for axis in "xyz"]
    shaken = {name: 1e-3 * float(np.sin(0.02 * k * (i + 1))) for i, name in enumerate(names)}
    return turn(k) | shaken | {"enabled": k % 50 < 40}


def point(k: int) -> dict[str, Any]:
    error = {f"line_of_sight_error.{axis}": 1e-4 * float(np.sin(0.02 * k + i)) for i, axis in enumerate("xyz")}
    return turn(k) | error | {"locked": k % 60 < 45, "enabled": k % 100 < 90}


def command(k: int) -> dict[str, Any]:
    """Targets near and far, some out of reach, one that is tried again; for a while a new one in each step."""
    if k < 200:
        return turn(k, "target")
    angles = ((-4.2, 4.9, 2.5), (-0.3, 4.6, 10.6), (20.0, 0.0, 0.0), (8.5, 0.0, 0.0))[(k // 40) % 4]
    return {f"target.{axis}": float(np.radians(angle)) for axis, angle in zip(RPY, angles, strict=True)}


CASES: dict[str, tuple[str, str, dict[str, Any], Inputs]] = {
    "isolator": ("FeedforwardIsolator", "feedforward_isolator", {"force_limit": 0.05}, isolate),
    "digital isolator": (
        "FeedforwardIsolator", "feedforward_isolator", {"sample_time": 3.0 * H, "delay": 5.0 * H}, isolate,
    ),
    "pointing": ("PointingController", "pointing_controller", {"force_limit": 0.2}, point),
    "digital pointing": (
        "PointingController", "pointing_controller", {"sample_time": 3.0 * H, "delay": 5.0 * H}, point,
    ),
    "commander": ("PointingCommander", "pointing_commander", {}, command),
    "Algorithm 1": ("PointingCommander", "pointing_commander", {"use_algorithm_1": True}, command),
    "following": ("PointingCommander", "pointing_commander", {"follow": True, "command_resolution": 1e-6}, command),
}  # fmt: skip
Twins = tuple[InFmpy, InPython, Inputs]


@pytest.fixture(params=CASES)
def twins(request: pytest.FixtureRequest, built_fmus: Path, tmp_path: Path) -> Iterator[Twins]:
    """The FMU behind the launcher, and its class without one, in their stepping phase; what is set before each step."""
    model, folder, start, inputs = CASES[request.param]
    native = InFmpy(unpack(built_fmus / f"{model}.fmu", tmp_path / "fmu"))
    python = InPython(slave_class(folder))
    for one in (native, python):
        one.set(start)
        one.initialise()
    yield native, python, inputs
    native.free()


def drive(
    one: InFmpy | InPython, inputs: Inputs, begin: float, sizes: list[float], first: int = 0
) -> list[list[float]]:
    rows = []
    for k, h in enumerate(sizes, first):
        one.set(inputs(k))
        one.step(begin, h)
        begin += h
        rows.append(one.outputs())
    return rows


def list_sizes() -> list[float]:
    """Steps of one size, of another one at each step, and long ones."""
    random = np.random.default_rng(7)
    return [*[H] * 300, *random.uniform(0.1 * H, 3.0 * H, 100).tolist(), *[H / 2] * 100, *[0.7] * 40, *[H] * 100]


def test_no_step_enters_python_whatever_changes(twins: Twins) -> None:
    native, python, inputs = twins
    sizes = list_sizes()
    rows = drive(native, inputs, 0.0, sizes)
    assert rows == drive(python, inputs, 0.0, sizes)
    assert np.ptp(rows, axis=0).max() > 0.0
    assert native.steps() == (len(sizes), 0)


def test_a_restored_state_goes_on_with_the_same_bits(twins: Twins) -> None:
    """In a slew; other steps in between have left other gains, maps and motions."""
    native, python, inputs = twins
    for one in (native, python):
        drive(one, inputs, 0.0, [H] * 230)
    content = native.state()
    assert content == python.state()
    expected = drive(native, inputs, 230 * H, [H] * 200, 230)
    drive(python, lambda k: inputs(k // 3), 230 * H, [0.3] * 20)
    python.restore(content)
    assert drive(python, inputs, 230 * H, [H] * 200, 230) == expected


@pytest.mark.parametrize("twins", [name for name in CASES if not name.startswith("digital")], indirect=True)
def test_the_outputs_do_not_depend_on_the_step(twins: Twins) -> None:
    """Ten steps with inputs that stay are one of ten times the size."""
    native, python, inputs = twins
    for one, n, h in ((native, 1, 10.0 * H), (python, 10, H)):
        one.set(inputs(7))
        for k in range(n):
            one.step(k * h, h)
    np.testing.assert_allclose(native.outputs(), python.outputs(), rtol=1e-9, atol=1e-15)
