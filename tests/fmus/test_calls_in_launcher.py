"""Noise of the FMUs: the launcher has compiled calls make it, Python is asked for a few parts of each table."""

from pathlib import Path

import pytest
from support.host import unpack
from support.models import slave_class
from support.twins import InFmpy, InPython

H = 1e-4  # s
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
