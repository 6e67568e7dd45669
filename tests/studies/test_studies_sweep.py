"""Whole studies by the command: on this machine, on workers started by hand, disturbed and resumed, refused.

``make soak`` disturbs ten studies in each way, instead of one.
"""

import json
import math
import os
import random
import re
import signal
import subprocess
import sys
from functools import cache
from itertools import zip_longest
from pathlib import Path

import netCDF4
import numpy as np
import psutil
import pyarrow.parquet as pq
import pytest
from support.archives import put, rewrite
from support.claims import verify_claim
from support.processes import PATIENCE_S, end_with_children, read_command, wait_until

from ps_fmu.cli import main
from ps_fmu.studies.case_runner import CaseRunner
from ps_fmu.studies.rows import DONE, FAILED, FILE, KILLED, MEASURED, RowStore

from .conftest import OBSERVE, STUDY, list_missing, start_by_hand

SOAK = bool(os.environ.get("PS_FMU_SOAK"))
KILLS = 10 if SOAK else 1
SLOW = '[[vary]]\nparameter = "slowness"\ndistribution = "uniform"\nlow = "1e-3"\nhigh = "2e-3"\n'
MANY = {"cases = 6": "cases = 12", "[[observe]]": SLOW + "[[observe]]"}
PATIENT = ("--scheduler-timeout", f"{PATIENCE_S:g}")
HELD = 20  # cases of a study that is disturbed
LARGE, DISTURBANCES = (10_000, 9) if SOAK else (200, 2)
"""Cases of a study whose workers or cases end together; how often they do, under ``make soak`` about once a minute."""


@pytest.fixture
def start(tmp_path, toy_fmus):
    """Starts the command ``ps-fmu sweep``, with one worker unless a scheduler is given; ends it and its worker."""
    started = []

    def launch(study, *arguments):
        command = [sys.executable, "-I", "-m", "ps_fmu.cli", "sweep", str(study), "--output", str(tmp_path / "out")]
        process = subprocess.Popen(
            [*command, "--fmus", str(toy_fmus), *(arguments or ("--workers", "1"))], stdout=subprocess.PIPE,
            stderr=subprocess.PIPE, text=True, start_new_session=True,
        )  # fmt: skip
        started.append(process)
        return process

    yield launch
    for process in started:
        end_with_children(process)


@pytest.fixture
def sweep(tmp_path, toy_fmus, address, capsys):
    """Runs ``ps-fmu sweep`` in this process, on workers that are there: exit code, standard output, error stream."""

    def run(study, *arguments):
        where = () if {"--scheduler", "--case"} & set(arguments) else ("--scheduler", address)
        given = ["sweep", str(study), "--output", str(tmp_path / "out"), "--fmus", str(toy_fmus), *where, *arguments]
        return main(given), *capsys.readouterr()

    return run


def open_store(folder):
    return RowStore(folder, json.loads((folder / "manifest.json").read_text())["plan_sha256"])


def read(folder):
    """Rows of a study but for what was measured."""
    return [{name: value for name, value in row.items() if name not in MEASURED} for row in open_store(folder).read()]


def count_others(rows, expected):
    """How many of two lists of rows are not the same."""
    return sum(one != other for one, other in zip_longest(rows, expected))


@pytest.fixture(scope="session")
def undisturbed():
    """Rows that this process computes, by study."""
    known = {}

    def compute(prepared, folder):
        name = prepared.identity.plan_sha256
        if name not in known:
            runner = CaseRunner(prepared.bundle.unpack(folder))
            rows = [runner.run(i, {**prepared.plan.values(i), "toy.slowness": 0.0}) for i in range(len(prepared.plan))]
            known[name] = [{k: v for k, v in row.items() if k not in MEASURED} for row in rows]
        return known[name]

    return compute


