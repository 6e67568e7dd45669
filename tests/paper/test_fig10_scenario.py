"""Stability through the real FMUs: the poles in their motion are those of linear theory."""

import json
import re
from pathlib import Path
from types import SimpleNamespace

import netCDF4
import numpy as np
import pytest

from ps_fmu.cosim import read_parameters
from ps_fmu.mechanism.parameters import load
from ps_fmu.paper.bus_cases import case_start_values
from ps_fmu.paper.figures.fig10 import pulse, report
from ps_fmu.paper.figures.fig10.plots import explore_responses
from ps_fmu.paper.figures.fig10.pulse import PULSE_S
from ps_fmu.runs.execute import run_scenario
from ps_fmu.runs.options import OptionError

PARAMETERS = Path(__file__).parents[2] / "system" / "parameters"


def test_predictions_are_of_the_parameters_of_the_run(make_options, ssv, monkeypatch, capsys):
    """Stiffer legs, of which the isolator knows in part, at another orientation."""
    monkeypatch.setattr(pulse, "CASES", ("LSM",))
    stiffness = load().manipulator.fine_legs[0].stiffness
    given = {f"plant.fine_leg_{leg}.stiffness": 1.5 * stiffness for leg in (1, 2, 3)}
    given |= {f"isolator.fine_leg_{leg}.stiffness": 1.4 * stiffness for leg in (1, 2, 3)}
    given |= {"commander.target.roll": 0.1, "isolator.force_limit": 100.0}
    options = make_options("stability", 3.0, step_s=1e-3, parameters=(ssv(given),), figures=True)
    run_scenario(options)
    summary = json.loads((options.output / "summary.json").read_text())
    assert "commander.target.pitch is not connected and stays at 0.0 rad" in summary["warnings"]
    with netCDF4.Dataset(options.output / "results.nc") as file:
        assert list(file.groups) == ["parameters", *options.scenario.find_cases()]
    passive, active, late = summary["responses"]
    for r in (passive, active, late):
        assert r["pole_rad_s"] == pytest.approx(r["predicted_pole_rad_s"], rel=2e-3)
        assert r["pole_rad_s"][1] > 1.1 * 2.0 * np.pi * 5.3  # rad/s, as with the paper's legs
    text = capsys.readouterr().out
    assert float(re.search(r"limit of ([\d.]+) ms, with 100 ms", text)[1]) != pytest.approx(91.6, abs=1.0)
    assert "Not in the predictions: isolator.force_limit." in text
    for name in ("fine", "payload"):
        assert (options.output / f"stability_{name}.png").stat().st_size > 20_000


def test_charts_show_each_case_without_and_with_the_isolator():
    def respond(case, enabled, delay_s, motion):
        return SimpleNamespace(
            case=case, enabled=enabled, name=case if delay_s == 0.02 else f"{case}, 100 ms", time=np.arange(3.0),
            rotation=np.full((3, 3), motion), fine=np.full((3, 3), -motion),
        )  # fmt: skip

    responses = [
        respond("OSM", False, 0.02, 1.0), respond("OSM", True, 0.02, 2.0), respond("LSM", False, 0.02, 3.0),
        respond("LSM", True, 0.02, 4.0), respond("LSM", True, 0.1, 5.0),
    ]  # fmt: skip
    rotation, fine = explore_responses(responses).charts
    found = {chart.title: [(curve.colour, curve.low[0]) for curve in chart.curves] for chart in rotation.charts}
    assert found == {
        "OSM": [("passive", 1.0), ("active", 2.0)],
        "LSM": [("passive", 3.0), ("active", 4.0)],
        "LSM, 100 ms": [("passive", 3.0), ("active", 5.0)],
    }
    assert [chart.curves[1].low[0] for chart in fine.charts] == [-2.0, -4.0, -5.0]
    assert [chart.unit for chart in (*rotation.charts, *fine.charts)] == ["rad"] * 3 + ["m"] * 3


def test_a_limit_is_said_to_be_exceeded_only_if_it_is():
    for limit, said in ((0.05, "Beyond the limit of 50.0 ms"), (0.2, "Within the limit of 200.0 ms")):
        assert report.limit_text(SimpleNamespace(delay=0.1, delay_limit=limit)) == said
    assert "any delay" in report.limit_text(SimpleNamespace(delay=0.1, delay_limit=np.inf))


def test_a_run_too_short_for_poles_is_refused(make_options):
    with pytest.raises(OptionError, match=r"--duration: poles need 3 s at least, got 1 s"):
        run_scenario(make_options("stability", 1.0, step_s=1e-3))


def test_pulse_leaves_neither_velocity_nor_displacement():
    time = np.linspace(0.0, PULSE_S, 4001)
    velocity = np.cumsum(pulse.pulse(time))
    assert np.abs(pulse.pulse(time)).max() == pytest.approx(1.0, abs=1e-6)
    assert abs(velocity[-1]) < 1e-9 * np.abs(velocity).max()
    assert abs(velocity.sum()) < 1e-9 * np.abs(velocity).sum()


@pytest.mark.parametrize(("case", "files"), [("OSM", ["OSM"]), ("LSM", ["LSM"]), ("LDLSM", ["LSM", "large_damping"])])
def test_cases_are_those_of_the_parameter_files(case, files):
    """And what the files leave out is the damping that the FMUs start with."""
    given = {}
    for name in files:
        given |= read_parameters(PARAMETERS / f"{name}.ssv")
    values = case_start_values(case)
    assert {name: values[name] for name in given} == given
    assert all("damping" in name for name in values.keys() - given.keys())
