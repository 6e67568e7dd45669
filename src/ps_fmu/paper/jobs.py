"""Jobs in processes that start once: the longest first, on all processors, with the time that remains.

A process of the pool runs one job after the other, so that what it has imported and cached serves the next ones.  It
is started with ``-I`` and ends with this process; its end of a pipe is all that it has of it.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
import traceback
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import dataclass, field
from multiprocessing import Pipe
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import Any, Protocol

from ..child_processes import ONE_THREAD, describe_end
from ..runs.options import OptionError
from ..terminal import reason


class JobError(RuntimeError):
    """Jobs that failed: names and errors."""


@dataclass(frozen=True)
class Job:
    """A function to call in a process of its own."""

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
class Stretch:
    """When a job ran, and where."""

    job: str
    worker: int
    start_s: float
    """Since the pool was started."""
    end_s: float


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
    timeline: list[Stretch] = field(default_factory=list)

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

    A process that ends by itself fails the job that it ran, and another one takes its place.  Where there is one
    processor or one job alone, this process runs them.  Raises OptionError as soon as a job does: the option is wrong
    for all of them.
    """
    waiting = sorted(jobs, key=lambda job: -job.cost_s)
    outcomes = Outcomes()
    count = min(processes or os.cpu_count() or 1, len(waiting))
    with _start_pool(count) if count > 1 else nullcontext(_Here()) as pool:
        while True:
            _hand_out(waiting, pool, outcomes)
            if not pool.busy:
                return outcomes
            if report:
                report(0.0, pool.running)
            for job in pool.collect(outcomes):
                if report:
                    report(job.cost_s, pool.running)


def call(function: Callable[..., Any], arguments: tuple[Any, ...]) -> Answer:
    """Call the function of a job."""
    try:
        return Answer(function(*arguments))
    except OptionError as error:
        return Answer(error=str(error), refused=True)
    except Exception as error:
        place = traceback.extract_tb(error.__traceback__)[-1]
        return Answer(error=f"{type(error).__name__}: {reason(error)} ({Path(place.filename).name}:{place.lineno})")


def _hand_out(waiting: list[Job], pool: _Workers, outcomes: Outcomes) -> None:
    """Give free processes the longest of the jobs that can begin."""
    for job in [job for job in waiting if set(job.after) <= outcomes.results.keys()]:
        if not pool.has_free:
            return
        waiting.remove(job)
        earlier = ({name: outcomes.results[name] for name in job.after},) if job.after else ()
        pool.begin(job, (*job.arguments, *earlier))


@dataclass
class _Worker:
    number: int
    process: subprocess.Popen[bytes]
    connection: Connection
    job: Job | None = None
    began: float = 0.0


class _Workers(Protocol):
    """What runs jobs."""

    @property
    def busy(self) -> Sequence[object]:
        """Those that run a job."""

    @property
    def running(self) -> tuple[str, ...]:
        """Names of the jobs that run."""

    @property
    def has_free(self) -> bool:
        """Whether another job can begin."""

    def begin(self, job: Job, arguments: tuple[Any, ...]) -> None:
        """Begin a job."""

    def collect(self, outcomes: Outcomes) -> Iterator[Job]:
        """Wait until a job has ended, and note what it left; the jobs that have ended."""


class _Here:
    """This process, which runs a job when its result is asked for."""

    def __init__(self) -> None:
        self.busy: list[tuple[Job, tuple[Any, ...]]] = []
        self._began = time.perf_counter()

    @property
    def running(self) -> tuple[str, ...]:
        """Name of the job that runs."""
        return tuple(job.name for job, _ in self.busy)

    @property
    def has_free(self) -> bool:
        """Whether there is nothing to do."""
        return not self.busy

    def begin(self, job: Job, arguments: tuple[Any, ...]) -> None:
        """Have a job run next."""
        self.busy.append((job, arguments))

    def collect(self, outcomes: Outcomes) -> Iterator[Job]:
        """Run the job."""
        job, arguments = self.busy.pop()
        start = time.perf_counter()
        outcomes.note(job, call(job.function, arguments))
        outcomes.timeline.append(Stretch(job.name, 0, start - self._began, time.perf_counter() - self._began))
        yield job


class _Pool:
    """Processes, and what each of them does.  ``folder``: of their temporary files."""

    def __init__(self, count: int, folder: str) -> None:
        self._folder = folder
        self._began = time.perf_counter()
        self._workers: list[_Worker] = []
        for number in range(count):
            self._workers.append(self._start(number))

    @property
    def busy(self) -> list[_Worker]:
        """Those that run a job."""
        return [worker for worker in self._workers if worker.job]

    @property
    def running(self) -> tuple[str, ...]:
        """Names of the jobs that run."""
        return tuple(worker.job.name for worker in self._workers if worker.job)

    @property
    def has_free(self) -> bool:
        """Whether a process has nothing to do."""
        return any(worker.job is None for worker in self._workers)

    def begin(self, job: Job, arguments: tuple[Any, ...]) -> None:
        """Run a job in a process that is free."""
        worker = next(worker for worker in self._workers if worker.job is None)
        worker.job, worker.began = job, time.perf_counter()
        with suppress(ConnectionError):  # its process has ended: the connection is at its end, which says so
            worker.connection.send((job.function, arguments))

    def collect(self, outcomes: Outcomes) -> Iterator[Job]:
        """Wait until a job has ended, and note what it left; the jobs that have ended."""
        ready = wait([worker.connection for worker in self.busy])
        for worker in [worker for worker in self.busy if worker.connection in ready]:
            job, worker.job = worker.job, None
            assert job is not None
            try:
                answer = worker.connection.recv()
            except (EOFError, OSError):
                worker.connection.close()
                answer = Answer(error=f"its process has ended: {describe_end(worker.process.wait())}")
                self._workers[worker.number] = self._start(worker.number)
            outcomes.note(job, answer)
            now = time.perf_counter()
            outcomes.timeline.append(Stretch(job.name, worker.number, worker.began - self._began, now - self._began))
            yield job

    def close(self) -> None:
        """End all processes, also those that run a job."""
        for worker in self._workers:
            worker.process.kill()
            worker.connection.close()
        for worker in self._workers:
            worker.process.wait()

    def _start(self, number: int) -> _Worker:
        own, others = Pipe()
        with others:
            process = subprocess.Popen(
                [sys.executable, "-I", "-m", "ps_fmu.paper.job_process", str(os.getpid()), str(others.fileno())],
                stdin=subprocess.DEVNULL,
                pass_fds=[others.fileno()],
                env={**os.environ, **ONE_THREAD, "MPLBACKEND": "Agg", "TMPDIR": self._folder},
                start_new_session=True,  # Ctrl-C ends this process, which ends the others
            )
        return _Worker(number, process, own)


@contextmanager
def _start_pool(count: int) -> Iterator[_Pool]:
    with tempfile.TemporaryDirectory(prefix="jobs_") as folder:
        pool = _Pool(count, folder)
        try:
            yield pool
        finally:
            pool.close()
