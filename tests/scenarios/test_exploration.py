"""What reports of runs let their readers explore, from the real FMUs."""

import base64
import json
import re
from copy import copy
from dataclasses import replace

import netCDF4
import numpy as np
import pytest
from support.reports import VERDICTS

from ps_fmu.mechanism.parameters import load
from ps_fmu.paper.figures.table2 import scenario as table2
from ps_fmu.runs.execute import execute
from ps_fmu.runs.setup import load_system
from ps_fmu.scenarios import isolation
from ps_fmu.scenarios.exploration import MOTION, read_geometry, read_motion, show_mechanism

LARGEST_BYTES = 5e6


def read_data(options):
    page = (options.output / "report.html").read_text(encoding="utf-8")
    assert len(page.encode()) < LARGEST_BYTES
    return json.loads(re.search(r'<script type="application/json" id="data">(.*?)</script>', page)[1])


def decode(text):
    return np.frombuffer(base64.b64decode(text), "<f4")


def stored(options, group, name):
    with netCDF4.Dataset(options.output / "results.nc") as file:
        return np.asarray(file[group][name])


def test_the_report_of_isolation_shows_what_was_stored(make_options):
    options = make_options("isolation", 0.5, step_s=1e-3)
    execute(options)
    data = read_data(options)
    histories, spectra = data["groups"]
    assert [chart["title"] for chart in histories["charts"]] == [f"payload rotation {axis}" for axis in "xyz"]
    for chart, axis in zip(histories["charts"], "xyz", strict=True):
        for curve in chart["curves"]:
            rows = stored(options, curve["label"], f"plant.payload_rotation.{axis}")
            np.testing.assert_allclose(decode(curve["low"]), rows, rtol=1e-6)
            np.testing.assert_allclose(decode(curve["high"]), rows, rtol=1e-6)
    assert histories["axis"]["count"] == 501 and histories["axis"]["step"] == pytest.approx(1e-3)
    assert spectra["axis"]["logarithmic"] and len(spectra["charts"]) == 6
    assert [cloud["colour"] for cloud in data["clouds"][0]["clouds"]] == ["passive", "active"]
    for cloud in data["clouds"][0]["clouds"]:  # as the axes beside it
        assert re.fullmatch(r"\w+: RMS radius \d{1,3}(\.\d+)? [µnp]m", cloud["label"]), cloud["label"]
    for motion, case in zip(data["mechanism"]["motions"], ("passive", "active"), strict=True):
        assert motion["label"] == case
        for name, quantity in (("payloadRotation", "payload_rotation"), ("basePosition", "base_position")):
            rows = [stored(options, case, f"plant.{quantity}.{axis}") for axis in "xyz"]
            np.testing.assert_allclose(decode(motion[name]).reshape(-1, 3).T, rows, rtol=1e-6)


def test_the_report_of_table2_shows_all_orientations_and_the_mechanism_at_the_first(make_options, monkeypatch):
    orientations = {"nominal": (0.0, 0.0, 0.0), "yaw": (0.0, 0.0, 14.0)}
    monkeypatch.setattr(table2, "ORIENTATIONS", orientations)
    monkeypatch.setattr(table2, "SETTLING_S", 0.0)
    options = make_options("table2", 0.5, step_s=1e-3, storage_step_s=1e-3)
    execute(options)
    data = read_data(options)
    assert not list(options.output.glob("*.png"))
    page = (options.output / "report.html").read_text(encoding="utf-8")
    for place in ("(0, 0, 0)", "(0, 0, 14)"):
        assert f"{place} deg: Rotation of the payload by vibration" in page
        assert f"{place} deg: Image point of the boresight" in page
    for k, yaw in enumerate((0, 14)):
        (passive, _) = data["groups"][2 * k]["charts"][2]["curves"]
        rows = stored(options, f"roll0_pitch0_yaw{yaw}_passive", "plant.payload_rotation.z")
        ends = decode(passive["low"]).min(), decode(passive["high"]).max()  # bins of several rows but for the first
        np.testing.assert_allclose(ends, (rows.min(), rows.max()), rtol=1e-6)
    assert len(data["groups"]) == 4 and len(data["clouds"]) == 2
    assert [len(motion["nominalOrientation"]) > 0 for motion in data["mechanism"]["motions"]] == [True, True]


