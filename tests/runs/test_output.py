"""The folder of the results: who may write there, and what becomes of what is there."""

import os

import pytest

from ps_fmu.runs.options import OptionError
from ps_fmu.runs.output import hold_folder

EARLIER = ("summary.json", "results.nc", "report.html")


@pytest.fixture
def folder(tmp_path):
    for name in (*EARLIER, "notes.txt"):
        (tmp_path / name).write_text("earlier")
    return tmp_path


def test_earlier_results_are_replaced_and_nothing_else(folder):
    with hold_folder(folder):
        assert not any((folder / name).exists() for name in EARLIER)
        (folder / "results.nc").write_text("new")
    assert sorted(os.listdir(folder)) == ["notes.txt", "results.nc"]
    assert (folder / "results.nc").read_text() == "new"


def test_earlier_results_outlive_a_run_that_stores_nothing(folder):
    with pytest.raises(RuntimeError), hold_folder(folder):
        raise RuntimeError
    assert sorted(os.listdir(folder)) == sorted([*EARLIER, "notes.txt"])
    assert (folder / "results.nc").read_text() == "earlier"


def test_earlier_results_do_not_pass_for_those_of_a_run_that_stops_early(folder):
    with pytest.raises(KeyboardInterrupt), hold_folder(folder):
        (folder / "results.nc").write_text("half")
        raise KeyboardInterrupt
    assert sorted(os.listdir(folder)) == ["notes.txt", "results.nc"]


def test_what_a_killed_run_left_aside_is_removed(tmp_path):
    (tmp_path / "results.nc.earlier").write_text("old")
    with hold_folder(tmp_path):
        pass
    assert os.listdir(tmp_path) == []


def test_one_run_at_a_time(folder):
    with hold_folder(folder):
        message = r"--output: another run is writing in .*: name another"
        with pytest.raises(OptionError, match=message), hold_folder(folder):
            pass
        (folder / "results.nc").write_text("new")
    assert (folder / "results.nc").read_text() == "new"
    with hold_folder(folder):
        pass
