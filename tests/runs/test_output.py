"""The folder of the results: who may write there, and what becomes of what is there."""

import os

import numpy as np
import pytest

from ps_fmu.cli import main
from ps_fmu.cosim import Column, Recorder
from ps_fmu.results.style import draw
from ps_fmu.runs.options import OptionError
from ps_fmu.runs.output import hold_folder

EARLIER = ("summary.json", "results.nc", "report.html")


@pytest.fixture
def folder(tmp_path):
    for name in (*EARLIER, "notes.txt"):
        (tmp_path / name).write_text("earlier, of ps_fmu")
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
    assert (folder / "results.nc").read_text() == "earlier, of ps_fmu"


def test_earlier_results_do_not_pass_for_those_of_a_run_that_stops_early(folder):
    with pytest.raises(KeyboardInterrupt), hold_folder(folder):
        (folder / "results.nc").write_text("half")
        raise KeyboardInterrupt
    assert sorted(os.listdir(folder)) == ["notes.txt", "results.nc"]


def record(path, rows):
    columns, source = [Column("a.x", "m", "Real", "")], {"source": "ps_fmu"}
    with Recorder(path, "run", columns=columns, step=1.0, attributes=source) as recorder:
        recorder.block(0, np.arange(float(rows)), np.zeros((rows, 1)))


@pytest.mark.parametrize("begun", ["not begun", "empty", "without rows"])
def test_what_a_killed_run_set_aside_is_put_back(folder, begun):
    """It had stored nothing; the next run is refused."""
    for name in EARLIER:
        (folder / name).rename(folder / f"{name}.earlier")
    if begun == "empty":
        (folder / "results.nc").touch()
    elif begun == "without rows":
        record(folder / "results.nc", 0)
    with pytest.raises(OptionError), hold_folder(folder):
        raise OptionError
    assert sorted(os.listdir(folder)) == sorted([*EARLIER, "notes.txt"])
    assert (folder / "results.nc").read_text() == "earlier, of ps_fmu"


def test_results_before_those_of_a_killed_run_are_removed(folder):
    """The old report would say of the new rows what is not true."""
    (folder / "report.html").rename(folder / "report.html.earlier")
    record(folder / "results.nc", 1)
    with pytest.raises(OptionError), hold_folder(folder):
        raise OptionError
    assert sorted(os.listdir(folder)) == ["notes.txt", "results.nc", "summary.json"]


@pytest.mark.parametrize(
    "name", ["summary.json", "report.html", "results.nc", "plot.png", "checkpoint/model.pt", "report.html.earlier"]
)
def test_what_is_not_of_ps_fmu_is_left_alone(tmp_path, name):
    (tmp_path / name).parent.mkdir(exist_ok=True)
    (tmp_path / name).write_text("mine")
    taken = tmp_path / name.split("/")[0]
    with pytest.raises(OptionError, match=f"--output: {taken} was not written by ps_fmu"), hold_folder(tmp_path):
        (tmp_path / "results.nc").write_text("new")
    assert (tmp_path / name).read_text() == "mine" and os.listdir(tmp_path) == [taken.name]


@pytest.mark.parametrize("mark", ["run.json", "passive/row-000000000050.msgpack"])
def test_our_checkpoints_and_plot_are_replaced(folder, mark):
    (folder / "checkpoint" / mark).parent.mkdir(parents=True)
    (folder / "checkpoint" / mark).write_text("{}")
    draw(folder / "plot.png", 1.0, 1.0, lambda figure: figure.subplots())
    with hold_folder(folder):
        (folder / "results.nc").write_text("new")
    assert sorted(os.listdir(folder)) == ["notes.txt", "results.nc"]


def test_figures_of_earlier_results_go_with_them(folder):
    draw(folder / "jitter.png", 1.0, 1.0, lambda figure: figure.subplots())
    jitter = (folder / "jitter.png").read_bytes()
    (folder / "jitter_before.png").write_bytes(jitter)
    (folder / "photograph.png").write_bytes(b"\x89PNG")
    with pytest.raises(OptionError), hold_folder(folder):
        assert not (folder / "jitter.png").exists()
        raise OptionError
    assert (folder / "jitter.png").read_bytes() == jitter
    with hold_folder(folder):
        (folder / "results.nc").write_text("new")
    assert sorted(os.listdir(folder)) == ["jitter_before.png", "notes.txt", "photograph.png", "results.nc"]


@pytest.mark.parametrize("name", ["parameters.ssv", "disturbance.csv"])
def test_what_earlier_results_were_made_from_stays_with_them(folder, name):
    (folder / name).write_text("earlier")
    with pytest.raises(OptionError), hold_folder(folder):
        (folder / name).write_text("new")
        raise OptionError
    assert (folder / name).read_text() == "earlier"
    assert sorted(os.listdir(folder)) == sorted([*EARLIER, "notes.txt", name])
    (folder / name).unlink()
    with pytest.raises(OptionError), hold_folder(folder):
        (folder / name).write_text("new, beside results that had none")
        raise OptionError
    assert sorted(os.listdir(folder)) == sorted([*EARLIER, "notes.txt"])


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("", "expected a path, got an empty name"),
        ("x" * 300, "File name too long"),
        ("\udcff", "expected a name in UTF-8"),
    ],
)
@pytest.mark.parametrize("command", ["run isolation", "run any.fmu", "sweep a.toml", "analyse jitter", "build", "ssp"])
def test_names_that_nothing_can_have(tmp_path, monkeypatch, capsys, command, name, reason):
    monkeypatch.chdir(tmp_path)
    assert main([*command.split(), "--output", name]) == 2
    assert reason in capsys.readouterr().err.splitlines()[-1]
    assert os.listdir(tmp_path) == []


def test_one_run_at_a_time(folder):
    with hold_folder(folder):
        message = r"--output: another run is writing in .*: name another"
        with pytest.raises(OptionError, match=message), hold_folder(folder):
            pass
        (folder / "results.nc").write_text("new, of ps_fmu")
    assert (folder / "results.nc").read_text() == "new, of ps_fmu"
    with hold_folder(folder):
        pass
