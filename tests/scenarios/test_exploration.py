"""What reports of runs let their readers explore, from the real FMUs."""

import base64
import json
import re
from copy import copy
from dataclasses import replace
from types import SimpleNamespace

import netCDF4
import numpy as np
import pytest
from scipy.signal import welch
from support.claims import verify_claim
from support.reports import VERDICTS

from ps_fmu.cosim import Column, Recorder
from ps_fmu.mechanism.parameters import load
from ps_fmu.paper.figures.table2 import runs as table2_runs
from ps_fmu.runs.run import execute
from ps_fmu.runs.setup import load_system
from ps_fmu.runs.stored_rows import MOTION, KeptRows, watch_motion
from ps_fmu.scenarios import isolation
from ps_fmu.scenarios import pointing_report as pointing
from ps_fmu.scenarios.exploration import (
    FEWEST_ROWS,
    chart_settled,
    read_geometry,
    read_motion,
    shorten_name,
    show_mechanism,
)  # fmt: skip

LARGEST_BYTES = 5e6
STEP, LINE_HZ, AMPLITUDE = 0.01, 5.0, 1e-6
NAMES = ("x", "y")
TIME = STEP * np.arange(4096)


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
    histories, spectra = data["charts"]
    assert [chart["title"] for chart in histories["charts"]] == [f"payload rotation {axis}" for axis in "xyz"]
    for chart, axis in zip(histories["charts"], "xyz", strict=True):
        for curve in chart["curves"]:
            rows = stored(options, curve["label"], f"plant.payload_rotation.{axis}")
            np.testing.assert_allclose(decode(curve["low"]), rows, rtol=1e-6)
            np.testing.assert_allclose(decode(curve["high"]), rows, rtol=1e-6)
    assert histories["axis"]["count"] == 501 and histories["axis"]["step"] == pytest.approx(1e-3)
    assert spectra["axis"]["logarithmic"] and len(spectra["charts"]) == 6
    assert [cloud["colour"] for cloud in data["clouds"][0]["clouds"]] == ["passive", "active"]
    off = []
    for cloud in data["clouds"][0]["clouds"]:
        case, number, prefix = re.fullmatch(r"(\w+): RMS radius (\d{1,3}(?:\.\d+)?) ([µnp])m", cloud["label"]).groups()
        los = np.array([stored(options, case, f"plant.los.{axis}") for axis in "xy"])
        radius = np.sqrt(((los - los.mean(axis=1, keepdims=True)) ** 2).sum(axis=0).mean())
        off.append(abs(float(number) * {"µ": 1e-6, "n": 1e-9, "p": 1e-12}[prefix] / radius - 1.0))
    verify_claim(
        "spectrum.image_radius",
        claim="RMS radius of the image points, to three digits",
        where="report of `ps-fmu run isolation`, `wheels`, `table2`: image point",
        reference="distances from their mean by hand, on the stored rows",
        error=max(off),
        bound=0.005,
    )
    off = []
    for motion, case in zip(data["mechanism"]["motions"], ("passive", "active"), strict=True):
        assert motion["label"] == case
        for name, quantity in (("payloadRotation", "payload_rotation"), ("basePosition", "base_position")):
            rows = np.array([stored(options, case, f"plant.{quantity}.{axis}") for axis in "xyz"])
            off.append(np.abs(decode(motion[name]).reshape(-1, 3).T - rows).max() / np.abs(rows).max())
    verify_claim(
        "spectrum.motion",
        claim="The mechanism in motion: rotation of the payload, position of the bus",
        where="report of `ps-fmu run`: player",
        reference="stored rows of the same run",
        error=off,
        bound=1e-6,
        unit="of the largest value",
    )


