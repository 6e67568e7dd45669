"""Every number of summary.json against its definition, written out by hand on the rows of results.nc.

What a scenario adds to summary.json has to have a definition here: the keys are compared, too.
"""

import json
import math
import re
from itertools import pairwise

import numpy as np
import pytest
import xarray as xr
from scipy.spatial.transform import Rotation
from support.claims import verify_claim

from ps_fmu.runs.run import execute
from ps_fmu.scenarios import pointing as pointing_scenario

INPUTS = {
    "scenario", "orientation_deg", "target_deg", "step_s", "duration_s", "seed", "fmus", "versions", "parameters",
    "warnings",
}  # fmt: skip
"""What was run, and with what: said, not found."""
WALL = {"real_time_factor"}
AXES, ANGLES = "xyz", ("roll", "pitch", "yaw")
ROTATION = tuple(f"plant.payload_rotation.{axis}" for axis in AXES)
LOS = ("plant.los.x", "plant.los.y")
STATED = {0.6827: 0.95, 0.95: 0.95, 0.9973: 0.95}  # probabilities of quantiles, and their confidence


def run(options):
    """Runs the scenario with every step stored; summary.json, rows of a case as a function, what the terminal shows."""
    execute(options)
    summary = json.loads((options.output / "summary.json").read_text())

    def rows(case, *names):
        with xr.open_dataset(options.output / "results.nc", group=case) as group:
            assert (
                "filter" not in group.attrs and len(group.time) == round(group.attrs["duration_s"] / options.step_s) + 1
            )
            return np.array([group[name].values for name in names], dtype=float)

    return summary, rows


def flatten(entry, path=""):
    """Numbers and texts of an entry by their paths."""
    if isinstance(entry, dict):
        return {name: value for key, one in entry.items() for name, value in flatten(one, f"{path}/{key}").items()}
    if isinstance(entry, list) and entry and isinstance(entry[0], dict):
        return {name: value for k, one in enumerate(entry) for name, value in flatten(one, f"{path}/{k}").items()}
    return {path: entry}


def compare(found, expected, atol=0.0):
    """The largest relative error of all numbers; fails if keys differ, or a text."""
    found, expected = flatten(found), flatten(expected)
    assert found.keys() == expected.keys()
    worst = 0.0
    for path, truth in expected.items():
        if isinstance(truth, str | bool) or truth is None:
            assert found[path] == truth, path
            continue
        ours, theirs = np.asarray(found[path], dtype=float), np.asarray(truth, dtype=float)
        assert ours.shape == theirs.shape, path
        scale = np.abs(theirs).max() or 1.0
        worst = max(worst, float(np.abs(ours - theirs).max() - atol) / scale)
    return worst


def rms(values):
    return np.sqrt((values**2).mean(axis=-1))


def drift(values):
    """Mean of the second half less that of the first, each under 1 - cos(2 pi t / T); its ends have no weight."""
    half = (values.shape[-1] - 1) // 2
    weight = 1.0 - np.cos(2.0 * np.pi * np.arange(1, half) / half)
    first, second = (values[:, k * half + 1 : (k + 1) * half] @ weight / weight.sum() for k in (0, 1))
    return second - first


def list_windows(values, width):
    """The errors of APE, MPE, RPE and PDE of a signal, window by window."""
    windows = [values[k : k + width] for k in range(0, len(values) - width + 1, width)]
    means = [window.mean() for window in windows]
    relative = np.concatenate([window - mean for window, mean in zip(windows, means, strict=True)])
    changes = [later - earlier for earlier, later in pairwise(means)]
    return {"APE": values, "MPE": np.array(means), "RPE": relative, "PDE": np.array(changes)}


WINDOW_S, APART_S, SETTLING_S = 0.1, 0.25, 0.5
REQUIRED = {
    "APE": "", "MPE": "", "RPE uniform": 'at = "uniform"', "RPE end": 'at = "end"', "smear": "", "jitter": "",
    **dict.fromkeys(("PDE", "PRE"), f'separation = "{APART_S} s"'),
}  # fmt: skip
UNITS = {"urad": 1e-6, "arcsec": math.radians(1.0 / 3600.0), "mas": math.radians(1.0 / 3.6e6), "deg": math.radians(1.0)}


