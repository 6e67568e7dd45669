"""Signals of chosen cases: the rows of the run, complete or not there, resumed, refused where they are too large."""

import json
import resource

import netCDF4
import numpy as np
import pytest
from support.cosim import Collect

from ps_fmu.cosim import Master, RecorderError
from ps_fmu.studies import sweep, worker
from ps_fmu.studies.bundle import open_folder
from ps_fmu.studies.case_runner import CaseRunner
from ps_fmu.studies.conclusion import describe_signals
from ps_fmu.studies.rows import DONE, SIGNALS, RowStore, name_file, write_durably
from ps_fmu.studies.sweep import SweepOptions, compute, hold, prepare
from ps_fmu.studies.worker import run_batch

from .conftest import list_missing

OBSERVE_TABLE = "[[observe]]"


def signals(text):
    """The change that adds a table [signals]."""
    return {OBSERVE_TABLE: f"[signals]\n{text}\n{OBSERVE_TABLE}"}


ALL = signals('variables = ["toy.error"]\ncases = "all"')


@pytest.fixture
def opened(make_prepared, tmp_path):
    """Prepares a study and its output folder."""

    def make(changes=ALL):
        prepared, folder = make_prepared(changes=changes), tmp_path / "out"
        folder.mkdir(exist_ok=True)
        open_folder(folder, prepared.plan, prepared.identity, resume=(folder / "manifest.json").exists())
        sweep.prepare_folder(folder, prepared.plan, prepared.system)
        return prepared, folder

    return make


def run_here(prepared, folder, cases, stored_cases):
    """Run cases in a process of this one, as a worker does, and keep what it finds."""
    done = run_batch(prepared.bundle, [(case, prepared.plan.values(case)) for case in cases], None, stored_cases)
    for case, content in done.signals.items():
        write_durably(folder / SIGNALS / name_file(case), content)
    RowStore(folder, prepared.identity.plan_sha256).add(done.rows)


def test_what_is_stored_are_the_rows_of_the_run(opened):
    prepared, folder = opened()
    run_here(prepared, folder, [0, 1], [1])
    assert [path.name for path in (folder / SIGNALS).iterdir()] == [name_file(1)]
    seen = Collect()
    with Master(prepared.system.structure.with_parameters(prepared.plan.values(1)), 1e-3) as master:
        master.initialise()
        master.run(0.1, [seen])
        names = [column.name for column in master.columns]
    with netCDF4.Dataset(folder / SIGNALS / name_file(1)) as file:
        group = file["active"]
        assert set(group.variables) == {"time", "toy.error.x", "toy.error.y"}
        for name in ("toy.error.x", "toy.error.y"):
            assert (np.asarray(group[name][:]) == seen.values[:, names.index(name)]).all()
        assert len(group["time"]) == 101


def test_rows_can_be_stored_further_apart_and_each_run_has_a_group(opened):
    changes = signals('variables = ["*.x"]\nevery = 4\nstep = "2 ms"')
    runs = '[runs.low]\n"toy.offset" = 0.0\n[runs.high]\n"toy.offset" = 1.0\n'
    prepared, folder = opened({OBSERVE_TABLE: runs + changes[OBSERVE_TABLE]})
    run_here(prepared, folder, [4], [4])
    with netCDF4.Dataset(folder / SIGNALS / name_file(4)) as file:
        assert list(file.groups) == ["low", "high"]
        assert len(file["high"]["time"]) == 51
        assert set(file["high"].variables) == {"time", "toy.error.x"}


def test_a_case_that_fails_keeps_the_rows_before(opened, tmp_path):
    prepared, folder = opened()
    runner = CaseRunner(prepared.bundle.unpack(tmp_path))
    path = folder / SIGNALS / name_file(0)
    row = runner.run(0, {**prepared.plan.values(0), "toy.mode": "raise"}, path)
    assert row["status"] == "failed"
    with netCDF4.Dataset(path) as file:
        assert 51 <= len(file["active"]["time"]) < 60
    assert [one.name for one in (folder / SIGNALS).iterdir()] == [path.name]


def test_rows_do_not_depend_on_whether_signals_are_stored(opened, tmp_path):
    prepared, folder = opened()
    runner = CaseRunner(prepared.bundle.unpack(tmp_path))
    values = prepared.plan.values(2)
    with_file, without = runner.run(2, values, folder / SIGNALS / name_file(2)), runner.run(2, values)
    assert {**with_file, "wall_s": 0.0} == {**without, "wall_s": 0.0}


def test_resuming_computes_the_signals_that_are_missing(opened):
    prepared, folder = opened(signals('variables = ["toy.error"]\nevery = 2\ncases = [5]'))
    name = prepared.identity.plan_sha256
    run_here(prepared, folder, range(6), [])  # the rows without signals
    assert list_missing(RowStore(folder, name), 6) == []
    assert sweep.list_work(folder, prepared.plan, name) == ([0, 2, 4, 5], {0, 2, 4, 5})
    run_here(prepared, folder, [0], [0])
    assert sweep.list_work(folder, prepared.plan, name) == ([2, 4, 5], {2, 4, 5})


def test_signals_can_be_wanted_later(opened):
    """They do not decide the rows: the study is the same."""
    prepared, folder = opened({"cases = 6": "cases = 6"})
    run_here(prepared, folder, range(6), [])
    again, _ = opened(signals('variables = ["toy.error"]\nworst = 2'))
    assert again.identity == prepared.identity
    name = again.identity.plan_sha256
    assert sweep.list_work(folder, again.plan, name) == ([], set())
    rows = RowStore(folder, name).read_table().to_pandas()
    worst = rows.sort_values("active.toy.error.x.APE.rms").tail(2)["case"]
    assert sweep.list_worst(folder, again.plan, name, again.system) == sorted(worst)


