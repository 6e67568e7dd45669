"""Each scenario through the real FMUs, short: what it writes, and that it is complete."""

import json
import math
import re
import shutil
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import netCDF4
import numpy as np
import pytest
from support.claims import verify_claim

from ps_fmu.cosim import CosimError, UsageError, description
from ps_fmu.paper.figures.table2 import report as table2
from ps_fmu.paper.figures.table2 import runs as table2_runs
from ps_fmu.runs import setup
from ps_fmu.runs.options import OptionError
from ps_fmu.runs.run import execute
from ps_fmu.runs.setup import load_system

SYSTEM = Path(__file__).parents[2] / "system" / "SystemStructure.ssd"
KEYS = {
    "scenario", "orientation_deg", "step_s", "duration_s", "seed", "rms_passive_rad", "rms_active_rad",
    "rejection_percent", "real_time_factor", "fmus", "versions",
}  # fmt: skip


def run(options, fmus=4):
    """Runs the scenario of the options; returns its summary.json, and why it is no success."""
    done = execute(options)
    summary = json.loads((options.output / "summary.json").read_text())
    assert summary.keys() >= KEYS
    assert summary["scenario"] == options.scenario.name
    assert summary["real_time_factor"] > 0.0
    assert len(summary["fmus"]) == fmus
    return {**summary, "failures": done.failures}


def check_files(options, groups, rows):
    """results.nc has the groups with as many rows, all with units; the report is complete."""
    with netCDF4.Dataset(options.output / "results.nc") as file:
        assert groups == list(options.scenario.find_cases())
        assert list(file.groups) == ["parameters", *groups]
        for name in groups:
            group = file[name]
            assert len(group["time"]) == rows
            assert all(variable.units for variable in group.variables.values())
            assert {"plant.los.x", "commander.reachable", "isolator.fine_force_1"} <= set(group.variables)
            assert np.isfinite(group["plant.payload_rotation.x"][:]).all()
    page = (options.output / "report.html").read_text()
    pictures = sorted(options.output.glob("*.png"))
    assert page.count("<img ") == len(pictures)
    assert bool(pictures) == options.figures
    assert page.rstrip().endswith("</html>")
    assert "SHA-256" in page and "matplotlib" in page
    return page


def test_isolation(make_options, capsys, steps_in_c):
    options = make_options("isolation", 0.2, step_s=2e-4, seed=3, figures=True)
    summary = run(options)
    page = check_files(options, ["passive", "active"], 201)
    assert (summary["orientation_deg"], summary["seed"]) == ([0.0, 0.0, 0.0], 3)
    passive, active = (np.array(summary[f"rms_{case}_rad"]) for case in ("passive", "active"))
    assert (active > 0.0).all() and (active < passive).all()
    np.testing.assert_allclose(summary["rejection_percent"], 100.0 * (1.0 - active / passive), rtol=1e-12)
    assert summary["reachable"] is True
    assert summary["warnings"] == []
    assert "the curves end below the RMS of the table" in page
    text = " ".join(capsys.readouterr().out.split())
    assert "passive RMS (rad)" in text and f"{passive[0]:.3e}" in text and "x real time" in text


def test_isolation_where_a_parameter_file_says(make_options, ssv, capsys):
    """The target is used as it is given, and the one warning, of the noise, is everywhere, once."""
    target = {"commander.target.roll": 0.1, "disturbance.seed": 7}
    options = make_options("isolation", 0.02, step_s=1e-3, parameters=(ssv(target),))
    summary = run(options)
    assert summary["orientation_deg"] == [pytest.approx(math.degrees(0.1)), 0.0, 0.0]
    assert summary["seed"] == 7
    assert summary["parameters"]["disturbance.noise.band.max"] == pytest.approx(400.0)
    with netCDF4.Dataset(options.output / "results.nc") as file:
        assert file["active"]["plant.orientation.roll"][-1] == pytest.approx(0.1, abs=1e-12)
    (warning,) = summary["warnings"]
    assert warning.startswith("The noise ends at 400 Hz: a step of 0.001 s")
    assert capsys.readouterr().err == f"{warning}\n"
    assert (options.output / "report.html").read_text().count(f"<li>{warning}</li>") == 1


@pytest.mark.parametrize(
    ("given", "locked"),
    [({}, True), ({"tracker.target_attitude.w": 1.0}, False), ({"commander.target.roll": 0.5}, True)],
    ids=["where the payload looks", "as a file gives it", "out of reach"],
)
def test_a_tracker_expects_its_target_where_the_payload_looks(make_options, ssv, given, locked):
    """At a roll of 0.1 rad, and at the nominal orientation where the commander refuses the target."""
    file = ssv({"commander.target.roll": 0.1, "disturbance.noise.enabled": False, **given})
    options = make_options("isolation", 0.6, step_s=1e-3, parameters=(file,))
    options = replace(options, system=SYSTEM.with_name("LineOfSight.ssd"))
    run(options, fmus=7)
    with netCDF4.Dataset(options.output / "results.nc") as stored:
        assert bool(stored["active"]["tracker.locked"][-1]) == locked
        error = stored["active"]["tracker.line_of_sight_error.x"][-1]
    assert abs(error) < 1e-5  # rad; without lock it is 0


