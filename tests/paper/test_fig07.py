"""ps-fmu analyse trajectories: Fig 7, and Table 1 through commander and plant."""

import json
from dataclasses import replace

import netCDF4
import numpy as np
import pytest

from ps_fmu.paper.analysis import AnalysisOptions
from ps_fmu.paper.figures import fig07
from ps_fmu.paper.figures.fig07 import scenario as trajectories
from ps_fmu.paper.figures.fig07.analysis import LIMITS, analyse, extremes
from ps_fmu.paper.published import published_numbers

SCENARIO = replace(fig07.SCENARIO, step_s=5e-3)


@pytest.fixture
def short(monkeypatch):
    """The random walk alone, five targets, coarse steps."""
    monkeypatch.setattr(trajectories, "PLANES", {})
    monkeypatch.setattr(trajectories, "COUNTS", (5,))


@pytest.mark.usefixtures("short")
def test_again_into_the_same_folder_after_an_interrupted_run(built_fmus, tmp_path, monkeypatch):
    """Limits and errors are those of the paper, and results.nc has the runs of the last time only."""
    follow, runs = trajectories._follow, []

    def interrupted(system, run, path, method, *others, **more):
        if runs:
            raise KeyboardInterrupt
        runs.append(path)
        return follow(system, run, path, method, *others, **more)

    told = AnalysisOptions(tmp_path, built_fmus, progress=False)
    with monkeypatch.context() as patched, pytest.raises(KeyboardInterrupt):
        patched.setattr(trajectories, "_follow", interrupted)
        analyse(told, SCENARIO)
    result = analyse(told, SCENARIO)
    result.write(tmp_path)
    with netCDF4.Dataset(tmp_path / "trajectories" / "results.nc") as file:
        assert list(file.groups) == [
            "random_walk_trilateration", "random_walk_algorithm_1_1e_06_m", "random_walk_algorithm_1_2e_11_m",
            "limits_trilateration", "beyond_the_limits_trilateration",
        ]  # fmt: skip

    found = {finding.key: finding for finding in result.findings}
    for key in LIMITS:
        assert found[key].cosimulated == pytest.approx(published_numbers()[key].value, abs=1e-4)  # deg
    assert found["text.cone"].cosimulated == pytest.approx(8.9793, abs=1e-4)
    assert 1e-9 < found["fig7.error"].cosimulated < 1e-8
    assert found["fig7.error"].cosimulated == pytest.approx(found["fig7.error"].computed, rel=1e-3)
    assert found["text.error"].difference == "holds"
    content = json.loads((tmp_path / "trajectories.json").read_text())
    assert content["beyond_refused"] == [True] * 6
    assert "2e-11 m: " in content["text"][1]


def test_extremes_are_those_of_the_angles_in_their_order():
    at, beyond = (np.degrees(orientation) for orientation in extremes())
    own = [at[k, k // 2] for k in range(6)]
    assert own == pytest.approx([published_numbers()[key].value for key in LIMITS], abs=1e-4)
    assert beyond - at == pytest.approx(0.01 * np.kron(np.eye(3), [[1.0], [-1.0]]))
