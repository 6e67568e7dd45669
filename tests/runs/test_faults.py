"""Faults in runs: the options, what summary.json, the file of results, the terminal, report and figures say of them."""

import json
from pathlib import Path

import netCDF4
import numpy as np
import pytest
from matplotlib import image
from pythonfmu.builder import FmuBuilder
from support.cosim import OSCILLATOR, ssd_text

from ps_fmu import simulate
from ps_fmu.cli import main
from ps_fmu.cosim.faults.binding import ActedFault
from ps_fmu.runs.cases import Case, Outcome
from ps_fmu.runs.publish import tabulate_faults

TOYS = Path(__file__).parents[1] / "cosim" / "toys"
FREEZE = {"time": 0.01, "model": "plant", "variable": "base_acceleration.z", "action": "freeze", "duration": 0.01}
TEXT = "0.010 s: plant.base_acceleration.z frozen until 0.020 s"


def write(folder, *events, **more):
    path = folder / "faults.json"
    path.write_text(json.dumps({"events": events, **more}))
    return path


@pytest.fixture(scope="module")
def toys(tmp_path_factory):
    folder = tmp_path_factory.mktemp("toys") / "resources"
    folder.mkdir()
    for name in ("mass", "spring"):
        FmuBuilder.build_FMU(TOYS / f"toy_{name}.py", dest=folder)
    return folder


@pytest.fixture
def oscillator(toys):
    path = toys.parent / "oscillator.ssd"
    path.write_text(ssd_text(*OSCILLATOR))
    return path


def run(*arguments):
    return main(["run", *map(str, arguments)])


def test_a_run_of_any_system_says_what_acted_and_marks_it(oscillator, tmp_path, capsys):
    frozen = {"time": 0.2, "model": "mass", "variable": "position", "action": "freeze", "duration": 0.3}
    path = write(tmp_path, frozen, {**frozen, "model": "mass", "variable": "mass", "time": 0.4})
    options = oscillator, "--step", "0.01", "--duration", "1"
    assert run(*options, "--faults", path, "--output", tmp_path / "out") == 0
    assert run(*options, "--output", tmp_path / "plain") == 0
    texts = [
        "0.200 s: mass.position frozen until 0.500 s", "0.400 s: mass.mass frozen until 0.700 s",
    ]  # fmt: skip
    printed = capsys.readouterr().out
    assert all(text in printed for text in texts) and printed.count("Faults\n") == 1
    summary, plain = (json.loads((tmp_path / name / "summary.json").read_text()) for name in ("out", "plain"))
    assert [entry["text"] for entry in summary["faults"]["acted"]["run"]] == texts
    assert summary["faults"]["file"] == "faults.json"
    assert "faults" not in plain
    with netCDF4.Dataset(tmp_path / "out" / "results.nc") as file:
        group = file["run"]
        assert group.faults == "; ".join(texts)
        position, got = (np.array(group[name][:]) for name in ("mass.position", "spring.position"))
    assert np.all(got[21:51] == position[20]) and np.all(got[1:21] == position[:20])
    shaded, white = (image.imread(tmp_path / name / "plot.png") for name in ("out", "plain"))
    colour = np.array([0.95, 0.87, 0.91])  # of FAULT with a share of 25 %

    def count(picture):
        return np.all(np.abs(picture[..., :3] - colour) < 0.03, axis=-1).sum()

    assert count(shaded) > 10_000 and count(white) < 100


