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


def test_results_by_name_and_the_longest_first():
    ended = []
    jobs = [Job(f"{k}", float(k), abs, (-k,)) for k in range(5)]
    assert run_jobs(jobs, 1, ended.append) == {f"{k}": k for k in range(5)}
    assert [job.name for job in ended] == ["4", "3", "2", "1", "0"]


def test_processes_are_others_and_serve_many_jobs():
    found = run_jobs([Job(f"{k}", 1.0, os.getpid) for k in range(6)], processes=2)
    assert os.getpid() not in found.values()
    assert len(set(found.values())) <= 2


@pytest.mark.parametrize("processes", [1, 2])
def test_jobs_that_fail_are_named_and_do_not_end_the_others(processes):
    """One raises, of one the result cannot be sent."""
    ended = []
    jobs = [Job("wrong", 3.0, int, ("x",)), Job("lock", 2.0, threading.Lock), Job("right", 1.0, int, ("7",))]
    with pytest.raises(JobError, match=r"wrong: ValueError: invalid literal.*'x'.*") as failed:
        run_jobs(jobs, processes, ended.append)
    assert "lock: TypeError: cannot pickle '_thread.lock' object" in str(failed.value)
    assert "right" not in str(failed.value) and len(ended) == 3


@pytest.mark.parametrize(("function", "argument"), [(os._exit, 5), (signal.raise_signal, signal.SIGKILL)])
def test_a_process_that_ends_by_itself_fails_what_has_not_ended(function, argument):
    """Also the jobs that have not begun, and none of them hangs."""
    jobs = [Job("ends", 3.0, function, (argument,)), *(Job(f"{k}", 1.0, signal.pause) for k in range(3))]
    with pytest.raises(JobError) as failed:
        run_jobs(jobs, processes=2)
    assert sorted(str(failed.value).split("; ")) == [
        f"{name}: a process of the jobs has ended by itself" for name in ("0", "1", "2", "ends")
    ]


def test_processes_import_nothing_of_the_current_directory(tmp_path, monkeypatch):
    (tmp_path / "multiprocessing.py").write_text("raise SystemExit('a module of the current directory')")
    monkeypatch.chdir(tmp_path)
    before = dict(os.environ)
    assert run_jobs([Job("right", 1.0, os.getenv, ("OMP_NUM_THREADS",))]) == {"right": "1"}
    assert os.environ == before


@pytest.mark.parametrize("processes", [1, 2])
def test_an_option_that_a_job_cannot_use_ends_all(processes):
    """No other job can use it, and the command says by its exit code that the option is wrong."""
    jobs = [Job("endless", 1.0, signal.pause), Job("refused", 2.0, claim_folder, (Path("/dev/null/x"),))]
    with pytest.raises(OptionError, match=r"^--output: cannot write in /dev/null/x"):
        run_jobs(jobs, processes)


PROGRAM = """
import signal
from ps_fmu.analyses.jobs import Job, run_jobs
bars = [Job(f"bar {k}", 3.0, exec, ("from tqdm import tqdm; tqdm(())",)) for k in (1, 2)]
jobs = [*bars, Job("a", 2.0, signal.pause), Job("b", 1.0, signal.pause)]
run_jobs(jobs, 2, lambda job: print(job.name, flush=True))
"""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGKILL])
def test_no_process_outlives_the_program(number, tmp_path):
    """Jobs in the middle of their work end, too."""
    command = [sys.executable, "-I", "-c", PROGRAM]
    environment = {**os.environ, "TMPDIR": str(tmp_path)}
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment
    ) as program:
        assert {program.stdout.readline() for _ in range(2)} == {"bar 1\n", "bar 2\n"}
        started = psutil.Process(program.pid).children()
        assert len(started) == 3  # the two, and what multiprocessing has beside them
        assert all("-I" in process.cmdline() for process in started)
        program.send_signal(number)
        said = program.communicate(timeout=300)[1]
    assert psutil.wait_procs(started, timeout=300)[1] == []
    if number == signal.SIGINT:
        assert not list(tmp_path.iterdir())
        assert "leaked" not in said