def write_requirements(path):
    """Each index and statistic, of each axis and of the magnitude, with limits in turn in each unit."""
    entries = []
    for kind, more in REQUIRED.items():
        for statistic in ("rms", "peak", "quantile"):
            for combine in ("each", "norm"):
                unit = list(UNITS)[len(entries) % len(UNITS)]
                keys = [
                    f'name = "{len(entries)}"', 'signal = "plant.payload_rotation"', f'index = "{kind.split()[0]}"',
                    f'statistic = "{statistic}"', f'combine = "{combine}"', f'settling = "{SETTLING_S} s"', more,
                    f'limit = "{0.5e-6 / UNITS[unit]!r} {unit}"', "" if kind == "APE" else f'window = "{WINDOW_S} s"',
                    "" if statistic == "peak" else "confidence = 0.8",
                    'probability = 0.7\ninterpretation = "temporal"' if statistic == "quantile" else "",
                ]  # fmt: skip
                entries.append("[[requirement]]\n" + "\n".join(keys))
    path.write_text("\n\n".join(entries))
    return path


def find_errors(kind, record, step):
    """The errors that an index is of, (n, signals), window after window, by its definition."""
    width, apart = round(WINDOW_S / step), round(APART_S / step)
    if kind == "APE":
        return record
    later = apart if kind in ("PDE", "PRE") else 0
    time = np.arange(width) - 0.5 * (width - 1.0)
    found = []
    for first in range(0, len(record) - later - width + 1, width):
        window, other = record[first : first + width], record[first + later : first + later + width]
        mean, slope = window.mean(axis=0), time @ window / (time @ time)
        found.append({
            "MPE": mean[None], "RPE uniform": window - mean, "RPE end": window[-1:] - mean,
            "PDE": (other.mean(axis=0) - mean)[None], "PRE": (other.mean(axis=0) - mean)[None],
            "smear": (slope * time.std())[None], "jitter": window - mean - np.outer(time, slope),
        }[kind])  # fmt: skip
    return np.concatenate(found)


