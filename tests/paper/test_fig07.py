"""Fig 7, and Table 1 through commander and plant: ``ps-fmu analyse trajectories``, its scenario, its paths."""

import json
import re
from dataclasses import replace

import netCDF4
import numpy as np
import pytest
from support.claims import verify_claim

from ps_fmu.analyses.table import AnalysisOptions
from ps_fmu.mechanism.inverse_kinematics import inverse_kinematics, reachable
from ps_fmu.mechanism.parameters import load
from ps_fmu.paper.figures.fig07 import report as trajectories
from ps_fmu.paper.figures.fig07 import runs
from ps_fmu.paper.figures.fig07.report import LIMITS, analyse, explore_paths, extremes
from ps_fmu.paper.figures.fig07.runs import PLANES, quadrilateral, random_walk
from ps_fmu.paper.published import published_numbers
from ps_fmu.runs.options import OptionError
from ps_fmu.runs.run import execute
from ps_fmu.runs.scenario import SCENARIOS

GEOMETRY = load().manipulator.geometry


def test_the_platform_points_at_its_targets(built_fmus, tmp_path, monkeypatch):
    """Closed form to rounding; Algorithm 1 as its error limit allows, 1e-6 m 4e-4 deg, 2e-11 m 9e-9 deg.

    One plane and the walk, five targets each, in coarse steps; then the limits of Table 1.
    """
    monkeypatch.setattr(runs, "PLANES", {"roll-pitch": (0, 1)})
    monkeypatch.setattr(runs, "COUNTS", (5,))
    options = AnalysisOptions(tmp_path, built_fmus, progress=False)
    result = analyse(options, replace(SCENARIOS["trajectories"], step_s=5e-3))
    result.write(tmp_path)
    content = json.loads((tmp_path / "trajectories.json").read_text())
    limits = {"trilateration": 1e-11, "Algorithm 1, 1e-06 m": 1e-3, "Algorithm 1, 2e-11 m": 1e-8}  # deg
    residuals = {"trilateration": 1e-12, "Algorithm 1, 1e-06 m": 1e-6, "Algorithm 1, 2e-11 m": 2e-11}  # m
    rows = content["tables"][0]["rows"]
    assert len(rows) == 6
    off = []
    for path, method, targets, _, error, residual in rows:
        assert targets == "5" and float(error) < limits[method] and float(residual) <= residuals[method]
        off.append(content["largest_error_deg"][f"{path}, {method}"] / limits[method])
    verify_claim(
        "paper.trajectories",
        claim="Largest error along a path, by solver",
        where="`ps-fmu analyse trajectories`: terminal, report, trajectories.json",
        reference="target against orientation of the plant: 1e-11 deg in closed form, 1e-3 and 1e-8 by Algorithm 1",
        error=off,
        bound=1.0,
        unit="of what the solver's error limit allows",
    )
    assert content["largest_error_deg"]["roll-pitch, Algorithm 1, 2e-11 m"] > 1e-9
    verify_claim(
        "run.out_of_reach",
        claim="The target is out of reach: the platform stayed where it was",
        where="`ps-fmu run`, `analyse trajectories`: terminal, report, `reachable` of summary.json",
        reference="six targets within and six beyond the limits of Table 1, through the commander",
        error=content["beyond_refused"].count(False) + abs(len(content["beyond_refused"]) - 6),
        bound=0,
        unit="targets",
    )
    assert "Algorithm 1 stops at an error of 1e-06 m" in content["text"][1] and "2e-11 m: " in content["text"][1]
    assert [picture.path.stat().st_size > 20_000 for picture in result.pictures] == [True] * 2

    found = {finding.key: finding for finding in result.findings}
    verify_claim(
        "paper.limits",
        claim="Limits of roll, pitch and yaw that the FMUs reach",
        where="`ps-fmu analyse trajectories`, `workspace`: terminal, report",
        reference="Table 1 of the paper; plant and commander are driven there",
        error=[abs(found[key].cosimulated - published_numbers()[key].value) for key in LIMITS],
        bound=1e-4,
        unit="deg",
    )
    assert found["text.cone"].cosimulated == pytest.approx(8.9793, abs=1e-4)
    assert 1e-9 < found["fig7.error"].cosimulated < 1e-8
    assert found["fig7.error"].cosimulated == pytest.approx(found["fig7.error"].computed, rel=1e-3)
    assert found["text.error"].difference == "holds"


