"""DisturbanceSource, the class itself: outputs, random access, state, refusals."""

import numpy as np
import pytest
from support.models import slave_class
from support.twins import InPython

from ps_fmu.disturbance import Disturbance, default_settings
from ps_fmu.disturbance.recording import HEADER
from ps_fmu.mechanism.parameters import load
from ps_fmu.mechanism.quantities import replace_values

STEP = 1e-4  # s
# A short period, so that a block of noise is synthesised in a moment.
QUICK = {"noise.period": 20.0}


def make(parameters=QUICK, start=0.0):
    """An initialised instance with some parameters set."""
    one = InPython(slave_class("disturbance_source"))
    one.set(parameters)
    one.initialise(start)
    return one.slave


def run(slave, steps, step=STEP, first=0, start=0.0):
    """Outputs at the end of each step, (steps, 6)."""
    rows = np.empty((steps, 6))
    for i in range(steps):
        assert slave.do_step(start + (first + i) * step, step)
        rows[i] = slave.y
    return rows


def test_outputs_are_the_disturbance_at_the_end_of_each_step():
    slave = make()
    assert not slave.values("base_force").any() and not slave.values("base_torque").any()
    disturbance = Disturbance(replace_values(default_settings(load()), QUICK))
    times = np.arange(1, 5001) * STEP
    np.testing.assert_array_equal(run(slave, 5000), disturbance(times))


@pytest.mark.parametrize("multisine", [False, True])
def test_step_sizes_agree(multisine):
    parameters = QUICK | {"noise.multisine": multisine, "noise.band.max": 300.0}
    fine = run(make(parameters), 5000)
    np.testing.assert_allclose(run(make(parameters), 500, 1e-3), fine[9::10], rtol=0.0, atol=1e-8)
    np.testing.assert_allclose(run(make(parameters), 2000, 2.5e-4)[1::2], fine[4::5], rtol=0.0, atol=1e-8)


def test_step_size_may_change_on_the_way():
    slave = make()
    fine = run(make(), 3000)
    run(slave, 1000)
    coarse = run(slave, 100, 1e-3, first=100)
    np.testing.assert_allclose(coarse, fine[1009:2000:10], rtol=0.0, atol=1e-8)


def test_time_counts_from_the_start_of_the_experiment():
    shifted = run(make(start=1234.5), 500, start=1234.5)
    np.testing.assert_allclose(shifted, run(make(), 500), rtol=0.0, atol=1e-6)


def test_recording(tmp_path):
    path = tmp_path / "recorded wrench.csv"
    path.write_text(",".join(HEADER) + "\n0,1,2,3,4,5,6\n1,2,2,3,4,5,6\n")
    slave = make({"noise.enabled": False, "recording.path": str(path)})
    np.testing.assert_array_equal(slave.y, [1, 2, 3, 4, 5, 6])
    np.testing.assert_allclose(run(slave, 10, 0.1)[:, 0], 1.0 + 0.1 * np.arange(1, 11))


@pytest.mark.parametrize(
    ("parameters", "problem"),
    [
        ({"noise.band.max": 0.01}, r"noise\.band: expected 0 < min < max"),
        ({"wheel_1.spin_axis.x": 0.0}, r"wheel_1\.spin_axis: must not be the zero vector"),
        ({"recording.path": "there-is-none.csv"}, r"recording\.path: no file 'there-is-none\.csv'"),
        ({"seed": -1}, "seed"),
    ],
)
def test_impossible_parameters_are_refused_by_name(parameters, problem):
    with pytest.raises(Exception, match=problem):
        make(parameters)


def test_steps_that_are_too_long_for_the_noise_are_warned_of_once(monkeypatch):
    slave = make()
    warnings = []
    monkeypatch.setattr(slave, "warning", warnings.append)
    run(slave, 10, 2e-4)
    assert not warnings
    run(slave, 100, 2e-3, first=1)
    assert len(warnings) == 1
    assert "noise.band.max" in warnings[0]
