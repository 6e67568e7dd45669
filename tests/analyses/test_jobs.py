"""Jobs in other processes."""

import os
import signal
import subprocess
import sys
import threading
from pathlib import Path

import psutil
import pytest

from ps_fmu.analyses.jobs import Job, JobError, run_jobs
from ps_fmu.runs.options import OptionError, claim_folder


def test_a_job_takes_the_results_of_others():
    jobs = [Job("all", 9.0, sorted, after=("two", "one")), Job("one", 1.0, abs, (-1,)), Job("two", 2.0, abs, (-2,))]
    found = run_jobs(jobs, processes=2)
    assert found.results == {"one": 1, "two": 2, "all": ["one", "two"]}


@pytest.mark.parametrize("processes", [1, 2])
def test_the_longest_begin_first(processes):
    seen = []
    run_jobs([Job(f"{k}", float(k), abs, (k,)) for k in range(5)], processes, lambda _, running: seen.extend(running))
    assert list(dict.fromkeys(seen)) == ["4", "3", "2", "1", "0"]


def test_processes_are_others_and_serve_many_jobs():
    found = run_jobs([Job(f"{k}", 1.0, os.getpid) for k in range(6)], processes=2)
    assert os.getpid() not in found.results.values()
    assert len(set(found.results.values())) <= 2


@pytest.mark.parametrize("processes", [1, 2])
def test_a_job_that_fails_is_named_and_leaves_the_results_of_others(processes):
    jobs = [Job("wrong", 3.0, int, ("x",)), Job("right", 1.0, int, ("7",)), Job("after", 2.0, dict, (), ("wrong",))]
    found = run_jobs(jobs, processes)
    assert found.results == {"right": 7}
    with pytest.raises(JobError, match=r"wrong: ValueError: invalid literal.*'x'"):
        found.raise_failures()


@pytest.mark.parametrize(("function", "argument"), [(os._exit, 5), (signal.raise_signal, signal.SIGKILL)])
def test_a_process_that_ends_by_itself_fails_what_has_not_ended(function, argument):
    """Also the jobs that have not begun, and none of them hangs."""
    jobs = [Job("ends", 3.0, function, (argument,)), *(Job(f"{k}", 1.0, signal.pause) for k in range(3))]
    found = run_jobs(jobs, processes=2)
    assert found.results == {}
    assert found.failures == dict.fromkeys(("ends", "0", "1", "2"), "a process of the jobs has ended by itself")


def test_a_result_that_cannot_be_sent_fails_its_job_alone():
    found = run_jobs([Job("lock", 2.0, threading.Lock), Job("right", 1.0, int, ("7",))], processes=2)
    assert found.results == {"right": 7}
    assert "cannot pickle '_thread.lock' object" in found.failures["lock"]


def test_processes_import_nothing_of_the_current_directory(tmp_path, monkeypatch):
    (tmp_path / "multiprocessing.py").write_text("raise SystemExit('a module of the current directory')")
    monkeypatch.chdir(tmp_path)
    before = dict(os.environ)
    assert run_jobs([Job("right", 1.0, os.getenv, ("OMP_NUM_THREADS",))]).results == {"right": "1"}
    assert os.environ == before


def test_progress_ends_at_all_of_the_cost():
    reports = []
    run_jobs([Job(f"{k}", float(k), abs, (k,)) for k in range(1, 4)], 2, lambda *report: reports.append(report))
    assert sum(cost for cost, _ in reports) == 6.0
    assert reports[0] == (0.0, ("3", "2"))
    assert reports[-1][1] == ()


@pytest.mark.parametrize("processes", [1, 2])
def test_an_option_that_a_job_cannot_use_ends_all(processes):
    """No other job can use it, and the command says by its exit code that the option is wrong."""
    jobs = [Job("endless", 1.0, signal.pause), Job("refused", 2.0, claim_folder, (Path("/dev/null/x"),))]
    with pytest.raises(OptionError, match=r"^--output: cannot write in /dev/null/x"):
        run_jobs(jobs, processes)


PROGRAM = """
import signal
from ps_fmu.analyses.jobs import Job, run_jobs
bar = Job("bar", 3.0, exec, ("from tqdm import tqdm; tqdm(())",))
jobs = [bar, Job("a", 2.0, signal.pause), Job("b", 1.0, signal.pause)]
run_jobs(jobs, 2, lambda *report: print(report, flush=True))
"""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGKILL])
def test_no_process_outlives_the_program(number, tmp_path):
    """Jobs in the middle of their work end, too."""
    command = [sys.executable, "-I", "-c", PROGRAM]
    environment = {**os.environ, "TMPDIR": str(tmp_path)}
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment
    ) as program:
        while program.stdout.readline() != "(0.0, ('a', 'b'))\n":
            assert program.poll() is None
        started = psutil.Process(program.pid).children()
        assert len(started) == 3  # the two, and what multiprocessing has beside them
        assert all("-I" in process.cmdline() for process in started)
        program.send_signal(number)
        said = program.communicate(timeout=300)[1]
    assert psutil.wait_procs(started, timeout=300)[1] == []
    if number == signal.SIGINT:
        assert not list(tmp_path.iterdir())
        assert "leaked" not in said