@pytest.fixture
def hold(make_prepared, tmp_path_factory):
    """Makes a study whose last case waits while a file is there: its text, and the file; ``more``: start values.

    So whatever disturbs the study comes before its end, however slow this machine is.
    """
    gate = tmp_path_factory.getbasetemp() / "gate"  # the same for all tests, so that their studies are the same

    def make(cases=HELD, more="", slow=""):
        text = STUDY.replace("cases = 6", f"cases = {cases}")
        last = make_prepared(text + slow + OBSERVE).plan.values(cases - 1)["toy.gain"]
        runs = f'[runs.active]\n"toy.gate" = {json.dumps(str(gate))}\n"toy.held" = {last!r}\n{more}\n'
        gate.touch()
        return text.replace("[[vary]]", f"{runs}[[vary]]", 1) + slow + OBSERVE, gate

    yield make
    gate.unlink(missing_ok=True)


def count_stored(folder):
    """Cases that have rows so far."""
    return _count(folder, (folder / FILE).stat().st_mtime_ns) if (folder / FILE).is_file() else 0


@cache
def _count(folder, changed_ns):
    return len(open_store(folder).read_statuses())


def list_processes(command):
    """Workers of a command on this machine, and the processes of their cases."""
    children = psutil.Process(command.pid).children(recursive=True)
    spawned = [one for one in children if any("spawn_main" in word for word in read_command(one))]
    workers = [one for one in spawned if one.ppid() == command.pid]
    return workers, [one for one in spawned if one not in workers]


def test_workers_import_nothing_of_the_current_directory(write_study, toy_fmus, tmp_path, monkeypatch):
    """By the command as people type it, whose Python is started without -I."""
    study, here = write_study(), tmp_path / "here"
    here.mkdir()
    for name in ("multiprocessing", "json", "distributed"):
        (here / f"{name}.py").write_text(f"open({str(tmp_path / 'taken')!r}, 'a').write('{name}')\n")
    monkeypatch.chdir(here)
    command = [Path(sys.executable).with_name("ps-fmu"), "sweep", study, "--output", tmp_path / "out", "--workers", "1"]
    done = subprocess.run(
        [*command, "--fmus", toy_fmus], capture_output=True, text=True, timeout=PATIENCE_S, start_new_session=True
    )
    assert done.returncode == 0, done.stderr
    assert not (tmp_path / "taken").exists()


def test_a_study_on_this_machine_says_what_it_says(write_study, make_prepared, sweep, undisturbed, tmp_path):
    study = write_study()
    code, printed, errors = sweep(study)
    assert code == 0, errors
    assert read(tmp_path / "out") == undisturbed(make_prepared(), tmp_path)
    assert "6 done" in printed
    assert "--case" in printed
    for name in ("study.parquet", "study.html", "summary.json", "plan.parquet", "distribution.png"):
        assert (tmp_path / "out" / name).is_file()
    table = pq.read_table(tmp_path / "out" / "study.parquet")
    assert table.schema.field("toy.gain").metadata == {b"unit": b"1"}
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["statuses"] == {"done": 6}
    off = []
    for name, found in summary["outputs"].items():
        own = np.sort(np.array(table[name], dtype=float))
        assert (found["cases"], len(own)) == (6, 6)
        statistics = (own.mean(), own.std(ddof=1), own[0], own[-1])
        truth = dict(zip(("mean", "std", "least", "largest"), statistics, strict=True))
        off += [abs(found[key] - value) / own[-1] for key, value in truth.items()]
        ranks = [own[math.ceil(one["probability"] * 6) - 1] for one in found["percentiles"]]
        off += [abs(one["value"] / value - 1.0) for one, value in zip(found["percentiles"], ranks, strict=True)]
    worst = next(name for name in summary["outputs"] if name.endswith(".rms"))
    assert [one["case"] for one in summary["worst"]] == np.argsort(-np.array(table[worst], dtype=float))[:5].tolist()
    assert all(f"--case {one['case']} " in one["command"] for one in summary["worst"]) and summary["failed"] == []
    verify_claim(
        "study.summary",
        claim="Mean, deviation, percentiles, least and largest value of each output; the worst cases",
        where="`ps-fmu sweep`: terminal, study page, summary.json",
        reference="numpy and ranks on the columns of study.parquet",
        error=max(off),
        bound=1e-12,
    )

    code, _, errors = sweep(study)
    assert code == 2
    assert "has this study already: --resume" in errors
    before = (tmp_path / "out" / "study.parquet").read_bytes()
    code, _, errors = sweep(study, "--resume", "--scheduler", "tcp://127.0.0.1:1")  # nothing is missing
    assert code == 0, errors
    assert (tmp_path / "out" / "study.parquet").read_bytes() == before


