"""What runs on the workers of a cluster.  They need ps_fmu; all else of the study comes to them."""

from __future__ import annotations

import multiprocessing
import os
import shutil
import socket
import sys
import tempfile
import threading
import time
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from types import MappingProxyType
from typing import IO, Any

from ..child_processes import ONE_THREAD, describe_end, end_with_parent
from ..terminal import reason
from .bundle import TASK, Bundle, Task
from .rows import KILLED, LATE, LONGEST_TEXT, Row, StartError, VersionError, name_file

STARTS = 3  # tried before there is said to be none: somebody may end a process while it starts, too
START_LIMIT_S = 300.0  # FMUs may be on a slow disk; longer is no start
MEMORY_CHECK_S = 0.1  # as dask looks at its workers
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
        self.folder = folder
        self._timeout, self._memory, self._isolates = timeout_s, memory_bytes, isolates
        self._process: Any = None
        self._pipe: Connection | None = None
        self._printed: IO[bytes] | None = None

    @property
    def pid(self) -> int | None:
        """Of the process; None while there is none."""
        return None if self._process is None else int(self._process.pid)

    def run(self, jobs: Iterable[Job], signals: Mapping[int, Path] = NO_SIGNALS) -> Iterator[Row]:
        """The row of each case; ``signals``: files for those of some cases.

        A case that ends its process is tried once more: somebody else may have ended it.  Raises
        :class:`.rows.StartError`, or :class:`.rows.VersionError`, if no case can be run here, and ``OSError`` if its
        signals cannot be written.
        """
        for index, values in jobs:
            row = self._run_one(index, dict(values), signals.get(index))
            yield self._run_one(index, dict(values), signals.get(index)) if row["status"] == KILLED else row

    def close(self) -> None:
        """End the process; safe to call twice."""
        if self._process is not None:
            self._process.kill()
            self._process.join()
        for opened in (self._pipe, self._printed):
            if opened is not None:
                opened.close()
        self._process = self._pipe = self._printed = None

    def _run_one(self, index: int, values: Mapping[str, Any], signals: Path | None) -> Row:
        if self._process is None:
            self._start()
        began, status = time.perf_counter(), KILLED
        try:
            row, last = self._ask(self._timeout, (index, values, signals))
            if last:
                self.close()
            if isinstance(row, OSError):
                raise row
            found: Row = row
            return found
        except TimeoutError:
            status, error = LATE, f"no result after {self._timeout:g} s: the process was ended"
        except MemoryError:
            assert self._memory is not None
            error = (
                f"the process was ended when it took more than the {self._memory / 1e6:.0f} MB of memory that are left "
                "for it: expected a smaller case, or a larger --memory-limit of dask worker, or fewer --workers"
            )
        except EOFError:
            error = self._explain_end()
        self.close()
        return {"case": index, "status": status, "error": error, "warnings": None,
                "wall_s": time.perf_counter() - began}  # fmt: skip

    def _start(self) -> None:
        own = multiprocessing.current_process()
        if own.daemon:  # as the workers of dask are: multiprocessing would let it have no children
            own.daemon = False
        os.environ.update(ONE_THREAD)  # before the process imports numpy
        context = multiprocessing.get_context("spawn")
        for _ in range(STARTS):
            self._printed = tempfile.NamedTemporaryFile(dir=self.folder)  # noqa: SIM115
            self._pipe, theirs = context.Pipe()
            self._process = context.Process(target=_serve, args=(theirs, self.folder, self._printed.name), daemon=True)
            self._process.start()
            theirs.close()  # else there would be no end of it
            try:
                refused = self._ask(START_LIMIT_S)
                if refused is None:
                    return
                raise refused
            except TimeoutError:
                problem = f"it is not ready after {START_LIMIT_S:g} s"
            except EOFError:
                problem = self._explain_end()
            except BaseException:
                self.close()
                raise
            self.close()
        raise StartError(f"the process for the cases does not start: {problem}")

    def _ask(self, limit_s: float | None, question: object = None) -> Any:
        """What the process answers; without a question, what it says when it is ready.

        Raises EOFError if the process ends, TimeoutError, and MemoryError where the process has more than it may.
        """
        assert self._pipe is not None
        end = None if limit_s is None else time.monotonic() + limit_s
        try:
            if question is not None:
                self._pipe.send(question)
            while True:
                left = None if end is None else max(0.0, end - time.monotonic())
                wait = left if self._memory is None else min(MEMORY_CHECK_S, MEMORY_CHECK_S if left is None else left)
                if self._pipe.poll(wait):
                    return self._pipe.recv()
                if end is not None and time.monotonic() >= end:
                    raise TimeoutError
                self._check_memory()
        except (BrokenPipeError, ConnectionResetError) as error:
            raise EOFError from error

    def _check_memory(self) -> None:
        import psutil

        try:
            own = psutil.Process(self.pid)
            used = sum(one.memory_info().rss for one in [own, *(own.children() if self._isolates else ())])
        except psutil.Error:  # it has ended: the pipe will say so
            return
        if self._memory is not None and used > self._memory:
            raise MemoryError

    def _explain_end(self) -> str:
        """How the process ended, and the last that it printed."""
        assert self._printed is not None
        self._process.join()
        self._printed.seek(0)
        printed = self._printed.read().decode("utf-8", errors="replace").strip()
        how = describe_end(self._process.exitcode)
        return f"{how}; it printed: {printed[-LONGEST_TEXT:]}" if printed else how