def test_the_files_of_a_run_are_read_once(make_options, ssv, monkeypatch):
    read = []

    def count(module, name):
        function = getattr(module, name)
        monkeypatch.setattr(module, name, lambda path: read.append(path.name) or function(path))

    description._read_description.cache_clear()
    count(description, "read_model_description")
    count(setup, "read_parameters")
    run(make_options("isolation", 1e-4, parameters=(ssv({"commander.target.roll": 0.1}),)))
    fmus = ("DisturbanceSource", "FeedforwardIsolator", "ManipulatorPlant", "PointingCommander")
    assert sorted(read) == [*(f"{name}.fmu" for name in fmus), "given.ssv"]


def test_a_system_with_one_more_component(make_options, tmp_path):
    """Its FMU is not among those of the product, so it is taken from where the description says."""
    options = make_options("isolation", 0.02, step_s=1e-3)
    more = (
        '<ssd:Component name="thruster" type="application/x-fmu-sharedlibrary" source="resources/Thruster.fmu"/>'
        "</ssd:Elements>"
    )
    (tmp_path / "other.ssd").write_text(SYSTEM.read_text().replace("</ssd:Elements>", more))
    (tmp_path / "resources").mkdir()
    shutil.copy(options.fmus / "DisturbanceSource.fmu", tmp_path / "resources" / "Thruster.fmu")
    summary = run(replace(options, system=tmp_path / "other.ssd"), fmus=5)
    assert {"name": "Thruster", "sha256": summary["fmus"][0]["sha256"]} in summary["fmus"]
    with netCDF4.Dataset(options.output / "results.nc") as file:
        assert np.abs(file["active"]["thruster.base_force.x"][:]).max() > 0.0


def test_a_target_in_degrees_is_refused_before_the_run(make_options, ssv):
    options = make_options("isolation", 0.02, step_s=1e-3, parameters=(ssv({"commander.target.yaw": 8.5}),))
    text = r"target\.yaw \(.*given\.ssv, line 4\): 8\.5 rad is more than a turn: give radians \(8\.5 deg are 0\.148"
    with pytest.raises(UsageError, match=text):
        run(options)
    assert not (options.output / "results.nc").exists()


def test_isolation_at_an_unreachable_target_says_where_it_was(make_options, ssv, capsys):
    options = make_options("isolation", 0.02, step_s=1e-3, parameters=(ssv({"commander.target.roll": 0.5}),))
    assert re.search(r"The target \(28\.6479, 0, 0\) deg is out of reach", run(options)["failures"])
    assert "passive RMS (rad)" in capsys.readouterr().out
    summary = json.loads((options.output / "summary.json").read_text())
    assert summary["reachable"] is False
    np.testing.assert_allclose(summary["orientation_deg"], 0.0, atol=1e-9)
    assert any("PointingCommander" in text for text in summary["warnings"])
    assert "is out of reach" in (options.output / "report.html").read_text()


def test_isolation_of_one_step_has_no_rejection(make_options, capsys):
    """Nothing has moved: a dash in the table, null in the summary."""
    summary = run(make_options("isolation", 1e-4))
    assert summary["rejection_percent"] == [None] * 3
    table = capsys.readouterr().out
    assert "nan" not in table and table.count("  -\n") == 3