def test_a_case_again_has_the_same_bits_and_all_signals(write_study, sweep, tmp_path):
    study = write_study()
    assert sweep(study)[0] == 0
    code, printed, errors = sweep(study, "--case", "4")
    assert code == 0, errors
    assert "all numbers are those of the study, to the last bit" in printed
    for name in ("results.nc", "report.html", "summary.json"):
        assert (tmp_path / "out" / "case-4" / name).is_file()
    with netCDF4.Dataset(tmp_path / "out" / "case-4" / "results.nc") as results:
        assert results.history.endswith("Z ps-fmu sweep study.toml --case 4")
        assert results.title == "toy: a case of the study study.toml"
    for option in ("--resume", "--workers=2"):
        code, _, errors = sweep(study, "--case", "4", option)
        assert (code, errors.count("\n")) == (2, 1)
        assert f"{option[:8]}" in errors and "--case runs one case" in errors
    code, _, errors = sweep(study, "--case", "6")
    assert code == 2
    assert "has the cases 0 to 5, got 6" in errors


def test_workers_started_by_hand_give_identical_rows(write_study, make_prepared, sweep, undisturbed, tmp_path):
    with start_by_hand(tmp_path) as (address, _):
        code, _, errors = sweep(write_study(changes=MANY), "--scheduler", address, *PATIENT)
    assert code == 0, errors
    rows, expected = read(tmp_path / "out"), undisturbed(make_prepared(changes=MANY), tmp_path)
    workers = set(pq.read_table(tmp_path / "out" / "study.parquet")["worker"].to_pylist())
    assert {worker.split("@")[0] for worker in workers} == {"node1", "node2"}
    verify_claim(
        "study.rows_of_a_cluster",
        claim="Rows of a study on workers of a dask scheduler",
        where="study.parquet, and all that a study says",
        reference="the same cases in one process on the same machine",
        error=count_others(rows, expected),
        bound=0.0,
        unit="rows that differ",
    )


def test_cases_that_kill_their_process_do_not_take_others_along(write_study, sweep, tmp_path):
    modes = ["exit", "none", "crash", "raise", "none", "raise", "none"]
    text = STUDY.replace('plan = "random"\ncases = 6', 'plan = "list"')
    text = text[: text.index("[[vary]]")] + f'[[vary]]\nparameter = "mode"\nvalues = {json.dumps(modes)}\n' + OBSERVE
    code, printed, errors = sweep(write_study(text))
    assert code == 0, errors
    rows = read(tmp_path / "out")
    expected = {"none": DONE, "exit": KILLED, "crash": KILLED, "raise": "failed"}
    assert [row["status"] for row in rows] == [expected[mode] for mode in modes]
    assert "4 cases have no result" in printed
    assert "signal SIGSEGV" in printed
    reason = r"(\d) (failed|killed its process), as case (\d): .*?(model broke|code 3|SIGSEGV)"
    reasons = re.findall(reason, " ".join(printed.split()))
    expected = {("2", "failed", "3", "model broke"), ("1", KILLED, "0", "code 3"), ("1", KILLED, "2", "SIGSEGV")}
    verify_claim(
        "study.reasons_of_failures",
        claim="Status of each case, and why cases have no result, with counts",
        where="`ps-fmu sweep`: warnings on terminal and study page, table of cases without a result",
        reference="cases that are made to raise, to exit and to crash, among others that run",
        error=len(expected ^ set(reasons)),
        bound=0.0,
        unit="reasons that differ",
    )