def test_isolation(make_options, tmp_path, capsys):
    step, duration_s = 5e-4, 4.0
    required = write_requirements(tmp_path / "required.toml")
    options = make_options("isolation", duration_s, step_s=step, storage_step_s=step, seed=5, requirements=required)
    summary, rows = run(options)
    expected = {"reachable": True}
    each = {case: rows(case, *ROTATION) for case in ("passive", "active")}
    for case, rotation in each.items():
        los = rows(case, *LOS)
        away = los - los.mean(axis=1, keepdims=True)
        expected |= {
            f"rms_{case}_rad": rms(rotation),
            f"mean_{case}_rad": rotation.mean(axis=1),
            f"peak_{case}_rad": np.abs(rotation).max(axis=1),
            f"drift_{case}_rad": drift(rotation),
            f"image_rms_radius_{case}_m": float(np.sqrt((away**2).sum(axis=0).mean())),
        }
    rejection = 100.0 * (1.0 - rms(each["active"]) / rms(each["passive"]))
    (saturated,) = rows("active", "isolator.saturated")
    expected |= {"rejection_percent": rejection, "saturated_fraction": float(saturated.mean())}
    found = {key: summary[key] for key in summary.keys() - INPUTS - WALL - {"indices", "verdicts", "stability"}}
    verify_claim(
        "run.isolation",
        claim="RMS, mean, peak, drift, rejection, radius of the image point, share of time at the force limit",
        where="`ps-fmu run isolation`, `wheels`, `table2`: terminal, report and summary.json",
        reference="their definitions by hand, on all rows of results.nc",
        error=compare(found, expected),
        bound=1e-9,
    )
    printed = capsys.readouterr().out
    shown = np.array([line.split()[-3:] for line in printed.splitlines()[3:6]], dtype=float).T
    urad = 1e6 * np.array([rms(each["passive"]), rms(each["active"])])  # the unit of the requirements
    digits = 5.001 * 10.0 ** (np.floor(np.log10(urad)) - 4.0)  # half of the last of four
    verify_claim(
        "run.isolation_table",
        claim="The table of RMS values and rejections, to the digits that it shows",
        where="`ps-fmu run isolation`: terminal and report",
        reference="RMS by hand on all rows of results.nc",
        error=np.abs(shown - [*urad, rejection]) / [*digits, np.full(3, 5.001e-3)],
        bound=1.0,
        unit="half units of the last digit shown",
    )
    worst, rounded, counts = 0.0, 0.0, []
    for case in ("passive", "active"):
        for name, signal in summary["indices"][case].items():
            assert signal["unit"] == ("rad" if name in ROTATION else "m")
            (values,) = rows(case, name)
            for symbol, error in list_windows(values, round(1.0 / step)).items():
                entry = signal[symbol]
                magnitude = np.sort(np.abs(error))
                truth = {"rms": rms(error), "peak": magnitude[-1]}
                counts.append(entry["values"] - len(error))
                worst = max(worst, *(abs(entry[key] / value - 1.0) for key, value in truth.items()))
                worst = max(worst, abs(entry["bias"] - error.mean()) / magnitude[-1])
                for stated, (probability, confidence) in zip(entry["quantiles"], STATED.items(), strict=True):
                    assert (stated["probability"], stated["confidence"]) == (probability, confidence)
                    exact = magnitude[math.ceil(probability * len(magnitude)) - 1]
                    rounded = max(rounded, stated["value"] / exact - 1.0)
                    assert stated["value"] >= exact * (1.0 - 1e-12)
    assert not any(counts) and len(counts) == 2 * 5 * 4
    verify_claim(
        "index.of_a_run",
        claim="Bias, RMS and peak of APE, MPE, RPE and PDE of each run, and how many values they are of",
        where="`ps-fmu run`: table of indices of the report, `indices` of summary.json, `result.indices()`",
        reference="definitions of ECSS-E-ST-60-10C window by window on all rows of results.nc: 40 indices",
        error=worst,
        bound=1e-9,
    )
    verify_claim(
        "index.quantiles_of_a_run",
        claim="Quantiles of 68.27, 95 and 99.73 % of the magnitude: never below the values' own, above by rounding",
        where="`ps-fmu run`: table of indices of the report, `indices` of summary.json",
        reference="the ranked values of all rows",
        error=rounded,
        bound=0.0012,
    )
    record = each["active"].T[round(SETTLING_S / step) :]
    verdicts = iter(summary["verdicts"])
    off, rounded, margins = [], [], []
    for kind in REQUIRED:
        error = find_errors(kind, record, step)
        for statistic in ("rms", "peak", "quantile"):
            for values in (*np.abs(error.T), np.sqrt((error**2).sum(axis=1))):
                found = next(verdicts)
                unit = UNITS[found["unit"]]
                truth = {
                    "rms": rms(values),
                    "peak": values.max(),
                    "quantile": np.sort(values)[math.ceil(0.7 * len(values)) - 1],
                }
                (rounded if statistic == "quantile" else off).append(found["value"] * unit / truth[statistic] - 1.0)
                if found["bound"] is not None:
                    margins.append(found["margin"] - 100.0 * (1.0 - found["bound"] / found["limit"]))
                    assert found["met"] == (found["bound"] <= found["limit"]) == (found["verdict"] == "met")
                    assert found["bound"] >= found["value"] * (1.0 - 1e-12)
    assert next(verdicts, None) is None and len(off) == 64 and len(margins) > 60
    assert min(rounded) > -1e-12
    verify_claim(
        "requirement.values",
        claim="Value of a requirement: RMS and peak of each index, each axis and the magnitude, in any unit",
        where="`ps-fmu run`, `judge`, `sweep`: table of verdicts, report, `verdicts` of summary.json",
        reference="definitions of the seven indices by hand on all rows of results.nc: 64 values",
        error=np.abs(off),
        bound=1e-9,
    )
    verify_claim(
        "requirement.quantiles",
        claim="Value of a requirement: quantile of the magnitude, rounded up",
        where="`ps-fmu run`, `judge`, `sweep`: table of verdicts, report, `verdicts` of summary.json",
        reference="ranked values of each index by hand: 32 values",
        error=rounded,
        bound=0.0012,
    )
    verify_claim(
        "requirement.margin",
        claim="Margin, and met where the bound is not above the limit",
        where="`ps-fmu run`, `judge`, `sweep`: table of verdicts, report, `verdicts` of summary.json",
        reference="100 (1 - bound / limit)",
        error=np.abs(margins),
        bound=1e-9,
        unit="per cent",
    )