@pytest.mark.parametrize(
    ("event", "more", "code", "text"),
    [
        ({"model": "maas"}, (), 1, r"faults.json: events[0]: model: there is no component 'maas' in the system"),
        ({"action": "stick"}, (), 1, r"faults.json: events[0].action: expected one of override"),
        ({"time": 1.0}, (), 1, "time: expected a time before the end of the run, 1 s after its start, got 1 s"),
        ({}, ("--faults", "none.json"), 2, "--faults: there is no file none.json"),
    ],
)
def test_what_cannot_be_done_ends_the_run_before_it_begins(oscillator, tmp_path, capsys, event, more, code, text):
    path = write(tmp_path, {"time": 0.2, "model": "mass", "variable": "position", "action": "freeze", **event})
    options = oscillator, "--step", "0.01", "--duration", "1", "--output", tmp_path / "out"
    try:
        found = run(*options, "--faults", path, *more)
    except SystemExit as end:
        found = end.code
    assert found == code
    assert text in capsys.readouterr().err
    assert not (tmp_path / "out" / "results.nc").exists()


def test_faults_and_options_of_schemes(oscillator, tmp_path, capsys):
    path = write(tmp_path, {"time": 0.2, "model": "mass", "variable": "position", "action": "override", "value": 0.25})
    scheme = "--scheme", "gauss-seidel", "--extrapolate", "linear", "--rate", "mass=1/2"
    options = "--step", "0.01", "--duration", "0.5", "--no-figures", "--faults", path, "--output", tmp_path / "out"
    assert run(oscillator, *scheme, *options) == 0
    assert "0.200 s: mass.position replaced by 0.25" in capsys.readouterr().out
    with netCDF4.Dataset(tmp_path / "out" / "results.nc") as file:
        assert set(file["run"]["spring.position"][21:]) == {0.25}


def test_a_scenario_with_faults(tmp_path, built_fmus):
    faults = write(tmp_path, FREEZE)
    options = {"duration": 0.05, "progress": False, "storage_step": 1e-4}
    result, plain = simulate("isolation", faults=faults, **options), simulate("isolation", **options)
    assert TEXT in result.text and "passive, active" in result.text
    assert "Faults" not in plain.text and "faults" not in plain.summary
    found = result.summary["faults"]
    assert [entry["text"] for entry in found["acted"]["active"]] == [TEXT]
    assert found["acted"]["active"][0]["inputs"] == ["isolator.base_acceleration.z"]
    assert TEXT in result.report().read_text() and TEXT not in plain.report().read_text()
    assert result.summary["parameters"]["faults"] == "faults.json"
    with netCDF4.Dataset(result.report().with_name("results.nc")) as file:
        group = file["active"]
        assert group.faults == TEXT
        sent, got = (np.array(group[f"{name}.base_acceleration.z"][:]) for name in ("plant", "isolator"))
    assert len(set(got[101:201])) == 1 and got[101] == sent[100]
    assert np.array_equal(got[202:], sent[201:-1]) and np.array_equal(got[1:101], sent[:100])


def test_a_pattern_may_name_what_an_input_got(tmp_path, built_fmus):
    options = {"duration": 0.02, "progress": False, "observe": "isolator.base_*"}
    result = simulate("isolation", faults=write(tmp_path, {**FREEZE, "duration": 0.005}), **options)
    with netCDF4.Dataset(result.report().with_name("results.nc")) as file:
        assert set(file["active"].variables) == {"time", "isolator.base_acceleration.z"}


def test_spans_are_those_of_the_run_and_overlapping_ones_are_one():
    def acted(first, last, text="x"):
        return ActedFault(first, last, "a.y", "freeze", (), text)

    faults = [acted(5.0, None), acted(1.0, 2.0), acted(1.5, 3.0), acted(3.0, 3.5), acted(8.0, 20.0)]
    assert Outcome(Case("run"), 10.0, 1.0, tuple(faults)).find_spans() == [(1.0, 3.5), (5.0, 10.0)]
    later = acted(23.0, 25.0), acted(28.0, None)
    assert Outcome(Case("run"), 10.0, 1.0, later, begin_s=20.0).find_spans() == [(3.0, 5.0), (8.0, 10.0)]
    table = tabulate_faults({"passive": faults[:1], "active": [acted(1.0, 2.0, "y"), faults[0]]})
    assert table.rows == [("x", "passive, active"), ("y", "active")]
    assert tabulate_faults({"run": []}).rows == [("none has acted", "run")]
