"""Fig 7 through commander and plant."""

import json

import numpy as np
import pytest

from ps_fmu.paper.figures.fig07 import scenario as trajectories
from ps_fmu.runs.comparison import TargetError
from ps_fmu.runs.options import OptionError


def test_platform_points_where_it_is_told_to(make_options, capsys, monkeypatch):
    """Closed form to rounding; Algorithm 1 as its error limit allows, 1e-6 m 4e-4 deg, 2e-11 m 9e-9 deg.

    One plane and the walk.
    """
    monkeypatch.setattr(trajectories, "PLANES", {"roll-pitch": (0, 1)})
    options = make_options("trajectories", 44.0, step_s=5e-3)
    trajectories.run(options)
    summary = json.loads((options.output / "summary.json").read_text())
    found = {(path["path"], path["inverse_kinematics"]): path for path in summary["paths"]}
    assert len(found) == 6
    limits = {"trilateration": 1e-11, "Algorithm 1, 1e-06 m": 1e-3, "Algorithm 1, 2e-11 m": 1e-8}
    residuals = {"trilateration": 1e-12, "Algorithm 1, 1e-06 m": 1e-6, "Algorithm 1, 2e-11 m": 2e-11}
    for (path, method), result in found.items():
        targets, response = (np.array(result[key]) for key in ("targets_deg", "response_deg"))
        assert targets.shape == response.shape and len(targets) >= 5
        assert np.abs(response - targets).max() == pytest.approx(result["largest_error_deg"], rel=1e-6, abs=1e-15)
        assert np.ptp(targets, axis=0).max() > 3.0
        assert result["largest_error_deg"] < limits[method], path
        assert result["largest_residual_m"] < residuals[method]
    assert found["roll-pitch", "Algorithm 1, 2e-11 m"]["largest_error_deg"] > 1e-9
    assert "Algorithm 1 stops at an error of 1e-06 m" in capsys.readouterr().out
    assert len(list(options.output.glob("trajectory_*.png"))) == 2


def test_targets_out_of_reach_are_counted(make_options, ssv, capsys, monkeypatch):
    monkeypatch.setattr(trajectories, "PLANES", {"roll-pitch": (0, 1)})
    monkeypatch.setattr(trajectories, "path_figure", lambda file, results: file.touch())
    short = ssv({"commander.coarse_stroke.min": -0.005, "commander.coarse_stroke.max": 0.005})
    options = make_options("trajectories", 44.0, step_s=0.05, parameters=(short,))
    with pytest.raises(TargetError, match=r"roll-pitch, trilateration: \d+ of \d+ targets are out of reach"):
        trajectories.run(options)
    assert "targets are out of reach" in capsys.readouterr().out
    for path in json.loads((options.output / "summary.json").read_text())["paths"]:
        error = np.abs(np.subtract(path["response_deg"], path["targets_deg"])).max(axis=1)
        assert 0 < path["refused"] == np.count_nonzero(error > 0.1)


def test_too_short_a_run_says_what_a_path_takes(make_options):
    with pytest.raises(OptionError, match=r"--duration: the path roll-pitch takes \d+\.\d s at least, got 2 s"):
        trajectories.run(make_options("trajectories", 2.0, step_s=5e-3))
