"""What runs on the workers of a cluster.  They need ps_fmu; all else of the study comes to them."""

from __future__ import annotations

import multiprocessing
import os
import shutil
import signal
import socket
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import IO, TYPE_CHECKING, Any

from ..child_processes import ONE_THREAD, describe_end, end_with_parent
from ..terminal import reason
from .bundle import TASK, Bundle, Task
from .rows import KILLED, LATE, LONGEST_TEXT, Row, StartError, VersionError, name_file

if TYPE_CHECKING:
    from multiprocessing.process import BaseProcess

    from .case_runner import CaseRunner


STARTS = 3  # tried before there is said to be none: somebody may end a process while it starts, too
START_LIMIT_S = 300.0  # FMUs may be on a slow disk; longer is no start
MEMORY_CHECK_S = 0.5
NO_SIGNALS: Mapping[int, Path] = MappingProxyType({})
Job = tuple[int, Mapping[str, Any]]
"""Index of a case, and its start values."""


class CaseProcess:
    """A process with the FMUs of a study.

    Parameters
    ----------
    folder: where the study's files are unpacked; the process keeps its temporary files there, too.
    timeout_s: of a case, s; None: none.
    memory_bytes: resident memory at which a case is ended; None: no limit.
    isolates: it has processes of FMUs beside it, whose memory counts, too.
    """

    def __init__(
        self, folder: Path, timeout_s: float | None = None, memory_bytes: int | None = None, isolates: bool = False
    ) -> None:
        self._folder, self._timeout, self._memory, self._isolates = folder, timeout_s, memory_bytes, isolates
        self._pool: ProcessPoolExecutor | None = None
        self._process: BaseProcess | None = None
        self._printed: IO[bytes] | None = None

    @property
    def pid(self) -> int | None:
        """Of the process; None while there is none."""
        return None if self._process is None else self._process.pid

    @property
    def folder(self) -> Path:
        """Of the study's files and of temporary ones."""
        return self._folder

    def run(
        self, jobs: Iterable[tuple[int, Mapping[str, Any]]], signals: Mapping[int, Path] = NO_SIGNALS
    ) -> Iterator[Row]:
        """The row of each case, from its index and its start values; ``signals``: files for those of some cases.

        A case that ends its process is tried once more: somebody else may have ended it.  Raises
        :class:`.rows.StartError`, or :class:`.rows.VersionError`, if no case can be run here, and ``OSError`` if its
        signals cannot be written.
        """
        for index, values in jobs:
            row = self._run_one(index, dict(values), signals.get(index))
            yield self._run_one(index, dict(values), signals.get(index)) if row["status"] == KILLED else row

    def close(self) -> None:
        """End the process; safe to call twice."""
        pool, self._pool = self._pool, None
        if pool is not None:
            if self._process is not None and self._process.pid is not None:
                with suppress(ProcessLookupError):
                    os.kill(self._process.pid, signal.SIGKILL)
            pool.shutdown(wait=self._process is not None)  # one that does not start is not waited for
        self._process = None
        if self._printed is not None:
            self._printed.close()
            self._printed = None

    def _run_one(self, index: int, values: Mapping[str, Any], signals: Path | None) -> Row:
        if self._pool is None:
            self._start()
        began, status = time.perf_counter(), KILLED
        try:
            row, last, problem = self._ask(self._timeout, _run_case, index, values, signals)
            if last:
                self.close()
            if problem is not None:
                raise OSError(problem)
            found: Row = row
            return found
        except TimeoutError:
            status, error = LATE, f"no result after {self._timeout:g} s: the process was ended"
        except MemoryError:
            error = f"the process was ended when it had {self._memory} bytes of memory"
        except BrokenProcessPool:
            error = self._explain_end()
        self.close()
        return {"case": index, "status": status, "error": error, "warnings": None,
                "wall_s": time.perf_counter() - began}  # fmt: skip

    def _start(self) -> None:
        problem = ""
        for _ in range(STARTS):
            try:
                self._try_to_start()
                return
            except BrokenProcessPool:
                problem = self._explain_end()
            except TimeoutError:
                problem = f"it is not ready after {START_LIMIT_S:g} s"
            except BaseException:
                self.close()
                raise
            self.close()
        raise StartError(f"the process for the cases does not start: {problem}")

    def _try_to_start(self) -> None:
        own = multiprocessing.current_process()
        if own.daemon:  # as the workers of dask are: multiprocessing would let it have no children
            own.daemon = False
        os.environ.update(ONE_THREAD)  # before the process imports numpy
        self._printed = tempfile.NamedTemporaryFile(dir=self._folder)  # noqa: SIM115
        context = multiprocessing.get_context("spawn")
        self._pool = ProcessPoolExecutor(1, context, _prepare, (str(self._folder), self._printed.name))
        pid = self._ask(START_LIMIT_S, os.getpid)
        self._process = next(child for child in multiprocessing.active_children() if child.pid == pid)
        self._ask(START_LIMIT_S, _load, self._folder)

    def _ask(self, limit_s: float | None, function: Callable[..., Any], *arguments: Any) -> Any:
        """What a function returns in the process.

        Raises what it raises, BrokenProcessPool if the process ends, TimeoutError, and MemoryError where the process
        has more than it may.
        """
        assert self._pool is not None
        answer: Future[Any] = self._pool.submit(function, *arguments)
        end = None if limit_s is None else time.monotonic() + limit_s
        while True:
            left = None if end is None else max(0.0, end - time.monotonic())
            wait = left if self._memory is None else min(MEMORY_CHECK_S, MEMORY_CHECK_S if left is None else left)
            try:
                return answer.result(wait)
            except TimeoutError:
                if end is not None and time.monotonic() >= end:
                    raise
                self._check_memory()

    def _check_memory(self) -> None:
        import psutil

        if self._memory is None or self._process is None:
            return
        try:
            own = psutil.Process(self._process.pid)
            used = sum(one.memory_info().rss for one in [own, *(own.children() if self._isolates else ())])
        except psutil.Error:  # it has ended: the pool will say so
            return
        if used > self._memory:
            raise MemoryError

    def _explain_end(self) -> str:
        """How the process ended, and the last that it printed."""
        assert self._pool is not None and self._printed is not None
        self._pool.shutdown()  # its thread takes the exit code from the system
        code = None if self._process is None else self._process.exitcode
        how = "it ended before it was ready" if code is None else describe_end(code)
        self._printed.seek(0)
        printed = self._printed.read().decode("utf-8", errors="replace").strip()
        return f"{how}; it printed: {printed[-LONGEST_TEXT:]}" if printed else how


