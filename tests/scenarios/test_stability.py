"""Stability through the real FMUs: the poles in their motion are those of linear theory."""

import json
from pathlib import Path

import numpy as np
import pytest

from ps_fmu.cosim import read_parameters
from ps_fmu.scenarios import stability
from ps_fmu.scenarios.options import OptionError
from ps_fmu.scenarios.support_modules import CASES, values_of

PARAMETERS = Path(__file__).parents[2] / "system" / "parameters"


def test_time_responses_have_the_predicted_poles(make_options, capsys):
    """In steps of 1 ms, with 1 ms more of delay: all four cases are stable, the lighter module beyond its limit not."""
    options = make_options("stability", 4.0, step_s=1e-3)
    stability.run(options)
    responses = json.loads((options.output / "summary.json").read_text())["responses"]
    assert [r["case"] for r in responses] == [*np.repeat(CASES, 2), "LSM"]
    for r in responses:
        assert r["pole_rad_s"] == pytest.approx(r["predicted_pole_rad_s"], rel=2e-3)
    assert [r["stable"] for r in responses] == [True] * 8 + [False]
    assert responses[-1]["pole_rad_s"][0] > 0.4 and responses[-1]["last_second_over_first"] > 2.0
    text = capsys.readouterr().out
    assert "With the delay of 0.02 s, stable: OSM, LSM, LDOSM, LDLSM; unstable: none." in text
    assert "Beyond the limit of 91.6 ms, with 100 ms, the motion of LSM grows" in text
    for name in ("fine", "payload"):
        assert (options.output / f"stability_{name}.png").stat().st_size > 20_000


def test_a_run_too_short_for_poles_is_refused(make_options):
    with pytest.raises(OptionError, match=r"--duration: poles need 3 s at least, got 1 s"):
        stability.run(make_options("stability", 1.0, step_s=1e-3))


def test_pulse_leaves_neither_velocity_nor_displacement():
    time = np.linspace(0.0, stability.PULSE_S, 4001)
    velocity = np.cumsum(stability.pulse(time))
    assert np.abs(stability.pulse(time)).max() == pytest.approx(1.0, abs=1e-6)
    assert abs(velocity[-1]) < 1e-9 * np.abs(velocity).max()
    assert abs(velocity.sum()) < 1e-9 * np.abs(velocity).sum()


@pytest.mark.parametrize(("case", "files"), [("OSM", ["OSM"]), ("LSM", ["LSM"]), ("LDLSM", ["LSM", "large_damping"])])
def test_cases_are_those_of_the_parameter_files(case, files):
    """And what the files leave out is the damping that the FMUs start with."""
    given = {}
    for name in files:
        given |= read_parameters(PARAMETERS / f"{name}.ssv")
    values = values_of(case)
    assert {name: values[name] for name in given} == given
    assert all("damping" in name for name in values.keys() - given.keys())