def test_extremes_are_those_of_the_angles_in_their_order():
    at, beyond = (np.degrees(orientation) for orientation in extremes())
    own = [at[k, k // 2] for k in range(6)]
    assert own == pytest.approx([published_numbers()[key].value for key in LIMITS], abs=1e-4)
    assert beyond - at == pytest.approx(0.01 * np.kron(np.eye(3), [[1.0], [-1.0]]))


def test_targets_out_of_reach_are_counted(make_options, ssv, capsys, monkeypatch):
    monkeypatch.setattr(runs, "PLANES", {"roll-pitch": (0, 1)})
    monkeypatch.setattr(trajectories, "path_pictures", lambda folder, results: [])
    explored = []
    keep = explored.extend  # returns None
    monkeypatch.setattr(trajectories, "explore_paths", lambda results: keep(results) or explore_paths(results))
    short = ssv({"commander.coarse_stroke.min": -0.005, "commander.coarse_stroke.max": 0.005})
    options = make_options("trajectories", 44.0, step_s=0.05, parameters=(short,))
    assert re.search(r"roll-pitch, trilateration: \d+ of \d+ targets are out of reach", execute(options).failures)
    assert "targets are out of reach" in " ".join(capsys.readouterr().out.split())
    with netCDF4.Dataset(options.output / "results.nc") as file:
        assert list(file.groups) == ["parameters", *options.scenario.find_cases()]
    for path in json.loads((options.output / "summary.json").read_text())["paths"]:
        error = np.abs(np.subtract(path["response_deg"], path["targets_deg"])).max(axis=1)
        assert 0 < path["refused"] == np.count_nonzero(error > 0.1)
    for result in explored:
        assert len(result.time) == len(result.held) == len(result.motion)
        last = np.flatnonzero(np.abs(np.diff(result.held, axis=0)).max(axis=1) > 0.0)  # before the next target
        np.testing.assert_array_equal(result.held[[*last, -1]], result.target)
        assert np.abs(result.motion[last] - result.response[:-1]).max() < 1e-4  # rad: nearly at rest
    assert "Path: random walk" in (options.output / "report.html").read_text()


def test_too_short_a_run_says_what_a_path_takes(make_options):
    with pytest.raises(OptionError, match=r"--duration: the path roll-pitch takes \d+\.\d s at least, got 2 s"):
        execute(make_options("trajectories", 2.0, step_s=5e-3))


@pytest.mark.parametrize("plane", PLANES)
def test_quadrilaterals_are_closed_within_reach_and_go_to_the_edge(plane):
    path = quadrilateral(GEOMETRY, plane, 201)
    pose = inverse_kinematics(GEOMETRY, path)
    assert reachable(GEOMETRY, pose).all()
    assert (0.02 - np.abs(pose.coarse_displacement)).min() < 1e-3  # m, of 20
    assert np.array_equal(path[0], path[-1])
    (third,) = set(range(3)) - set(PLANES[plane])
    assert not path[:, third].any()
    corners = path[[0, 50, 100, 150]]
    assert np.abs(corners).max(axis=0)[list(PLANES[plane])].min() > np.radians(4.0)


def test_random_walk_stays_within_reach_and_depends_on_the_seed_alone():
    path = random_walk(GEOMETRY, 60, seed=3)
    assert reachable(GEOMETRY, inverse_kinematics(GEOMETRY, path)).all()
    assert np.array_equal(path, random_walk(GEOMETRY, 60, seed=3))
    assert not np.array_equal(path, random_walk(GEOMETRY, 60, seed=4))
    assert np.degrees(np.ptp(path, axis=0)).min() > 3.0
