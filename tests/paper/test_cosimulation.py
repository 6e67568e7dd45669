"""What stands in the way of a co-simulation is said before anything is built or written."""

from pathlib import Path
from types import SimpleNamespace

import pytest

from ps_fmu.analyses import system
from ps_fmu.analyses.table import ANALYSES, Analysis, AnalysisOptions
from ps_fmu.cli import main
from ps_fmu.paper import cosimulation
from ps_fmu.product import files
from ps_fmu.runs.options import OptionError
from ps_fmu.runs.scenario import SCENARIOS

CHECKOUT = Path(__file__).parents[2]
CO_SIMULATED = [name for name, analysis in ANALYSES.items() if analysis.needs_fmus]


@pytest.fixture
def no_build(monkeypatch):
    """Building the FMUs fails the test."""
    for module in (cosimulation, system):
        monkeypatch.setattr(module, "provide_fmus", lambda folder, system: pytest.fail("FMUs were built"))


@pytest.mark.parametrize("name", CO_SIMULATED)
def test_a_system_that_is_not_there_is_said_and_nothing_left_behind(name, no_build, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["analyse", name, "--system", "none.ssd"]) == 2
    said = capsys.readouterr().err
    assert "--system: there is no system description none.ssd" in said
    assert f"those of ps_fmu are in {CHECKOUT / 'system'}" in said
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", CO_SIMULATED)
def test_from_another_folder_the_own_system_and_fmus_are_taken(name, tmp_path, monkeypatch):
    """The analysis itself is replaced: it keeps what it was given."""
    given = []

    def analyse(options):
        given.append(options)
        return SimpleNamespace(write=lambda folder: None, to_text=lambda: "")

    monkeypatch.setattr(Analysis, "load", lambda analysis, own: analyse)
    monkeypatch.chdir(tmp_path)
    assert main(["analyse", name]) == 0
    (options,) = given
    assert options.system == CHECKOUT / "system" / ANALYSES[name].system
    assert options.system.is_file()
    assert options.fmus == CHECKOUT / "build" / "fmus"
    assert options.output == Path("results", name)


def test_without_the_sources_of_the_fmus(no_build, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    alone = tmp_path / "site-packages" / "ps_fmu" / "product"
    monkeypatch.setattr(files.find_product, "__defaults__", (alone,))
    assert main(["analyse", "trajectories"]) != 0
    assert "the FMUs' sources" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_an_output_that_cannot_be_used_is_said_before_fmus_are_built(no_build, tmp_path):
    (tmp_path / "table2").write_text("")
    options = AnalysisOptions(tmp_path, tmp_path / "fmus", CHECKOUT / "system" / "SystemStructure.ssd", progress=False)
    refused = pytest.raises(OptionError, match="--output: cannot write in")
    with refused, cosimulation.hold_run(options, SCENARIOS["table2"]):
        pass


def test_runs_of_an_interrupted_analysis_are_not_among_those_of_the_next(tmp_path, monkeypatch):
    monkeypatch.setattr(cosimulation, "provide_fmus", lambda folder, system: None)
    options = AnalysisOptions(tmp_path, tmp_path / "fmus", CHECKOUT / "system" / "SystemStructure.ssd", progress=False)
    with pytest.raises(KeyboardInterrupt), cosimulation.hold_run(options, SCENARIOS["table2"]) as run:
        (run.options.output / "results.nc").write_text("interrupted, of ps_fmu")
        raise KeyboardInterrupt
    with cosimulation.hold_run(options, SCENARIOS["table2"]) as run:
        assert not (run.options.output / "results.nc").exists()
        (run.options.output / "results.nc").write_text("complete")
    assert (run.options.output / "results.nc").read_text() == "complete"