def test_a_case_that_has_no_signals_does_not_run_for_ever(opened):
    prepared, folder = opened()
    rows = [{"case": case, "status": "killed its process" if case else DONE, "error": None} for case in range(6)]
    RowStore(folder, prepared.identity.plan_sha256).add(rows)
    assert sweep.list_work(folder, prepared.plan, prepared.identity.plan_sha256) == ([0], {0})


def test_worst_cases_run_again_with_their_signals(write_study, toy_fmus, address, tmp_path):

    study = write_study(changes=signals('variables = ["toy.*"]\nworst = 2\ncases = [1]'))
    options = SweepOptions(study, tmp_path / "out", scheduler=address, fmus=toy_fmus, progress=False)
    prepared = prepare(options)
    with hold(options.output) as folder:
        open_folder(folder, prepared.plan, prepared.identity, resume=False)
        compute(options, prepared, folder)
        name = prepared.identity.plan_sha256
        rows = RowStore(folder, name).read_table().to_pandas()
        worst = rows.sort_values("active.toy.error.x.APE.rms").tail(2)["case"].tolist()
        found = sorted(path.name for path in (folder / SIGNALS).iterdir())
        assert found == sorted(name_file(case) for case in {1, *worst})
        before = {path: path.stat().st_mtime_ns for path in (folder / SIGNALS).iterdir()}
        compute(options, prepared, folder)  # nothing is left to do
        assert {path: path.stat().st_mtime_ns for path in (folder / SIGNALS).iterdir()} == before


def test_the_study_says_whose_signals_there_are(tmp_path):
    (tmp_path / SIGNALS).mkdir()
    assert describe_signals(tmp_path) == []
    (tmp_path / SIGNALS / name_file(3)).touch()
    assert describe_signals(tmp_path) == [f"Signals of one case are in the folder {SIGNALS}: 3."]
    (tmp_path / SIGNALS / name_file(17)).touch()
    assert describe_signals(tmp_path) == [f"Signals of 2 cases are in the folder {SIGNALS}: 3, 17."]


@pytest.mark.parametrize("duration", ["5 s", "16 s"])  # one chunk of rows, two chunks
def test_the_estimate_is_that_of_the_files(opened, duration):
    prepared, folder = opened({**ALL, 'duration = "0.1 s"': f'duration = "{duration}"'})
    run_here(prepared, folder, [0], [0])
    size = (folder / SIGNALS / name_file(0)).stat().st_size
    assert 0.5 < 6 * size / sweep.check_stored(prepared.plan, prepared.system) <= 1.0


def test_a_disk_without_room_for_all_is_said_before_anything_runs(opened, monkeypatch):
    monkeypatch.setattr("shutil.disk_usage", lambda _: type("Usage", (), {"free": 1000}))
    with pytest.raises(OSError, match=r"the signals take some .* GB, and 1e-06 GB are free"):
        opened()


def test_a_full_disk_stops_the_study(opened):
    """The process for the cases may write so little that signals do not fit."""
    prepared, folder = opened(signals('variables = ["toy.error"]\ncases = [2]'))
    jobs = [(case, prepared.plan.values(case)) for case in range(4)]
    run_here(prepared, folder, [5], [])
    resource.prlimit(worker._OWN.process.pid, resource.RLIMIT_FSIZE, (70_000, resource.RLIM_INFINITY))
    with pytest.raises(OSError, match=r"the file size limit of this process is reached: .* MB needed"):
        run_batch(prepared.bundle, jobs, None, [2])
    assert list_missing(RowStore(folder, prepared.identity.plan_sha256), 6) == [0, 1, 2, 3, 4]
    assert list((folder / SIGNALS).iterdir()) == []
    run_here(prepared, folder, range(5), [2])
    assert json.loads((folder / "manifest.json").read_text())["cases"] == 6
    assert sweep.list_work(folder, prepared.plan, prepared.identity.plan_sha256) == ([], set())


def test_a_file_that_cannot_be_written_is_no_failure_of_the_case(opened, tmp_path):
    prepared, _ = opened()
    runner = CaseRunner(prepared.bundle.unpack(tmp_path))
    (tmp_path / "file").write_text("")
    with pytest.raises((OSError, RecorderError)):
        runner.run(0, prepared.plan.values(0), tmp_path / "file" / name_file(0))


def test_a_case_reads_what_its_metrics_and_its_file_need(opened, tmp_path, monkeypatch):
    read = []
    run = Master.run
    monkeypatch.setattr(
        Master, "run",
        lambda self, *args, **more: read.append([column.name for column in self.columns]) or run(self, *args, **more),
    )
    prepared, folder = opened({**signals('variables = ["toy.error.y"]\ncases = [0]'), '"toy.error"': '"toy.error.x"'})
    runner = CaseRunner(prepared.bundle.unpack(tmp_path))
    rows = [runner.run(0, prepared.plan.values(0), path) for path in (None, folder / SIGNALS / name_file(0), None)]
    few, more = ["toy.error.x", "toy.large"], ["toy.error.x", "toy.error.y", "toy.large"]
    assert read == [few, more, few]
    assert rows[0].keys() >= {"active.toy.error.x.APE.rms", "active.toy.large.share"}
    assert all({**row, "wall_s": 0.0} == {**rows[0], "wall_s": 0.0} for row in rows)