def test_the_report_of_table2_shows_all_orientations_and_the_mechanism_at_the_first(make_options, monkeypatch):
    orientations = {"nominal": (0.0, 0.0, 0.0), "yaw": (0.0, 0.0, 14.0)}
    monkeypatch.setattr(table2_runs, "ORIENTATIONS", orientations)
    monkeypatch.setattr(table2_runs, "SETTLING_S", 0.0)
    options = make_options("table2", 0.5, step_s=1e-3, storage_step_s=1e-3)
    execute(options)
    data = read_data(options)
    assert not list(options.output.glob("*.png"))
    page = (options.output / "report.html").read_text(encoding="utf-8")
    for place in ("(0, 0, 0)", "(0, 0, 14)"):
        assert f"Rotation of the payload by vibration, axes of P, at {place} deg" in page
        assert f"Image point of the boresight at {place} deg" in page
    for k, yaw in enumerate((0, 14)):
        (passive, _) = data["charts"][2 * k]["charts"][2]["curves"]
        rows = stored(options, f"roll0_pitch0_yaw{yaw}_passive", "plant.payload_rotation.z")
        ends = decode(passive["low"]).min(), decode(passive["high"]).max()  # bins of several rows but for the first
        np.testing.assert_allclose(ends, (rows.min(), rows.max()), rtol=1e-6)
    assert len(data["charts"]) == 4 and len(data["clouds"]) == 2
    assert [len(motion["nominalOrientation"]) > 0 for motion in data["mechanism"]["motions"]] == [True, True]


def test_the_spectra_of_the_page_are_those_of_scipy(make_options):
    """All curves of PSD and RMS below a frequency, from the page, against scipy.signal.welch of the stored rows."""
    step = 2.5e-4
    options = make_options("isolation", 3.0, step_s=step, storage_step_s=step)
    execute(options)
    _, spectra = read_data(options)["charts"]
    shown = decode(spectra["axis"]["values"]).astype(float)
    page = (options.output / "report.html").read_text(encoding="utf-8")
    length = 2**12  # rows of a segment: the largest power of two of which two are no longer than the run
    assert f"Welch, segments of {length * step:.3g} s, averaged over a 2000th of a decade" in page
    worst, merged = 0.0, 0
    for place, axis in enumerate("xyz"):
        for number, case in enumerate(("passive", "active")):
            rows = stored(options, case, f"plant.payload_rotation.{axis}")
            frequency, psd = welch(rows, 1.0 / step, nperseg=length, detrend="constant")
            below = np.interp(shown, frequency, np.sqrt(np.cumsum(psd) * frequency[1]))
            band = np.floor(2000.0 * np.log10(frequency[1:]) + 1e-9)
            means = [psd[1:][band == one].mean() for one in np.unique(band)][: len(shown)]
            merged = len(frequency) - 1 - len(np.unique(band))
            for chart, truth in ((place, np.array(means)), (3 + place, below)):
                curve = decode(spectra["charts"][chart]["curves"][number]["low"]).astype(float)
                worst = max(worst, np.nanmax(np.abs(curve / truth - 1.0)))
                assert np.isfinite(curve).sum() > 0.9 * len(shown)
    assert merged > 100
    verify_claim(
        "spectrum.page",
        claim="Power spectral density of the payload's rotation, and its RMS below each frequency: 12 curves",
        where="report of `ps-fmu run isolation`, `wheels`, `table2`",
        reference="scipy.signal.welch, and sums of its bins, on all rows of results.nc",
        error=worst,
        bound=1e-6,
    )


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
    assert show_mechanism(system, [("passive", "passive")]) is None


def test_a_slew_is_played_along_its_nominal_pose(make_options, ssv):
    quick = ssv({"commander.target.roll": 0.008, "plant.relinearisation_distance": 1e-3})
    options = make_options("slew", 20.0, step_s=0.02, parameters=(quick,))
    execute(options)
    data = read_data(options)
    assert [len(group["charts"]) for group in data["charts"]] == [12, 6]
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
    assert 0 < page.index("NOT MET") < page.index("FMUs in co-simulation: ")


