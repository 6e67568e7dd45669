"""Jobs in processes that start once."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import psutil
import pytest

from ps_fmu.paper.jobs import Job, JobError, run_jobs
from ps_fmu.runs.options import OptionError, claim_folder


def names(found):
    return [stretch.job for stretch in sorted(found.timeline, key=lambda stretch: stretch.start_s)]


def test_a_job_takes_the_results_of_others():
    jobs = [Job("all", 9.0, sorted, after=("two", "one")), Job("one", 1.0, abs, (-1,)), Job("two", 2.0, abs, (-2,))]
    found = run_jobs(jobs, processes=2)
    assert found.results == {"one": 1, "two": 2, "all": ["one", "two"]}
    assert names(found)[-1] == "all"


@pytest.mark.parametrize("processes", [1, 2])
def test_the_longest_begin_first(processes):
    found = run_jobs([Job(f"{k}", float(k), abs, (k,)) for k in range(5)], processes)
    assert names(found) == ["4", "3", "2", "1", "0"]


def test_processes_are_others_and_serve_many_jobs():
    found = run_jobs([Job(f"{k}", 1.0, os.getpid) for k in range(6)], processes=2)
    assert os.getpid() not in found.results.values()
    assert len(set(found.results.values())) <= 2


def test_a_job_alone_needs_no_other_process():
    assert run_jobs([Job("alone", 1.0, os.getpid)], processes=2).results == {"alone": os.getpid()}


@pytest.mark.parametrize("processes", [1, 2])
def test_a_job_that_fails_is_named_and_leaves_the_results_of_others(processes):
    jobs = [Job("wrong", 3.0, int, ("x",)), Job("right", 1.0, int, ("7",)), Job("after", 2.0, dict, (), ("wrong",))]
    found = run_jobs(jobs, processes)
    assert found.results == {"right": 7}
    with pytest.raises(JobError, match=r"wrong: ValueError: invalid literal.*'x'"):
        found.raise_failures()


def test_a_job_whose_process_ends_is_named_and_another_process_goes_on():
    found = run_jobs([Job("ends", 3.0, os._exit, (5,)), *(Job(f"{k}", 1.0, abs, (k,)) for k in range(4))], processes=2)
    assert found.failures == {"ends": "its process has ended: exit code 5"}
    assert found.results == {f"{k}": k for k in range(4)}


def test_a_process_that_is_killed_is_told(tmp_path):
    jobs = [Job("killed", 3.0, signal.raise_signal, (signal.SIGKILL,)), Job("right", 1.0, abs, (-7,))]
    found = run_jobs(jobs, processes=2)
    assert found.failures == {"killed": "its process has ended: signal SIGKILL"}
    assert found.results == {"right": 7}


def test_a_process_that_does_not_start_ends_its_jobs(monkeypatch):
    monkeypatch.setattr(sys, "executable", "/bin/false")
    found = run_jobs([Job("one", 1.0, abs, (1,)), Job("two", 1.0, abs, (2,))], processes=2)
    assert found.results == {}
    assert found.failures == dict.fromkeys(("one", "two"), "its process has ended: exit code 1")


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
from ps_fmu.paper.jobs import Job, run_jobs
run_jobs([Job("a", 1.0, signal.pause), Job("b", 1.0, signal.pause)], 2, lambda *report: print(report, flush=True))
"""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGKILL])
def test_no_process_outlives_the_program(number, tmp_path):
    """Jobs in the middle of their work end, too."""
    command = [sys.executable, "-I", "-c", PROGRAM]
    environment = {**os.environ, "TMPDIR": str(tmp_path)}
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment
    ) as program:
        assert program.stdout.readline() == "(0.0, ('a', 'b'))\n"
        started = psutil.Process(program.pid).children()
        assert len(started) == 2
        program.send_signal(number)
        program.wait(timeout=300)
    assert psutil.wait_procs(started, timeout=300)[1] == []
    assert number != signal.SIGINT or not list(tmp_path.iterdir())