def test_slew(make_options, ssv):
    """0.5 deg in 10 s.  The platform arrives, the bus keeps no momentum, the fine legs make up for its rotation."""
    step = 0.02
    given = {"commander.target.roll": math.radians(0.5), "plant.relinearisation_distance": 1e-3}
    options = make_options("slew", 73.0, step_s=step, storage_step_s=step, parameters=(ssv(given),), figures=True)
    summary, rows = run(options)
    pictures = len(list(options.output.glob("*.png")))
    assert pictures == 2 and (options.output / "report.html").read_text().count("<img ") == pictures
    (warning,) = summary["warnings"]  # so long steps; it grows by 2.4e-3 1/s
    assert warning.startswith("Case isolator_on: the closed loop is unstable") and "(0.002369 Hz" in warning
    assert "-0 rad/s" not in warning
    assert summary["orientation_deg"] == [0.5, 0.0, 0.0]
    slew = summary["slew"]
    goal = np.array([0.5, 0.0, 0.0])
    moving = rows("isolator_on", "commander.moving")[0] > 0.5
    last = np.flatnonzero(moving)[-1]
    judged = last + round(60.0 / step)
    after = np.arange(len(moving)) > last
    expected = {
        "target_deg": goal, "reachable": True, "target_changed_s": 1.0, "profile_end_s": last * step,
        "judged_s": judged * step, "settled_60_s": True,
    }  # fmt: skip
    errors = {}
    for case in ("isolator_off", "isolator_on"):
        names = {
            "nominal": [f"plant.orientation.{k}" for k in ANGLES],
            "relative": [f"plant.relative_orientation.{k}" for k in ANGLES],
            "payload": ROTATION, "fine": [f"plant.fine_displacement_{k}" for k in (1, 2, 3)],
            "force": [f"isolator.fine_force_{k}" for k in (1, 2, 3)],
            **{f"base_{kind}": [f"plant.base_{kind}.{k}" for k in AXES]
               for kind in ("rotation", "angular_velocity", "angular_acceleration", "acceleration")},
        }  # fmt: skip
        of = {key: rows(case, *columns) for key, columns in names.items()}
        at = {key: values[:, judged] for key, values in of.items()}
        peak = {key: np.abs(values[:, moving | after]).max(axis=1) for key, values in of.items()}

        def turn(small_B, nominal=at["nominal"]):
            """What a small rotation in B adds to roll, pitch and yaw."""
            turned = Rotation.from_rotvec(small_B) * Rotation.from_euler("ZYX", nominal[::-1])
            return np.degrees(turned.as_euler("ZYX")[::-1] - nominal)

        bus = turn(at["base_rotation"])
        jitter = turn(Rotation.from_euler("ZYX", at["nominal"][::-1]).apply(at["payload"]))
        fine = np.degrees(at["relative"] - at["nominal"])
        still = of["payload"][:, after]
        errors[case] = {key: np.degrees(at[key]) - goal for key in ("nominal", "relative")}
        expected[case] = {
            "nominal_error_deg": errors[case]["nominal"], "relative_error_deg": errors[case]["relative"],
            "relative_less_nominal_deg": fine, "bus_rotation_as_orientation_deg": bus,
            "payload_rotation_as_orientation_deg": jitter, "left_over_deg": slew[case]["left_over_deg"],
            "bus_rotation_peak_rad": peak["base_rotation"], "bus_rotation_final_rad": at["base_rotation"],
            "bus_angular_velocity_peak_rad_per_s": peak["base_angular_velocity"],
            "bus_angular_acceleration_peak_rad_per_s2": peak["base_angular_acceleration"],
            "bus_acceleration_peak_m_per_s2": peak["base_acceleration"],
            "payload_rotation_rms_rad": rms(of["payload"][:, moving]),
            "payload_rotation_peak_rad": np.abs(of["payload"][:, moving]).max(axis=1),
            "payload_rotation_after_mean_rad": still.mean(axis=1),
            "payload_rotation_after_rms_about_mean_rad": still.std(axis=1),
            "fine_displacement_peak_m": peak["fine"], "fine_force_peak_N": peak["force"],
        }  # fmt: skip
        np.testing.assert_allclose(slew[case]["left_over_deg"], fine + bus - jitter, atol=1e-5 * np.abs(bus).max())
    assert expected["profile_end_s"] == pytest.approx(11.0, abs=0.05)
    assert np.abs(errors["isolator_on"]["relative"]).max() > 1e-5
    held = [("nominal", "isolator_off"), ("nominal", "isolator_on"), ("relative", "isolator_off")]
    expected["requirements"] = [
        {
            "what": f"{what} orientation", "isolator": case.removeprefix("isolator_"),
            "error_deg": np.abs(errors[case][what]).max(), "limit_deg": 1e-8, "verdict": "met", "met": True,
        }
        for what, case in held
    ]  # fmt: skip
    off, on = (expected[case]["payload_rotation_rms_rad"] for case in ("isolator_off", "isolator_on"))
    top = {"rms_passive_rad": off, "rms_active_rad": on, "rejection_percent": 100.0 * (1.0 - on / off)}
    assert compare({key: summary[key] for key in top}, top) < 1e-9
    assert summary.keys() == top.keys() | INPUTS - {"target_deg"} | WALL | {"slew", "indices", "stability"}
    reaction = slew.pop("reaction")
    verify_claim(
        "slew.numbers",
        claim="Orientation less target, what the fine legs add, reaction of the bus, rotation of the payload, forces",
        where="`ps-fmu run slew`: terminal, report, `slew` of summary.json",
        reference="definitions by hand on all rows of results.nc; rotations by scipy's Rotation",
        error=compare(slew, expected, atol=1e-12),
        bound=1e-5,
    )
    for case, found in reaction.items():
        bus, closed = (np.array(found[f"bus_rotation_{name}deg"]) for name in ("", "closed_form_"))
        np.testing.assert_allclose(bus, slew[case]["bus_rotation_as_orientation_deg"], rtol=1e-12)
        np.testing.assert_allclose(found["relative_error_deg"], slew[case]["relative_error_deg"], rtol=1e-12)
        payload = np.array(slew[case]["payload_rotation_as_orientation_deg"])
        np.testing.assert_allclose(found["relative_error_closed_form_deg"], payload - closed, rtol=1e-9, atol=1e-18)
        off = 100.0 * np.linalg.norm(bus - closed) / np.linalg.norm(closed)
        assert found["difference_percent"] == pytest.approx(off, rel=1e-9)


