"""Tables of the FMUs are made in parts ahead of their steps, in Python and by compiled calls in the launcher."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.host import unpack
from support.models import Host, slave_class
from support.twins import InFmpy, InPython

from ps_fmu.slavekit.author.ahead import TableAhead, finish

H = 1e-4  # s
SETTLED = 80  # steps of the first two tables, which are too short for so many parts

CASES: dict[str, tuple[str, dict[str, Any], int]] = {
    "disturbance": ("disturbance_source", {}, 30_000),
    "disturbance, all wheels": ("disturbance_source", {f"wheel_{k}__enabled": True for k in (1, 2, 3, 4)}, 10_000),
    "sensors": ("inertial_sensors", {}, 8_000),
    "sensors, all": (
        "inertial_sensors",
        {"rate_sensor__enabled": True} | {f"accelerometer_{k}__enabled": True for k in (10, 11, 12)},
        5_000,
    ),
    "sensors, sampled": ("inertial_sensors", {"sample_time": 10 * H}, 5_000),
    "tracker": ("line_of_sight_sensor", {}, 10_000),
    "tracker, each step": ("line_of_sight_sensor", {"sample_time": H}, 6_000),
    "coils": ("voice_coils", {}, 4_000),
    "commander": ("pointing_commander", {}, 4_000),
}


@pytest.mark.parametrize("case", CASES)
def test_no_step_has_to_do_what_others_left(case: str, monkeypatch: pytest.MonkeyPatch) -> None:
    folder, start, steps = CASES[case]
    host = Host(folder, **start).run_mode()
    core = host.slave._core
    advance, take = TableAhead.advance, TableAhead.take
    parts: list[int] = []
    unfinished: list[int] = []
    taken: list[int] = []

    def note_part(ahead: TableAhead) -> int:
        parts.append(core.count)
        return advance(ahead)

    def note_taken(ahead: TableAhead, key: Any) -> Any:
        (unfinished if ahead._parts is not None else taken).append(core.count)
        return take(ahead, key)

    monkeypatch.setattr(TableAhead, "advance", note_part)
    monkeypatch.setattr(TableAhead, "take", note_taken)
    for _ in range(steps):
        host.step(H)
    assert len([count for count in taken if count > SETTLED]) >= 2
    assert not [count for count in unfinished if count > SETTLED]
    assert len(set(parts)) == len(parts)


@pytest.mark.parametrize("case", CASES)
def test_a_row_does_not_depend_on_its_table(case: str) -> None:
    """Also where two tables are made at the same time, part by part in turn."""
    folder, start, _ = CASES[case]
    slave = Host(folder, **start).run_mode().slave
    slave.do_step(0.0, H)
    whole = finish(slave.rows(0.0, H, 3000))
    one, other = slave.rows(0.0, H, 1100), slave.rows(1100 * H, H, 1900)
    found: dict[str, np.ndarray] = {}
    turns = {"one": one, "other": other}
    while turns:
        for name, parts in list(turns.items()):
            try:
                next(parts)
            except StopIteration as end:
                found[name] = end.value
                del turns[name]
    np.testing.assert_array_equal(np.concatenate([found["one"], found["other"]]), whole)


STEPS = 9000  # into the fourth table of 4096 rows
MODELS = {"DisturbanceSource": "disturbance_source", "InertialSensors": "inertial_sensors", "VoiceCoils": "voice_coils"}


@pytest.fixture(params=MODELS)
def twins(request, built_fmus: Path, tmp_path: Path):
    """The FMU behind the launcher, and its class without one; both in their stepping phase."""
    native = InFmpy(unpack(built_fmus / f"{request.param}.fmu", tmp_path / "fmu"))
    python = InPython(slave_class(MODELS[request.param]))
    for one in (native, python):
        one.initialise()
    yield native, python
    native.free()


def drive(one: InFmpy | InPython, first: int, n: int, h: float = H) -> list[list[float]]:
    begin, rows = first * H, []
    for k in range(n):
        one.step(begin + k * h, h)
        rows.append(one.outputs())
    return rows


def test_the_launcher_makes_the_same_rows_and_asks_python_a_few_times_a_table(twins):
    native, python = twins
    assert drive(native, 0, STEPS) == drive(python, 0, STEPS)
    made, asked = native.steps()
    assert made + asked == STEPS
    assert asked <= 60


def test_states_and_steps_change_while_calls_wait(twins):
    """At three places within a table, so that calls were made, are waiting, or have been made."""
    native, python = twins
    first = 0
    for n in (2000, 450, 650):
        assert drive(native, first, n) == drive(python, first, n)
        first += n
        content = native.state()
        assert content == python.state()
        expected = drive(native, first, 1500)
        native.restore(content)
        assert drive(native, first, 1500) == expected
        python.restore(content)
        assert drive(python, first, 1500) == expected
        native.restore(content)
        python.restore(content)
    assert drive(native, first, 300, H / 2) == drive(python, first, 300, H / 2)