_runner: CaseRunner | None = None
"""In the process for the cases."""


def _prepare(folder: str, printed: str) -> None:
    """Begin the process for the cases: what an FMU prints goes to the file ``printed``."""
    os.setsid()  # Ctrl-C ends the study, which ends the processes in order
    end_with_parent()
    file = os.open(printed, os.O_WRONLY | os.O_APPEND)
    for stream in (sys.stdout, sys.stderr):
        os.dup2(file, stream.fileno())
    os.environ["TMPDIR"] = tempfile.tempdir = folder


def _load(folder: Path) -> None:
    """Load the FMUs of a study."""
    global _runner
    from .case_runner import CaseRunner

    try:
        _runner = CaseRunner(folder)
    except VersionError:
        raise
    except Exception as error:  # of a class that may not travel
        text = f"the process for the cases does not start: {type(error).__name__}: {reason(error)}"
        raise StartError(text) from None


def _run_case(index: int, values: Mapping[str, Any], signals: Path | None) -> tuple[Row | None, bool, str | None]:
    """The row of a case, whether the process has to end, and what keeps any case from going on, as a full disk does."""
    from ..cosim import RecorderError

    assert _runner is not None
    try:
        return _runner.run(index, values, signals), _runner.must_end, None
    except (RecorderError, OSError) as error:
        return None, True, reason(error)


