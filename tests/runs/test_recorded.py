"""--disturbance: recorded wrenches from CSV and netCDF, in place of the noise."""

import json
import re
from pathlib import Path

import netCDF4
import numpy as np
import pytest
from support.claims import verify_claim

from ps_fmu.disturbance.recording import HEADER
from ps_fmu.mechanism.parameters import load
from ps_fmu.mechanism.quantities import ParameterError
from ps_fmu.runs.options import OptionError
from ps_fmu.runs.recorded import read_netcdf
from ps_fmu.runs.run import execute
from ps_fmu.runs.setup import load_system

TIME = np.linspace(0.0, 1.0, 101)
WRENCH = np.outer(np.sin(2.0 * np.pi * TIME), np.arange(1.0, 7.0))
STEP = 1e-3  # s
CSV_HEADER = ",".join(HEADER)


@pytest.fixture
def write_netcdf(tmp_path):
    """Writes variables, name to (values, units), over ``time`` into a netCDF file."""

    def write(variables, time=TIME, units="s", form="NETCDF4"):
        path = tmp_path / "recorded.nc"
        with netCDF4.Dataset(path, "w", format=form) as file:
            file.createDimension("time", len(time))
            file.createDimension("axis", 3)
            for name, (values, unit) in {"time": (time, units), **variables}.items():
                dimensions = ("time", "axis")[: np.ndim(values)]
                variable = file.createVariable(name, np.asarray(values).dtype, dimensions)
                if unit is not None:
                    variable.units = unit
                variable[...] = values
        return path

    return write


def vectors(force="N", torque="N.m", factor=1.0):
    return {"force": (factor * WRENCH[:, :3], force), "torque": (factor * WRENCH[:, 3:], torque)}


def components(prefix="", joint="."):
    units = ["N"] * 3 + ["N.m"] * 3
    names = [f"{prefix}{kind}{joint}{axis}" for kind in ("force", "torque") for axis in "xyz"]
    return {name: (WRENCH[:, k], units[k]) for k, name in enumerate(names)}


@pytest.mark.parametrize(
    ("variables", "more"),
    [
        (vectors(), {}),
        (vectors("mN", "mN.m", 1e3), {}),
        (vectors("N", "N m"), {"units": "seconds since 2024-01-01 00:00:00"}),
        (vectors(), {"time": 1e3 * TIME, "units": "milliseconds"}),
        (vectors(), {"form": "NETCDF3_CLASSIC"}),
        (components(), {}),
        (components("base_", "_"), {}),
        ({**components(), "temperature": (TIME, None)}, {}),
    ],
)
def test_a_netcdf_file_in_si(write_netcdf, variables, more):
    found = read_netcdf(write_netcdf(variables, **more))
    np.testing.assert_allclose(found, np.column_stack([TIME, WRENCH]), rtol=1e-12, atol=1e-12)


def replaced(name, values, units):
    return {**vectors(), name: (values, units)}


@pytest.mark.parametrize(
    ("variables", "more", "problem"),
    [
        (replaced("force", WRENCH[:, :3], "kg"), {}, "variable 'force': cannot convert the units 'kg' to N"),
        (replaced("torque", WRENCH[:, 3:], None), {}, "variable 'torque': has no attribute units; expected N.m"),
        ({"force": (WRENCH[:, :3], "N")}, {}, "variable 'torque.x': no such variable, nor torque_x or base_torque.x"),
        (vectors(), {"units": "m"}, "variable 'time': cannot convert the units 'm' to s"),
        (vectors(), {"time": np.r_[TIME[:50], TIME[49], TIME[51:]]}, "0.49 s, its value 51, does not come after 0.49"),
        (replaced("force", np.where(WRENCH[:, :3] > 2.0, np.nan, 1.0), "N"), {}, "'force': value 13 is missing or not"),
        (replaced("force", WRENCH[:, 0], "N"), {}, r"'force': expected the shape \(101, 3\), got \(101,\)"),
    ],
)  # fmt: skip
def test_netcdf_files_that_cannot_be_used(write_netcdf, variables, more, problem):
    with pytest.raises(ParameterError, match=problem) as refusal:
        read_netcdf(write_netcdf(variables, **more))
    assert "recorded.nc, variable" in str(refusal.value)


def write_csv(folder: Path, header=CSV_HEADER, rows=None):
    path = folder / "recorded.csv"
    rows = np.column_stack([TIME, WRENCH]) if rows is None else rows
    np.savetxt(path, rows, fmt="%.17g", delimiter=",", header=header, comments="")
    return path


def run(options):
    """Runs the scenario; what the disturbance did in the active run, (rows, 6), and summary.json."""
    execute(options)
    names = [f"disturbance.base_{kind}.{axis}" for kind in ("force", "torque") for axis in "xyz"]
    with netCDF4.Dataset(options.output / "results.nc") as file:
        found = np.column_stack([file["active"][name][:] for name in names])
    return found, json.loads((options.output / "summary.json").read_text())