def test_the_cumulative_rms_ends_at_that_of_the_spectrum(make_options):
    options = make_options("isolation", 0.5, step_s=1e-3)
    execute(options)
    _, spectra = read_data(options)["groups"]
    for density, below in zip(spectra["charts"][:3], spectra["charts"][3:], strict=True):
        step = spectra["axis"]["step"]  # so short a run has a band for each frequency
        for psd, rms in zip(density["curves"], below["curves"], strict=True):
            total = np.sqrt(np.nansum(decode(psd["low"])[1:].astype(float)) * step + decode(rms["low"])[0] ** 2)
            assert decode(rms["low"])[-1] == pytest.approx(total, rel=1e-5)


def test_the_geometry_is_that_of_the_plants_parameters(make_options, ssv):
    changed = ssv({"plant.fine_leg_2.base_joint.x": -0.25})
    geometry = read_geometry(load_system(make_options("isolation", 0.02, step_s=1e-3, parameters=(changed,))))
    expected = np.array(load().manipulator.geometry.base_joints_B)
    expected[4, 0] = -0.25
    np.testing.assert_allclose(geometry.base_joints_B, expected, rtol=1e-12)
    np.testing.assert_allclose(geometry.platform_joints_P, load().manipulator.geometry.platform_joints_P, rtol=1e-12)


def test_another_plant_without_the_joints_is_not_drawn(make_options, tmp_path):
    system = load_system(make_options("isolation", 0.02, step_s=1e-3))
    plant = system.descriptions["plant"] = copy(system.descriptions["plant"])  # others keep the one that was read
    plant.modelVariables = [each for each in plant.modelVariables if each.name != "fine_leg_3.platform_joint.z"]
    assert show_mechanism(system, tmp_path / "none.nc", [("passive", "passive")]) is None


def test_a_slew_is_played_along_its_nominal_pose(make_options, ssv):
    quick = ssv({"commander.target.roll": 0.008, "plant.relinearisation_distance": 1e-3})
    options = make_options("slew", 20.0, step_s=0.02, parameters=(quick,))
    execute(options)
    data = read_data(options)
    assert [len(group["charts"]) for group in data["groups"]] == [9, 6]
    motion = data["mechanism"]["motions"][1]
    assert motion["label"] == "isolator on"
    roll = decode(motion["nominalOrientation"]).reshape(-1, 3)[:, 0]
    assert (roll[0], roll[-1]) == (0.0, pytest.approx(0.008, rel=1e-5))
    platform = [stored(options, "isolator_on", f"commander.platform_position.{axis}") for axis in "xyz"]
    found = decode(motion["nominalPosition"]).reshape(-1, 3)
    np.testing.assert_allclose(found[-1], np.array(platform)[:, -1], atol=1e-6)
    np.testing.assert_allclose(found[0], load().manipulator.geometry.nominal_translation_B, atol=1e-7)


def test_the_verdicts_of_a_scenario_head_its_report(make_options, monkeypatch):
    find = isolation.find
    monkeypatch.setattr(isolation, "find", lambda run: replace(find(run), verdicts=VERDICTS))
    options = make_options("isolation", 1e-3)
    assert re.search(r"1 of \d requirements of the scenario are not met", execute(options).failures)
    page = (options.output / "report.html").read_text(encoding="utf-8")
    assert 0 < page.index("NOT MET") < page.index("Four FMUs in co-simulation")


def test_motion_of_a_long_run_is_read_in_parts(tmp_path, monkeypatch):
    monkeypatch.setattr("ps_fmu.scenarios.exploration.READ_ROWS", 7000)
    values = np.random.default_rng(2).normal(0.0, 1.0, (len(MOTION), 16_000))
    with netCDF4.Dataset(tmp_path / "results.nc", "w") as file:
        group = file.createGroup("run")
        group.createDimension("time", None)
        for name, column in zip(("time", *MOTION), (1e-3 * np.arange(16_000), *values), strict=True):
            variable = group.createVariable(name, "f8", ("time",))
            variable.units, variable[:] = "1", column
    with netCDF4.Dataset(tmp_path / "results.nc") as file:
        motion = read_motion(file["run"])
    np.testing.assert_allclose(motion.values, values.reshape(len(MOTION), 4000, 4).mean(axis=2), rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(motion.time, 4e-3 * np.arange(4000))


def test_an_explored_run_too_short_for_a_spectrum_has_none(make_options):
    options = make_options("isolation", 3e-4)
    execute(options)
    assert len(read_data(options)["groups"]) == 1
