"""results.nc stays open between the runs of a scenario, and no longer."""

import netCDF4
import pytest

from ps_fmu.runs.cases import Case, run_case
from ps_fmu.runs.execute import run_scenario
from ps_fmu.runs.results_file import ResultsFile
from ps_fmu.runs.setup import load_system


class Nothing:
    observers = ()

    def __init__(self, columns):
        """No analysis."""


class Failing(Nothing):
    def __init__(self, columns):
        self.observers = (self,)

    def block(self, first_index, time, values):
        raise ArithmeticError


@pytest.fixture
def opened(monkeypatch):
    """The modes in which files have been opened."""
    modes, real = [], netCDF4.Dataset

    def open_file(path, mode="r", **options):
        modes.append(mode)
        return real(path, mode, **options)

    monkeypatch.setattr(netCDF4, "Dataset", open_file)
    return modes


def test_a_scenario_opens_its_file_once_and_the_compressed_one(make_options, opened):
    options = make_options("isolation", 0.02, step_s=2e-4)
    run_scenario(options)
    assert opened == ["w", "w"]
    with netCDF4.Dataset(options.output / "results.nc") as file:
        assert {"passive", "active"} <= set(file.groups)
    assert not list(options.output.glob(".*.part"))


def test_a_run_that_fails_closes_the_file_with_its_rows(make_options):
    options = make_options("isolation", 0.2, step_s=2e-4, storage_step_s=2e-4)
    system = load_system(options)
    run_case(system, options, Case("passive"), Nothing, duration_s=0.02)
    path = options.output / "results.nc"
    kept = system.results.find(path)
    assert kept.isopen()
    with pytest.raises(ArithmeticError):
        run_case(system, options, Case("active"), Failing)
    assert system.results.find(path) is None
    assert not kept.isopen()
    with netCDF4.Dataset(path) as file:
        assert len(file["passive"]["time"]) == 101
        assert len(file["active"]["time"]) == 1001


def test_another_file_takes_the_place_of_the_open_one(tmp_path):
    results = ResultsFile()
    first, second = (netCDF4.Dataset(tmp_path / name, "w") for name in ("a.nc", "b.nc"))
    results.keep(tmp_path / "a.nc", first)
    assert results.find(tmp_path / "a.nc") is first
    results.keep(tmp_path / "b.nc", second)
    assert not first.isopen()
    assert results.find(tmp_path / "a.nc") is None
    with results.read(tmp_path / "b.nc") as file:
        assert file is second
    results.close()
    results.close()
    assert not second.isopen()
    with results.read(tmp_path / "a.nc") as file:
        assert file.isopen() and file is not first
    assert not file.isopen()


def test_the_file_of_a_run_that_was_given_up_is_closed_by_the_next_one(tmp_path):
    """Not by whoever collects it: another thread may be in the libraries of netCDF then."""
    import gc

    path = tmp_path / "a.nc"
    first = ResultsFile()
    dataset = netCDF4.Dataset(path, "w")
    first.keep(path, dataset)
    del first
    gc.collect()
    assert dataset.isopen()
    assert ResultsFile().find(path) is None
    assert not dataset.isopen()