@dataclass(frozen=True)
class Done:
    """What comes back of a batch."""

    rows: Sequence[Row]
    signals: Mapping[int, bytes]
    """The files of signals, by case."""


def keep(bundle: Bundle) -> Bundle:
    """The files of a study, as a task: workers get them from each other, and a lost copy is made anew."""
    return bundle


def run_batch(bundle: Bundle, jobs: Sequence[Job], timeout_s: float | None, stored: Collection[int] = ()) -> Done:
    """Run cases; ``stored`` are those of them whose signals are stored.

    Raises :class:`.rows.StartError`, :class:`.rows.VersionError`, and ``OSError`` if the study's files or signals
    cannot be written; all name the worker.
    """
    name = _name_worker()
    try:
        with _borrow(bundle, timeout_s) as process:
            files = {case: process.folder / name_file(case) for case in stored}
            try:
                rows = [{**row, "worker": name} for row in process.run(jobs, files)]
                return Done(rows, {case: path.read_bytes() for case, path in files.items() if path.exists()})
            finally:
                for path in files.values():
                    path.unlink(missing_ok=True)
    except (StartError, VersionError) as error:
        raise type(error)(f"worker {name}: {error}") from error
    except OSError as error:
        raise OSError(f"worker {name}: {reason(error)}") from error


_LOCK = threading.Lock()
_FOLDERS: dict[str, Path] = {}
_BUSY: Counter[str] = Counter()
"""Batches of each study that run now: their folders stay."""
_IDLE: dict[tuple[str, float | None], list[CaseProcess]] = {}
"""Warm processes by study: a worker with several threads has one for each."""


@contextmanager
def _borrow(bundle: Bundle, timeout_s: float | None) -> Any:
    """A process with the FMUs of the study loaded, for the body."""
    key = bundle.sha256, timeout_s
    with _LOCK:
        for other in [other for other in _IDLE if other != key]:  # another study's: one at a time keeps memory low
            for process in _IDLE.pop(other):
                process.close()
        for study in [study for study in _FOLDERS if study != bundle.sha256 and not _BUSY[study]]:
            shutil.rmtree(_FOLDERS.pop(study), ignore_errors=True)
        idle = _IDLE.setdefault(key, [])
        found = idle.pop() if idle else None
        if found is None:
            if bundle.sha256 not in _FOLDERS:
                _FOLDERS[bundle.sha256] = bundle.unpack(_find_scratch())
            isolates = Task.from_json(bundle.files[TASK]).isolation is not None
            found = CaseProcess(_FOLDERS[bundle.sha256], timeout_s, _find_memory_limit(), isolates=isolates)
        _BUSY[bundle.sha256] += 1
    try:
        yield found
    except BaseException:
        found.close()
        with _LOCK:
            _BUSY[bundle.sha256] -= 1
        raise
    with _LOCK:
        _BUSY[bundle.sha256] -= 1
        _IDLE.setdefault(key, []).append(found)


def _find_worker() -> Any:
    """The dask worker that this runs in; None elsewhere."""
    try:
        from distributed import get_worker
    except ImportError:
        return None
    try:
        return get_worker()
    except ValueError:
        return None


def _find_scratch() -> Path:
    """The worker's own folder, which dask removes also after a crash."""
    worker = _find_worker()
    return Path(tempfile.gettempdir() if worker is None else worker.local_directory)


def _find_memory_limit() -> int | None:
    worker = _find_worker()
    limit = None if worker is None else worker.memory_manager.memory_limit
    return int(limit) if limit else None


def _name_worker() -> str:
    worker = _find_worker()
    return f"{socket.gethostname()}:{os.getpid()}" if worker is None else f"{worker.name}@{socket.gethostname()}"