def _serve(pipe: Connection, folder: Path, printed: str) -> None:
    """The process for the cases: says that it is ready, then answers with the row of each case.

    A row comes with whether it is the last; an ``OSError`` in its place keeps any case from going on, as a full disk
    does.  What an FMU prints goes to the file ``printed``.
    """
    os.setsid()  # Ctrl-C ends the study, which ends the processes in order
    end_with_parent()
    file = os.open(printed, os.O_WRONLY | os.O_APPEND)
    for stream in (sys.stdout, sys.stderr):
        os.dup2(file, stream.fileno())
    os.environ["TMPDIR"] = tempfile.tempdir = str(folder)
    from ..cosim import RecorderError
    from .case_runner import CaseRunner

    try:
        runner = CaseRunner(folder)
    except VersionError as error:
        pipe.send(error)
        return
    except Exception as error:  # of a class that may not travel
        pipe.send(StartError(f"the process for the cases does not start: {type(error).__name__}: {reason(error)}"))
        return
    pipe.send(None)
    while True:
        index, values, signals = pipe.recv()
        try:
            pipe.send((runner.run(index, values, signals), runner.must_end))
        except (RecorderError, OSError) as error:
            pipe.send((OSError(reason(error)), True))


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
    worker = _find_worker()
    host = socket.gethostname()
    name = f"{host}:{os.getpid()}" if worker is None else f"{worker.name}@{host}"
    try:
        process = _find_process(bundle, timeout_s, worker)
        files = {case: process.folder / name_file(case) for case in stored}
        try:
            rows = [{**row, "worker": name} for row in process.run(jobs, files)]
            return Done(rows, {case: path.read_bytes() for case, path in files.items() if path.exists()})
        except BaseException:
            process.close()
            raise
        finally:
            for path in files.values():
                path.unlink(missing_ok=True)
    except (StartError, VersionError) as error:
        raise type(error)(f"worker {name}: {error}") from error
    except OSError as error:
        raise OSError(f"worker {name}: {reason(error)}") from error


class _Own(threading.local):
    """What a thread of the worker keeps from batch to batch."""

    key: tuple[str, float | None] | None = None
    process: CaseProcess | None = None


_OWN = _Own()


def _find_process(bundle: Bundle, timeout_s: float | None, worker: Any) -> CaseProcess:
    """The process of this thread with the FMUs of the study loaded; that of a study before, and its files, go."""
    key = bundle.sha256, timeout_s
    if _OWN.process is not None and _OWN.key != key:
        _OWN.process.close()
        shutil.rmtree(_OWN.process.folder, ignore_errors=True)
        _OWN.process = None
    if _OWN.process is None:
        # In the worker's own folder, which dask removes also after a crash.
        folder = bundle.unpack(Path(tempfile.gettempdir() if worker is None else worker.local_directory))
        isolates = Task.from_json(bundle.files[TASK]).isolation is not None
        _OWN.key, _OWN.process = key, CaseProcess(folder, timeout_s, _share_memory(worker), isolates)
    return _OWN.process


def _share_memory(worker: Any) -> int | None:
    """Bytes for the case of a thread, so that a worker keeps its limit with all of its cases; None without a limit."""
    limit = None if worker is None else worker.memory_manager.memory_limit
    if not limit:
        return None
    import psutil

    own = psutil.Process().memory_info().rss
    return max(0, (int(limit) - own) // worker.state.nthreads)


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