@pytest.mark.parametrize("kept", [False, True])
def test_motion_of_a_long_run_is_averaged(tmp_path, make_options, kept):
    """In parts as they are stored in a file, or of rows in memory."""
    time, values = 1e-3 * np.arange(16_000), np.random.default_rng(2).normal(0.0, 1.0, (16_000, len(MOTION)))
    columns = [Column(name, "1", "Real", "") for name in MOTION]
    system = replace(load_system(make_options("isolation", 0.02, step_s=1e-3)), kept=KeptRows() if kept else None)
    if kept:
        recorder = system.kept.record("run", columns, 1e-3, 1e-3, MOTION, {})
    else:
        recorder = Recorder(tmp_path / "results.nc", "run", columns=columns, step=1e-3)
        recorder.watching.append(system.motions.setdefault("run", watch_motion(recorder.columns)))
    with recorder:
        for part in np.split(np.arange(16_000), [7000, 9000]):
            recorder.block(part[0], time[part], values[part])
    motion = read_motion(system, "run")
    expected = values.reshape(4000, 4, len(MOTION)).mean(axis=1)
    np.testing.assert_allclose(motion.values.T, expected, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(motion.time, 4e-3 * np.arange(4000))
    assert watch_motion(columns[1:]) is None


def test_an_explored_run_too_short_for_a_spectrum_has_none(make_options):
    options = make_options("isolation", 3e-4)
    execute(options)
    assert len(read_data(options)["charts"]) == 1


def test_names_are_shown_in_words():
    assert shorten_name("plant.payload_rotation.x") == "payload rotation x"


def shake(drift=0.0):
    """Rows (n, 2) with a line, and a drift that is no part of the spectrum."""
    line = AMPLITUDE * np.sin(2.0 * np.pi * LINE_HZ * TIME) + drift * TIME
    return np.column_stack([line, 0.5 * line])


def test_a_line_and_its_rms_without_the_drift():
    cases = (("off", "passive", shake(1e-6)), ("on", "active", 0.1 * shake()))
    (group,) = chart_settled("error", NAMES, (10.0, 50.0), cases, STEP)
    assert group.title == "Spectra of the settled part: error" and "From 10 to 50 s" in group.caption
    assert [chart.title for chart in group.charts] == [
        "x, PSD", "y, PSD", "x, RMS below frequency", "y, RMS below frequency",
    ]  # fmt: skip
    errors = []
    for chart, scale in zip(group.charts, (1.0, 0.5, 1.0, 0.5), strict=True):
        off, on = chart.curves
        if chart.title.endswith("PSD"):
            assert group.axis.values[np.nanargmax(off.low)] == pytest.approx(LINE_HZ, rel=0.02)
            continue
        rms = scale * AMPLITUDE / np.sqrt(2.0)
        errors += [off.low[-1] / rms - 1.0, on.low[-1] / (0.1 * rms) - 1.0]
    verify_claim(
        "spectrum.settled",
        claim="Spectra of the settled part: lines and their RMS, without the drift",
        where="report of `ps-fmu run slew`, `pointing`",
        reference="a sine of known amplitude beside a drift of twenty times as much",
        error=np.abs(errors),
        bound=0.02,
    )


def test_what_the_rows_have_filtered_away_is_not_drawn():
    (group,) = chart_settled("error", NAMES, (0.0, 41.0), [("on", "active", shake())], STEP, highest_hz=8.0)
    assert group.axis.values[-1] <= 8.0
    assert "filtered to 8 Hz" in group.caption


@pytest.mark.parametrize("values", [np.zeros((100, 2)), shake()[: FEWEST_ROWS - 1]])
def test_what_is_at_rest_or_too_short_has_no_spectrum(values):
    assert chart_settled("error", NAMES, (0.0, 1.0), [("on", "active", values)], STEP) == []


def test_the_pointing_error_is_taken_while_the_loop_is_locked():
    """The rows of the phase, and no others; without that phase there is no spectrum."""
    quiet = shake()
    late = TIME >= 20.0
    record = SimpleNamespace(
        time=TIME,
        error=np.column_stack([np.where(late, value, 1.0) for value in (*quiet.T, quiet[:, 0])]),
        span=lambda first, last: (first <= TIME) & (last > TIME),
        phases=lambda: {"locked": (20.0, 40.0)},
    )
    (group,) = pointing._chart_settled(SimpleNamespace(off=record, on=record))
    assert group.title == "Spectra of the settled part: error while the loop is locked, axes of P"
    assert len(group.charts) == 6
    assert group.charts[3].curves[0].low[-1] == pytest.approx(AMPLITUDE / np.sqrt(2.0), rel=0.02)
    record.phases = dict
    assert pointing._chart_settled(SimpleNamespace(off=record, on=record)) == []
