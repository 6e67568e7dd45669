"""Jobs in other processes: the longest first, on all processors.

A process runs one job after the other, so that what it has imported and cached serves the next ones.
"""

from __future__ import annotations

import os
import tempfile
import threading
import traceback
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing import active_children, get_context
from pathlib import Path
from typing import Any

from tqdm import tqdm

from ..child_processes import ONE_THREAD, end_with_parent
from ..runs.options import OptionError
from ..terminal import block_interrupts, reason


class JobError(RuntimeError):
    """Jobs that failed: names and errors."""


@dataclass(frozen=True)
class Job:
    """A function to call in another process."""

    name: str  # what a failure is told by
    cost_s: float  # of one processor, roughly: for the order and the remaining time alone
    function: Callable[..., Any]  # of a module, so that another process can import it
    arguments: tuple[Any, ...] = ()


def run_jobs(
    jobs: Iterable[Job], processes: int | None = None, report: Callable[[Job], object] | None = None
) -> dict[str, Any]:
    """The results by name of jobs in ``processes``, by default one for each processor.

    ``report`` gets each job when it has ended.  A job that fails does not end the others; a process that ends by
    itself, as one that the system kills, fails all that have not ended.

    Raises
    ------
    JobError: jobs failed; when all have ended.
    OptionError: as soon as a job raises it: the option is wrong for all of them.
    """
    waiting = sorted(jobs, key=lambda job: -job.cost_s)
    results: dict[str, Any] = {}
    failures = []
    with _start_pool(max(1, min(processes or os.cpu_count() or 1, len(waiting)))) as pool:
        with block_interrupts():  # a terminal sends Ctrl-C to all processes: this one ends the others
            futures = {pool.submit(_call, job): job for job in waiting}
        for future in as_completed(futures):
            job = futures[future]
            try:
                results[job.name] = future.result()
            except OptionError:
                raise
            except BrokenProcessPool:
                failures.append(f"{job.name}: a process of the jobs has ended by itself")
            except JobError as error:
                failures.append(f"{job.name}: {error}")
            except Exception as error:  # the result cannot be sent
                failures.append(f"{job.name}: {type(error).__name__}: {reason(error)}")
            if report:
                report(job)
    if failures:
        raise JobError("; ".join(failures))
    return results


def _call(job: Job) -> Any:
    """Call the function; what it raises is told by its text and place, since not every error can be sent."""
    try:
        return job.function(*job.arguments)
    except OptionError:
        raise
    except Exception as error:
        place = traceback.extract_tb(error.__traceback__)[-1]
        text = f"{type(error).__name__}: {reason(error)} ({Path(place.filename).name}:{place.lineno})"
        raise JobError(text) from None


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