def test_table2(make_options, ssv, monkeypatch):
    """Lead-in, groups and entries; the values need a whole period, and the window says so."""
    # The pictures of an orientation are those of the scenario isolation; here they are most of the time.
    drawn = []
    monkeypatch.setattr("ps_fmu.runs.publish.Painter.begin", lambda _, explored, folder: drawn.append(explored) or list)
    monkeypatch.setattr(table2_runs, "SETTLING_S", 0.0)
    quick = ssv({"disturbance.rise_time": 0.1, "commander.target.yaw": 0.1})
    options = make_options("table2", 0.2, step_s=1e-3, parameters=(quick,), figures=True)
    summary = run(options)
    names = ["roll0_pitch0_yaw0", "roll8.5_pitch0_yaw0", "roll0_pitch-7_yaw0", "roll0_pitch0_yaw14"]
    page = check_files(options, [f"{name}_{case}" for name in names for case in ("passive", "active")], 31)
    assert [still.file for group in drawn[0].charts for still in group.stills] == [
        f"{name}_{what}.png" for name in names for what in ("jitter", "spectra")
    ]
    assert [group.file for group in drawn[0].clouds] == [f"{name}_image_point.png" for name in names]
    assert summary["statistics_from_s"] == pytest.approx(0.1)
    assert summary["statistics_to_s"] == pytest.approx(0.3)
    entries = summary["orientations"]
    assert [tuple(entry["orientation_deg"]) for entry in entries] == list(table2_runs.ORIENTATIONS.values())
    assert summary["rms_passive_rad"] == entries[0]["rms_passive_rad"]
    errors = []
    for entry in entries:
        assert len(entry["drift_passive_rad"]) == len(entry["drift_active_rad"]) == 3
        off = 100.0 * (np.array(entry["rms_passive_rad"]) / entry["published_rms_passive_rad"] - 1.0)
        errors.append(np.abs(entry["passive_against_published_percent"] / off - 1.0).max())
    assert entries[1]["published_rms_active_rad"] == [8.22e-8, 3.49e-8, 1.51e-7]
    verify_claim(
        "paper.table_2_run",
        claim="RMS against the published value, in per cent",
        where="`ps-fmu run table2`: terminal, report, `orientations` of summary.json",
        reference="the ratio of the two by hand, four orientations",
        error=max(errors),
        bound=1e-12,
    )
    assert "axis 3, at (8.5, 0, 0) deg: 97.4 %; 97.31 by the RMS values beside it." in page
    assert "not a whole number of its periods of 100 s" in page
    assert "commander.target.yaw" in " ".join(summary["warnings"])
    assert "Nothing was tuned to it." not in page
    assert "Parameter files set disturbance.rise_time: the runs are of that system" in page


def test_table2_speaks_of_the_second_axis_only_of_the_papers_system(make_options, ssv):
    found = {"nominal": SimpleNamespace(rms_active=np.ones(3))}
    options = make_options("table2", 0.2, step_s=1e-3, parameters=(ssv({"commander.target.yaw": 0.1}),))
    assert table2.describe_second_axis(load_system(options), found).endswith("Nothing was tuned to it.")
    other = ssv({"plant.payload.mass": 1.0, "isolator.delay": 0.02}, "other.ssv")
    said = table2.describe_second_axis(load_system(replace(options, parameters=(other,))), found)
    assert said.startswith("Parameter files set plant.payload.mass and 1 more: ") and "tuned" not in said


def test_table2_with_orientations_out_of_reach(make_options, ssv, monkeypatch, capsys):
    monkeypatch.setattr(table2_runs, "SETTLING_S", 0.0)
    short = {"disturbance.rise_time": 0.1, "commander.coarse_stroke.min": -0.01, "commander.coarse_stroke.max": 0.01}
    options = make_options("table2", 0.2, step_s=1e-3, parameters=(ssv(short),))
    assert re.search(r"The target \(0, -7, 0\) deg is out of reach", run(options)["failures"])
    assert "is out of reach" in " ".join(capsys.readouterr().out.split())
    reachable = [e["reachable"] for e in json.loads((options.output / "summary.json").read_text())["orientations"]]
    assert reachable[0] and not reachable[2]
    assert "is out of reach" in (options.output / "report.html").read_text()


@pytest.mark.parametrize(
    ("duration", "period"),
    [(100.0, 100.0), (20.0, 20.0), (19.9, 100.0), (0.5, 100.0), (2000.0, 1000.0), (1500.0, 750.0)],
)
def test_period_of_the_disturbance(duration, period):
    assert table2_runs.period_s(duration) == period


QUICK_SLEW = {"commander.target.roll": math.radians(0.5), "plant.relinearisation_distance": 1e-3}


def test_momentum_says_how_the_bus_turns_by_a_slew(make_options, ssv, capsys, steps_in_c):
    """What cannot be on target is a finding; its closed form is what the FMUs do.  Requirements alone have verdicts."""
    half_a_degree = {"commander.target.roll": math.radians(0.5)}
    options = make_options("slew", 73.0, step_s=2e-3, parameters=(ssv(half_a_degree),))
    slew = run(options)["slew"]
    assert [(one["what"], one["isolator"], one["met"]) for one in slew["requirements"]] == [
        ("nominal orientation", "off", True),
        ("nominal orientation", "on", True),
        ("relative orientation", "off", True),
    ]
    # With the isolator on the payload follows the bus by a few percent, which the closed form leaves out.
    for case, tolerance in (("isolator_off", 2e-6), ("isolator_on", 5e-4)):
        found = slew["reaction"][case]
        closed, measured = (np.array(found[f"bus_rotation_{name}deg"]) for name in ("closed_form_", ""))
        assert np.linalg.norm(measured) > 1e-4
        np.testing.assert_allclose(measured, closed, rtol=0.0, atol=tolerance * np.linalg.norm(closed))
        assert found["difference_percent"] < 100.0 * tolerance
    on = slew["reaction"]["isolator_on"]
    closed, measured = (np.array(on[f"relative_error_{name}deg"]) for name in ("closed_form_", ""))
    np.testing.assert_allclose(measured, closed, rtol=0.0, atol=1e-3 * np.linalg.norm(closed))
    text = " ".join(capsys.readouterr().out.split())
    assert "Requirements on the slew: 3 of 3 are met" in text and "NOT MET" not in text
    assert "A finding, no requirement" in text and "outer forces" not in text
    assert "NOT MET" not in (options.output / "report.html").read_text()


