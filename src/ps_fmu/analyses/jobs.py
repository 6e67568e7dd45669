"""Jobs in other processes: the longest first, on all processors, with what runs and how much has ended.

A process runs one job after the other, so that what it has imported and cached serves the next ones.
"""

from __future__ import annotations

import os
import tempfile
import threading
import traceback
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from multiprocessing import active_children, get_context
from pathlib import Path
from typing import Any

from tqdm import tqdm

from ..child_processes import ONE_THREAD, end_with_parent
from ..runs.options import OptionError
from ..terminal import block_interrupts, reason

LOOK_S = 1.0
"""So long at most goes by until a process that has ended by itself is noticed [s]."""


class JobError(RuntimeError):
    """Jobs that failed: names and errors."""


@dataclass(frozen=True)
class Job:
    """A function to call in another process."""

    name: str
    """What a failure is told by."""
    cost_s: float
    """Seconds of one processor, roughly: for the order and the remaining time alone."""
    function: Callable[..., Any]
    """Of a module, so that another process can import it."""
    arguments: tuple[Any, ...] = ()
    after: tuple[str, ...] = ()
    """Names of the jobs whose results the function takes, too: a dictionary by name is its last argument."""


@dataclass(frozen=True)
class Answer:
    """What a job left: its result, or why there is none."""

    result: Any = None
    error: str | None = None
    refused: bool = False
    """An option cannot be used: ``error`` is the text of an OptionError."""


@dataclass
class Outcomes:
    """What jobs left."""

    results: dict[str, Any] = field(default_factory=dict)
    failures: dict[str, str] = field(default_factory=dict)
    """Errors by the name of the job; of a job that waits for one that failed, there is neither result nor error."""

    def note(self, job: Job, answer: Answer) -> None:
        """Keep the answer of a job.  Raises OptionError if the job did."""
        if answer.refused:
            raise OptionError(answer.error)
        if answer.error is None:
            self.results[job.name] = answer.result
        else:
            self.failures[job.name] = answer.error

    def raise_failures(self) -> None:
        """Raise :class:`JobError`, which names each job that failed, with its error."""
        if self.failures:
            raise JobError("; ".join(f"{name}: {error}" for name, error in self.failures.items()))


Report = Callable[[float, tuple[str, ...]], object]
"""Takes the cost of what has ended (s) and the names of what runs."""


def run_jobs(jobs: Iterable[Job], processes: int | None = None, report: Report | None = None) -> Outcomes:
    """Run jobs in ``processes``, by default one for each processor; one that fails does not end the others.

    A process that ends by itself, as one that the system kills, fails all jobs that have not ended.  Raises
    OptionError as soon as a job does: the option is wrong for all of them.
    """
    waiting = sorted(jobs, key=lambda job: -job.cost_s)
    outcomes = Outcomes()
    running: dict[Future[Answer], Job] = {}
    count = max(1, min(processes or os.cpu_count() or 1, len(waiting)))

    def tell(cost_s: float) -> None:
        if report:
            report(cost_s, tuple(job.name for job in running.values()))

    with _start_pool(count) as pool:
        while True:
            for job in [job for job in waiting if set(job.after) <= outcomes.results.keys()]:
                if len(running) == count:
                    break
                waiting.remove(job)
                running[_submit(pool, job, outcomes.results)] = job
            if not running:
                return outcomes
            tell(0.0)
            for future in _wait(pool, running):
                job = running.pop(future)
                outcomes.note(job, _read_answer(future))
                tell(job.cost_s)


def call(function: Callable[..., Any], arguments: tuple[Any, ...]) -> Answer:
    """Call the function of a job."""
    try:
        return Answer(function(*arguments))
    except OptionError as error:
        return Answer(error=str(error), refused=True)
    except Exception as error:
        place = traceback.extract_tb(error.__traceback__)[-1]
        return Answer(error=f"{type(error).__name__}: {reason(error)} ({Path(place.filename).name}:{place.lineno})")


def _submit(pool: ProcessPoolExecutor, job: Job, results: Mapping[str, Any]) -> Future[Answer]:
    """Hand a job to the pool, which starts a process for it if it has fewer than it may have."""
    earlier = ({name: results[name] for name in job.after},) if job.after else ()
    try:
        with block_interrupts():  # a terminal sends Ctrl-C to all processes: this one ends the others
            return pool.submit(call, job.function, (*job.arguments, *earlier))
    except BrokenProcessPool as error:
        failed: Future[Answer] = Future()
        failed.set_exception(error)
        return failed


def _wait(pool: ProcessPoolExecutor, running: Iterable[Future[Answer]]) -> set[Future[Answer]]:
    """The jobs that have ended; at least one.

    The pool looks for processes that have ended when it is given something, or gets a result: one that it started in
    the moment in which it began to wait it would miss.
    """
    while not (ended := wait(running, LOOK_S, FIRST_COMPLETED).done):
        with suppress(BrokenProcessPool):  # then the next look finds that the jobs have failed
            pool.submit(int).cancel()
    return ended


def _read_answer(future: Future[Answer]) -> Answer:
    """The answer of a job that has ended, with its process or without."""
    try:
        return future.result()
    except BrokenProcessPool:
        return Answer(error="a process of the jobs has ended by itself")
    except Exception as error:  # the result cannot be sent
        return Answer(error=f"{type(error).__name__}: {reason(error)}")


@contextmanager
def _start_pool(count: int) -> Iterator[ProcessPoolExecutor]:
    """A pool of processes, which end with the body; those that still run a job are ended when it raises."""
    before = active_children()
    with tempfile.TemporaryDirectory(prefix="jobs_") as folder, _set_environment(folder):
        pool = ProcessPoolExecutor(count, get_context("spawn"), _prepare, (os.getpid(),))
        try:
            yield pool
        except BaseException:
            for process in active_children():
                if process not in before:
                    process.kill()
            raise
        finally:
            pool.shutdown(cancel_futures=True)


def _prepare(parent: int) -> None:
    """What a process does first; ``parent``: the process id of that which started it."""
    end_with_parent(parent)
    tqdm.set_lock(threading.RLock())  # its own would be a semaphore that a process that is ended leaves behind


@contextmanager
def _set_environment(folder: str) -> Iterator[None]:
    """The environment of the processes, which they inherit from here; ``folder``: of their temporary files.

    Python starts them with ``-c``: without PYTHONSAFEPATH they would import modules of the current directory first.
    Where this process was started with ``-I``, so are they.
    """
    before = dict(os.environ)
    os.environ.update(ONE_THREAD, MPLBACKEND="Agg", TMPDIR=folder, PYTHONSAFEPATH="1")
    try:
        yield
    finally:
        for name in os.environ.keys() - before.keys():
            del os.environ[name]
        os.environ.update(before)