def test_pointing(make_options, ssv, capsys, monkeypatch, steps_in_c):
    monkeypatch.setattr(pointing_scenario, "measure_loop", lambda *args: {})  # tests/system/test_line_of_sight.py
    step, duration_s = 1e-2, 33.0
    given = ssv({"commander.target.roll": 0.005, "commander.target.pitch": -0.004, "commander.min_duration": 3.0})
    options = make_options("pointing", duration_s, step_s=step, storage_step_s=step, parameters=(given,), figures=True)
    summary, rows = run(options)
    assert sorted(path.name for path in options.output.glob("*.png")) == [
        "pointing_error.png", "pointing_loop.png", "pointing_split.png",
    ]  # fmt: skip
    found = summary["pointing"]
    assert {summary.pop(key) for key in ("rms_passive_rad", "rms_active_rad", "rejection_percent")} == {None}
    assert summary.keys() == INPUTS - {"target_deg"} | WALL | {"pointing", "indices", "stability"}
    margins = found.pop("margins")
    for key in ("loop_margins", "unstable_poles_rad_s"):  # tests/theory
        found.pop(key, None)
    assert [one["axis"] for one in margins] == list(AXES)  # tests/theory/test_line_of_sight.py
    assert all(one["gain_db"] > 6.0 and one["phase_deg"] > 30.0 for one in margins)
    time = np.arange(round(duration_s / step) + 1) * step
    target = Rotation.from_euler("ZYX", [0.0, -0.004, 0.005])
    hidden = [22.0, 27.0]  # 5 s from two thirds of the run on
    phases, expected = {}, {}
    for case in ("loop_off", "loop_on"):
        moving = np.flatnonzero(rows(case, "commander.moving")[0] > 0.5)
        locked = (rows(case, "tracker.locked")[0] > 0.5) & (time > 1.5)
        locks = time[np.flatnonzero(np.diff(locked.astype(int)) > 0) + 1]
        arrival = time[moving[-1] + 1]
        attitude = rows(case, *(f"plant.payload_attitude.{k}" for k in "xyzw")).T
        error = (Rotation.from_quat(attitude).inv() * target).as_rotvec()
        telescope = rows(case, "plant.line_of_sight.x", "plant.line_of_sight.y", *ROTATION[:2]).T
        error[:, :2] -= telescope[:, :2] - telescope[:, 2:]
        spans = {
            "arrived, before lock": (arrival, locks[0]), "locked": (max(locks[0], arrival) + 5.0, hidden[0]),
            "target hidden": hidden, "locked again": (locks[locks >= hidden[1]][0] + 5.0, duration_s),
        }  # fmt: skip
        phases[case] = {}
        for name, (first, last) in spans.items():
            inside = (time >= first) & (time < last)
            if inside.any():
                phases[case][name] = {
                    "from_s": first, "to_s": last, "rms_rad": rms(error[inside].T),
                    "mean_rad": error[inside].mean(axis=0),
                    "largest_distance_rad": np.hypot(*error[inside, :2].T).max(),
                }  # fmt: skip
        expected |= {"arrival_s": arrival, "locks_s": locks}
    noise = np.array([5e-7, 5e-7, 5e-6])  # rad, of the default tracker
    below = all((phases["loop_on"][name]["rms_rad"][:2] < noise[:2]).all() for name in ("locked", "locked again"))
    expected |= {
        "target_deg": np.degrees([0.005, -0.004, 0.0]), "target_changed_s": 1.0, "hidden_s": hidden,
        "noise_equivalent_angle_rad": noise, "split_hz": 0.02,
        "below_noise": bool(below), **phases,
    }  # fmt: skip
    verify_claim(
        "sensor.pointing_phases",
        claim="When motion ends and the tracker locks; RMS, mean and largest distance from the target of each phase",
        where="`ps-fmu run pointing`: terminal, report, `pointing` of summary.json",
        reference="true attitude in results.nc against the target by scipy's Rotation, phase by phase",
        error=compare(found, expected),
        bound=1e-5,
    )
    text = " ".join(capsys.readouterr().out.split())
    said = dict(re.findall(r"(lock at|grows to|lock again at) ([\d.e+-]+)", text))
    on = phases["loop_on"]
    truth = {"lock at": locks[0], "grows to": on["target hidden"]["largest_distance_rad"], "lock again at": locks[1]}
    assert {key: float(value) for key, value in said.items()} == {
        key: pytest.approx(value, rel=0.05) for key, value in truth.items()
    }
    assert "Least margins" in text
    for phase in ("locked", "locked again"):  # the loop takes what the slew leaves
        off, on = (np.abs(phases[case][phase]["mean_rad"][:2]).max() for case in ("loop_off", "loop_on"))
        assert on < 0.1 * off
    assert f"after the loss of lock: {'met' if below else 'NOT met'}" in text