def test_csv_and_netcdf_act_alike_and_the_noise_does_not(make_options, write_netcdf, tmp_path):
    more = {"step_s": STEP, "storage_step_s": STEP}
    by_csv, summary = run(make_options("isolation", 0.1, disturbance=write_csv(tmp_path), **more))
    options = make_options("isolation", 0.1, disturbance=write_netcdf(vectors()), **more)
    by_netcdf, other = run(options)
    np.testing.assert_array_equal(by_csv, by_netcdf)
    rows = np.arange(0, 101, 10)
    np.testing.assert_allclose(by_csv[rows], WRENCH[: len(rows)], rtol=1e-9, atol=1e-12)
    assert summary["parameters"]["disturbance.noise.enabled"] is False
    assert summary["parameters"]["disturbance.recording.path"] == str(tmp_path / "recorded.csv")
    assert other["parameters"]["disturbance.recording.path"] == str(options.output / "disturbance.csv")


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        ({"header": CSV_HEADER.replace("force.y [N]", "force.y [kN]")}, "recorded.csv, line 1: column 'force.y"),
        ({"rows": np.column_stack([TIME[::-1], WRENCH])}, "recorded.csv, line 3: the time 0.99 s does not come"),
        ({"rows": np.column_stack([TIME + 5.0, WRENCH])}, r"holds 5 to 6 s, the run lasts from 0 to 0.1 s"),
    ],
)  # fmt: skip
def test_csv_files_that_cannot_be_used(make_options, tmp_path, change, problem):
    options = make_options("isolation", 0.1, step_s=STEP, disturbance=write_csv(tmp_path, **change))
    with pytest.raises(OptionError, match=problem) as refusal:
        load_system(options)
    assert str(refusal.value).startswith("--disturbance: ")


def test_a_file_that_is_not_there_and_one_that_is_set_twice(make_options, ssv, tmp_path):
    with pytest.raises(OptionError, match="--disturbance: there is no file"):
        make_options("isolation", 0.1, disturbance=tmp_path / "missing.csv")
    twice = ssv({"disturbance.recording.path": "other.csv"})
    options = make_options("isolation", 0.1, step_s=STEP, disturbance=write_csv(tmp_path), parameters=(twice,))
    with pytest.raises(OptionError, match=r"given\.ssv, line 4 sets disturbance\.recording\.path, too"):
        load_system(options)


def list_warnings(make_options, ssv, tmp_path, rows, duration=10.0, **recording):
    values = ssv({f"disturbance.recording.{name}": value for name, value in {"detrend": False, **recording}.items()})
    path = write_csv(tmp_path, rows=rows)
    options = make_options("isolation", duration, step_s=STEP, disturbance=path, parameters=(values,))
    return [text for text in load_system(options).warnings.texts if text.startswith("disturbance.recording")]


def test_the_drift_that_a_recording_makes_is_said(make_options, ssv, tmp_path):
    """A push of 1 N at the centre of mass of bus and payload for 1 s: impulse J = 1 N.s, drift J (t - 0.5 s) / m."""
    p = load()
    mass = p.bus.mass + p.payload.mass
    time = np.array([0.0, 1e-9, 1.0, 1.0 + 1e-9, 2.0])
    place_B = p.manipulator.nominal_translation_B + p.payload.com_P
    centre_B = (p.bus.mass * p.bus.com_B + p.payload.mass * place_B) / mass
    push = np.array([0.0, 1.0, 0.0])
    wrench = np.concatenate([push, np.cross(centre_B, push)])
    (text,) = list_warnings(make_options, ssv, tmp_path, np.column_stack([time, np.outer([0, 1, 1, 0, 0], wrench)]))
    numbers = re.search(r"a mean momentum of ([\d.]+) N s .* and ([\d.]+) N s and .* drifts by ([\d.]+) mm and", text)
    assert [float(number) for number in numbers.groups()] == pytest.approx([0.95, 1.0, 9.5e3 / mass], rel=0.01)
    assert "disturbance.recording.detrend = true takes the drift out" in text
    verify_claim(
        "warning.drift_of_a_recording",
        claim="disturbance.recording: ... it drifts by ... mm",
        where="`ps-fmu run --disturbance`, studies: terminal, report, `warnings` of summary.json",
        reference="J (t - t_0) / m of bus and payload, by hand",
        error=abs(float(numbers[3]) * mass / 9.5e3 - 1.0),
        bound=0.01,
    )
    assert list_warnings(make_options, ssv, tmp_path, np.column_stack([time, np.outer([0, 1, 1, 0, 0], wrench)]),
                         detrend=True, fade_in=0.5) == []  # fmt: skip


def test_the_jump_where_a_recording_begins_again_is_said(make_options, ssv, tmp_path):
    time = np.linspace(0.0, 4.0, 401)
    slow = np.outer(np.sin(2.0 * np.pi * 0.3 * time), [0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
    rows = np.column_stack([time, slow])
    texts = list_warnings(make_options, ssv, tmp_path, rows, repeat=True, detrend=True)
    assert len(texts) == 1
    assert "recorded.csv jumps by 951 mN and 0 N m each time it begins again, every 4 s" in texts[0]  # sin(2.4 pi)
    assert list_warnings(make_options, ssv, tmp_path, rows, repeat=True, detrend=True, overlap=1.0) == []
    assert list_warnings(make_options, ssv, tmp_path, rows, duration=3.0, repeat=True, detrend=True) == []


@pytest.mark.parametrize("name", ["stability", "table2"])
def test_a_scenario_with_a_disturbance_of_its_own_takes_no_other(make_options, tmp_path, name):
    """Its poles, or its comparison with the paper, would be those of something else."""
    options = make_options(name, 4.0, disturbance=write_csv(tmp_path))
    with pytest.raises(OptionError, match=f"--disturbance: the scenario {name} has a disturbance of its own"):
        execute(options)


def test_a_parameter_file_switches_the_noise_on_again(make_options, ssv, tmp_path):
    noisy = ssv({"disturbance.noise.enabled": True})
    options = make_options("isolation", 0.1, disturbance=write_csv(tmp_path), parameters=(noisy,))
    assert load_system(options).get_start("disturbance.noise.enabled") is True