def test_a_slew_that_is_too_short_says_that_it_cannot_be_said(make_options, ssv, capsys):
    options = make_options("slew", 2.0, step_s=2e-3, parameters=(ssv({"commander.target.roll": 0.01}),))
    run(options)
    assert "Requirements on the slew: 0 of 3 are met, 3 cannot be said" in capsys.readouterr().out


def test_a_slew_under_forces_misses_its_requirement(make_options, ssv, capsys):
    """All is written before the error that makes the exit code, and the finding says what the momentum lacks."""
    values = {**QUICK_SLEW, "disturbance.noise.enabled": True, "disturbance.noise.band.max": 20.0}
    options = make_options("slew", 73.0, step_s=0.02, parameters=(ssv(values),))
    assert re.search(r"1 of 3 requirements of the scenario are not met: relative orientation", run(options)["failures"])
    slew = json.loads((options.output / "summary.json").read_text())["slew"]
    assert [one["met"] for one in slew["requirements"]] == [True, True, False]
    assert "NOT MET" in (options.output / "report.html").read_text()
    text = " ".join(capsys.readouterr().out.split())
    assert "2 of 3 are met" in text and "So outer forces, or a motion before the slew" in text


@pytest.mark.parametrize(
    ("duration_s", "profile_end_s", "text"),
    [(20.0, 11.0, "leaves less than 60 s"), (4.0, None, "the run ends at 4.0000 s, before the profile does")],
)
def test_slew_that_ends_early_is_judged_at_its_end(make_options, ssv, capsys, duration_s, profile_end_s, text):
    options = make_options("slew", duration_s, step_s=0.02, parameters=(ssv(QUICK_SLEW),))
    slew = run(options)["slew"]
    assert slew["settled_60_s"] is False
    assert slew["profile_end_s"] == pytest.approx(profile_end_s, abs=0.05)
    assert slew["judged_s"] == pytest.approx(duration_s)
    assert {one["verdict"] for one in slew["requirements"]} == {"cannot be said"}
    assert bool(slew["reaction"]) == (profile_end_s is not None)
    assert text in " ".join(capsys.readouterr().out.split())


def test_slew_to_where_the_platform_cannot_go(make_options, ssv, capsys):
    options = make_options("slew", 2.0, step_s=0.02, parameters=(ssv({"commander.target.pitch": 0.5}),))
    assert re.search(r"The target \(0, 28\.6479, 0\) deg is out of reach", run(options)["failures"])
    summary = json.loads((options.output / "summary.json").read_text())
    assert summary["slew"]["reachable"] is False
    assert summary["slew"]["profile_end_s"] is None
    assert summary["rms_passive_rad"] is summary["rejection_percent"] is None
    np.testing.assert_allclose(summary["orientation_deg"], 0.0, atol=1e-9)
    text = " ".join(capsys.readouterr().out.split())
    assert "is out of reach" in text and "nan" not in text
    assert "is out of reach" in (options.output / "report.html").read_text()
    assert sum("PointingCommander" in text for text in summary["warnings"]) == 1


def test_slew_needs_time_to_begin(make_options):
    with pytest.raises(OptionError, match=r"--duration: the slew begins at 1 s, got 0\.5 s"):
        run(make_options("slew", 0.5, step_s=0.02))


@pytest.mark.parametrize(
    ("values", "text"),
    [
        ({"plant.payload.mass": 0.0}, r"payload\.mass: must be greater than 0"),
        ({"plant.payload.mass": -1.0}, r"payload\.mass .*given\.ssv, line 4.*-1\.0 is outside \[0\.0, inf\]"),
        ({"plant.payload.weight": 1.0}, r"plant\.payload\.weight .*given\.ssv, line 4.*no such variable"),
        ({"plant.los.x": 1.0}, r"plant\.los\.x.*causality is output"),
    ],
)
def test_parameters_that_no_fmu_takes_are_named(make_options, ssv, values, text):
    options = make_options("isolation", 0.02, step_s=1e-3, parameters=(ssv(values),))
    with pytest.raises(CosimError, match=text):
        run(options)
