"""What stands in the way of a co-simulation is said before anything is built or written."""

from pathlib import Path

import pytest

from ps_fmu.analyse_command import find_analyses
from ps_fmu.cli import main
from ps_fmu.paper import cosimulation
from ps_fmu.paper.analysis import AnalysisOptions
from ps_fmu.paper.figures import table2
from ps_fmu.runs.options import OptionError
from ps_fmu.slavekit.pack import build

CHECKOUT = Path(__file__).parents[2]
CO_SIMULATED = [name for name, analysis in find_analyses().items() if analysis.needs_fmus]


@pytest.fixture
def no_build(monkeypatch):
    """Building the FMUs fails the test."""
    monkeypatch.setattr(cosimulation, "ensure_built", lambda folder, root: pytest.fail("FMUs were built"))


@pytest.mark.parametrize("name", CO_SIMULATED)
def test_from_another_folder_a_hint_and_nothing_left_behind(name, no_build, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["analyse", name]) != 0
    said = capsys.readouterr().err
    system = find_analyses()[name].system
    assert f"there is no system description {system}" in said
    assert f"work in {CHECKOUT}, or give --system {CHECKOUT / system}" in said
    assert not list(tmp_path.iterdir())


def test_without_the_sources_of_the_fmus(no_build, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(build, "PACKAGE", tmp_path / "site-packages" / "src" / "ps_fmu")
    assert main(["analyse", "trajectories"]) != 0
    assert "the FMUs' sources" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_an_output_that_cannot_be_used_is_said_before_fmus_are_built(no_build, tmp_path):
    (tmp_path / "table2").write_text("")
    options = AnalysisOptions(tmp_path, tmp_path / "fmus", CHECKOUT / "system" / "SystemStructure.ssd", progress=False)
    refused = pytest.raises(OptionError, match="--output: cannot write in")
    with refused, cosimulation.hold_run(options, table2.SCENARIO):
        pass


def test_runs_of_an_interrupted_analysis_are_not_among_those_of_the_next(tmp_path, monkeypatch):
    monkeypatch.setattr(cosimulation, "ensure_built", lambda folder, root: [])
    options = AnalysisOptions(tmp_path, tmp_path / "fmus", CHECKOUT / "system" / "SystemStructure.ssd", progress=False)
    with pytest.raises(KeyboardInterrupt), cosimulation.hold_run(options, table2.SCENARIO) as run:
        (run.output / "results.nc").write_text("interrupted")
        raise KeyboardInterrupt
    with cosimulation.hold_run(options, table2.SCENARIO) as run:
        assert not (run.output / "results.nc").exists()
        (run.output / "results.nc").write_text("complete")
    assert (run.output / "results.nc").read_text() == "complete"