def test_a_study_outlives_its_workers_and_cases(make_prepared, write_study, start, undisturbed, hold, tmp_path):
    """Of which one in a hundred fails: the rows are those of a study that nobody disturbs."""
    slow = SLOW if SOAK else ""
    plan = make_prepared(STUDY.replace("cases = 6", f"cases = {LARGE}") + slow + OBSERVE).plan
    failing = f'"toy.mode" = "raise"\n"toy.limit" = {sorted(plan.draws[:, 0].tolist())[-LARGE // 100 - 1]!r}'
    text, gate = hold(LARGE, failing, slow)
    prepared, folder, rng = make_prepared(text), tmp_path / "out", random.Random(1)
    process = start(write_study(text), "--workers", "2")
    for number in range(DISTURBANCES):
        due = (number + 1) * LARGE // (DISTURBANCES + 2)
        wait_until(lambda due=due: count_stored(folder) >= due or process.poll() is not None)
        assert process.poll() is None, process.communicate()
        wait_until(lambda: all(list_processes(process)))
        workers, cases = list_processes(process)
        if number % 3 == 2:
            rng.choice(workers).suspend()
        else:
            for one in cases if number % 3 else workers:
                one.kill()
    gate.unlink()
    _, errors = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 0, errors
    rows, expected = read(folder), undisturbed(prepared, tmp_path)
    assert [row["status"] for row in rows].count(FAILED) == LARGE // 100
    verify_claim(
        "study.rows_of_a_disturbed_study",
        claim="Rows of a study on several processors, whose workers and processes end in the middle of cases",
        where="study.parquet, and all that a study says",
        reference="the same cases one after another in one process, where nothing ends",
        error=count_others(rows, expected),
        bound=0.0,
        unit="rows that differ",
    )


def test_a_study_that_is_wrong_ends_with_its_first_cases(write_study, sweep, tmp_path):
    """Case 0, and four others; whoever goes on all the same gets the others."""
    runs = {"[[vary]]": '[runs.active]\n"toy.mode" = "raise"\n[[vary]]', "cases = 6": "cases = 8"}
    study = write_study(changes=runs)
    code, printed, errors = sweep(study)
    assert (code, printed) == (1, "")
    assert "all 5 cases that were tried first have failed:\n  5 failed, as case 0: SlaveError: toy: " in errors
    advice = "the model broke.*\nCorrect the study, and name another --output.  --resume runs the other 3"
    assert re.search(advice, errors)
    assert len(read(tmp_path / "out")) == 5
    code, printed, errors = sweep(study, "--resume")
    assert code == 0, errors
    assert "8 failed, as case 0: " in printed


