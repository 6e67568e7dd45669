"""Disturbance, sensors, tracker and coils: steps of any size without Python, and work for later ones in small parts."""

from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.host import unpack
from support.models import Host, slave_class
from support.twins import InFmpy, InPython

from ps_fmu.numerics import library

H = 1e-4  # s
WHEELS = {f"wheel_{k}.enabled": True for k in (1, 2, 3, 4)}
CASES: dict[str, tuple[str, str, dict[str, Any]]] = {
    "noise": ("DisturbanceSource", "disturbance_source", {}),
    "wheels": ("DisturbanceSource", "disturbance_source", WHEELS | {"noise.multisine": True}),
    "sensors": ("InertialSensors", "inertial_sensors", {"rate_sensor.enabled": True}),
    "sampled": ("InertialSensors", "inertial_sensors", {"sample_time": 7.0 * H, "latency": 10.0 * H}),
    "tracker": ("LineOfSightSensor", "line_of_sight_sensor", {"acquisition_time": 0.01, "sample_time": 10.0 * H}),
    "coils": ("VoiceCoils", "voice_coils", {}),
}
Twins = tuple[InFmpy, InPython]


@pytest.fixture(params=CASES)
def twins(request: pytest.FixtureRequest, built_fmus: Path, tmp_path: Path) -> Iterator[Twins]:
    """The FMU behind the launcher, and its class without one; both in their stepping phase."""
    model, folder, start = CASES[request.param]
    native = InFmpy(unpack(built_fmus / f"{model}.fmu", tmp_path / "fmu"))
    python = InPython(slave_class(folder))
    for one in (native, python):
        one.set(start)
        one.initialise()
    yield native, python
    native.free()


def drive(one: InFmpy | InPython, begin: float, sizes: list[float]) -> list[list[float]]:
    rows = []
    for h in sizes:
        one.step(begin, h)
        begin += h
        rows.append(one.outputs())
    return rows


def list_sizes() -> list[float]:
    """Steps of one size, of another one at each step, and of 0.3 s: 100 blocks of fast noise."""
    random = np.random.default_rng(7)
    return [*[H] * 700, *random.uniform(0.1 * H, 3.0 * H, 200).tolist(), *[H / 2] * 100, *[0.3] * 20, *[H] * 100]


def test_no_step_enters_python_whatever_its_size(twins: Twins) -> None:
    native, python = twins
    sizes = list_sizes()
    assert drive(native, 0.0, sizes) == drive(python, 0.0, sizes)
    assert native.steps() == (len(sizes), 0)


def test_a_restored_state_goes_on_with_the_same_bits(twins: Twins) -> None:
    """Within rows and samples that are made together; after steps of other sizes, which have left other caches."""
    native, python = twins
    begin = 0.0
    for n in (203, 450):
        for one in twins:
            drive(one, begin, [H] * n)
        begin += n * H
        content = native.state()
        assert content == python.state()
        expected = drive(native, begin, [H] * 300)
        drive(python, begin, [0.3] * 9)
        python.restore(content)
        assert drive(python, begin, [H] * 300) == expected
        for one in twins:
            one.restore(content)


def test_rows_made_together_are_not_those_of_another_time() -> None:
    """A state with the same step, and a count of steps that there are rows of; but its steps began later."""
    one, other = (InPython(slave_class("disturbance_source")) for _ in range(2))
    for each in (one, other):
        each.initialise()
    drive(one, 0.0, [H] * 50)
    drive(other, 0.0, [*[H / 2] * 200, *[H] * 45])
    one.restore(other.state())
    assert drive(one, 145 * H, [H] * 10) == drive(other, 145 * H, [H] * 10)


def test_a_block_of_noise_is_made_by_many_steps_a_part_each() -> None:
    host = Host("disturbance_source", noise__period=20.0).run_mode()
    words = library.Noise.from_address(host.slave.disturbance.words.noise)
    layers = (library.NoiseLayer * 2).from_address(words.layers)
    parts, there = [], []
    for _ in range(25_000):
        before = [layer.done for layer in layers]
        host.step(H)
        parts.append(sum(max(layer.done - was, 0) for layer, was in zip(layers, before, strict=True)))
        there.append(2 in layers[1].number)
    assert set(parts) == {0, 1}
    assert not any(there[:20_000])
    assert all(there[24_950:])  # the block is needed from step 25 000 on


def test_a_block_of_the_drift_is_made_a_sensor_a_step() -> None:
    host = Host("inertial_sensors").run_mode()
    call = host.slave.before_map(H)[0]
    host.slave.before_map = lambda h: [call]
    host.slave.remap()
    made = []
    for _ in range(6500):  # a block of the drift is 6400 samples long
        host.step(H)
        stream = library.ErrorStream.from_address(call.arguments.errors[0].streams)
        made.append(tuple(count for pair in stream.made for count in pair))
    assert {sum(a != b for a, b in zip(*pair, strict=True)) for pair in pairwise(made)} == {0, 1}
    assert stream.number[0][1] == 1 and stream.made[0][1] == 9


def test_rows_beyond_the_last_time_are_refused() -> None:
    host = Host("disturbance_source", noise__enabled=False).run_mode()
    assert host.slave.do_step(0.0, 9e8)
    before = host.slave._fmu_state_to_bytes(host.slave._get_fmu_state())
    with pytest.raises(Exception, match=r"1\.8e\+09 s after the start of the experiment: expected at most 1e\+09 s"):
        host.slave.do_step(9e8, 9e8)
    assert host.slave._fmu_state_to_bytes(host.slave._get_fmu_state()) == before