@pytest.mark.parametrize("kill", range(KILLS))
@pytest.mark.parametrize("victim", ["client", "interrupt"])
def test_a_study_that_is_ended_is_resumed(
    write_study, make_prepared, start, sweep, undisturbed, hold, tmp_path, victim, kill
):
    rng = random.Random(f"{victim} {kill}")
    text, gate = hold()
    study, folder = write_study(text), tmp_path / "out"
    process = start(study)
    after = rng.randint(1, HELD * 3 // 4)
    wait_until(lambda: count_stored(folder) >= after or process.poll() is not None)
    assert process.poll() is None, process.communicate()
    _, cases = list_processes(process)
    if victim == "client":
        process.kill()
    else:
        os.killpg(process.pid, signal.SIGINT)  # as a terminal does: to the workers, too
    process.wait(timeout=PATIENCE_S)
    wait_until(lambda: not any(read_command(one) for one in cases))
    assert HELD - 1 in list_missing(open_store(folder), HELD)  # it was in the middle
    gate.unlink()
    _, errors = process.communicate(timeout=PATIENCE_S)
    if victim == "interrupt":
        assert process.returncode == 130, errors
        assert "--resume" in errors
        assert "Traceback" not in errors
    code, _, errors = sweep(study, "--resume")
    assert code == 0, errors
    assert read(folder) == undisturbed(make_prepared(text), tmp_path)


@pytest.mark.parametrize("kill", range(KILLS))
def test_a_study_that_loses_its_scheduler_is_resumed_elsewhere(
    write_study, make_prepared, start, sweep, undisturbed, by_hand, hold, tmp_path, kill
):
    address, scheduler = by_hand
    text, gate = hold()
    study, folder = write_study(text), tmp_path / "out"
    process = start(study, "--scheduler", address, *PATIENT)
    wait_until(lambda: count_stored(folder) > kill or process.poll() is not None)
    assert process.poll() is None, process.communicate()
    end_with_children(scheduler)
    gate.unlink()
    _, errors = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 1
    assert "--resume" in errors
    assert "Traceback" not in errors
    code, _, errors = sweep(study, "--resume")
    assert code == 0, errors
    assert read(folder) == undisturbed(make_prepared(text), tmp_path)


def test_another_plan_or_another_fmu_is_not_resumed(write_study, toy_fmus, start, sweep, tmp_path):
    assert sweep(write_study(changes={"cases = 6": "cases = 2"}))[0] == 0
    kept = (tmp_path / "out" / FILE).read_bytes()
    code, _, errors = sweep(write_study(), "--resume")
    assert code == 2
    assert "6 cases, there 2" in errors
    folder = tmp_path / "other"
    folder.mkdir()
    rewrite(toy_fmus / "ToyStudy.fmu", folder, put("resources/more.txt", b"another FMU behind the same name"))
    code, _, errors = sweep(write_study(changes={"cases = 6": "cases = 2"}), "--resume", "--fmus", str(folder))
    assert code == 2
    assert "other FMUs: ToyStudy" in errors
    assert (tmp_path / "out" / FILE).read_bytes() == kept


def test_results_that_cannot_be_written_cost_no_rows(write_study, sweep, tmp_path):
    blocked = tmp_path / "out" / "study.parquet"
    blocked.mkdir(parents=True)
    study = write_study(changes={"cases = 6": "cases = 2"})
    code, _, errors = sweep(study)
    assert code == 1
    assert "study.parquet" in errors and "--resume" in errors
    kept = (tmp_path / "out" / FILE).read_bytes()
    blocked.rmdir()
    code, printed, errors = sweep(study, "--resume")
    assert code == 0, errors
    assert "2 done" in printed
    assert (tmp_path / "out" / FILE).read_bytes() == kept


def test_no_scheduler_is_said(write_study, sweep):
    address = ("--scheduler", "tcp://127.0.0.1:1")
    code, _, errors = sweep(write_study(), *address, "--scheduler-timeout", "0.3")
    assert code == 1
    assert "--scheduler tcp://127.0.0.1:1" in errors
    assert "after 0.3 s" in errors
    assert "--scheduler-timeout 0.3 --resume" in errors


@pytest.mark.parametrize(
    ("arguments", "error"),
    [
        (["--scheduler", "tcp://127.0.0.1:1", "--scheduler-timeout", "0"], "expected a time above 0 s, got 0"),
        (["--scheduler-timeout", "1"], "only a study with --scheduler ADDRESS takes it"),
    ],
)
def test_a_time_for_no_scheduler_is_refused(tmp_path, capsys, arguments, error):
    assert main(["sweep", "study.toml", "--output", str(tmp_path / "out"), *arguments]) == 2
    assert f"--scheduler-timeout: {error}" in capsys.readouterr().err


def test_what_a_worker_cannot_write_is_said_with_its_name(make_prepared, tmp_path, monkeypatch):
    import socket
    import tempfile

    from ps_fmu.studies.worker import run_batch

    prepared = make_prepared(changes={'"0.1 s"': '"0.11 s"'})  # this process has not unpacked it
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "none"))
    with pytest.raises(OSError, match=rf"worker {socket.gethostname()}:{os.getpid()}: {tmp_path}/none.*: No such file"):
        run_batch(prepared.bundle, [(0, prepared.plan.values(0))], None)
