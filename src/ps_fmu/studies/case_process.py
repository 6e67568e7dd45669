"""Cases in a process of their own, which stays for many of them: whatever a case does, the caller gets a row."""

from __future__ import annotations

import json
import os
import selectors
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from types import MappingProxyType
from typing import IO, Any

from ..child_processes import ONE_THREAD, describe_end
from .rows import KILLED, LATE, LONGEST_TEXT, Row, StartError, VersionError

STARTS = 3  # tried before there is said to be none: somebody may end a process while it starts, too
START_LIMIT_S = 300.0  # FMUs may be on a slow disk; longer is no start
MEMORY_CHECK_S = 0.5
NO_SIGNALS: Mapping[int, Path] = MappingProxyType({})


class CaseProcess:
    """A process with the FMUs of a study.

    Parameters
    ----------
    folder: where the study's files are unpacked; the process keeps its temporary files there, too.
    timeout_s: of a case, s; None: none.
    memory_bytes: resident memory at which a case is ended; None: no limit.
    most_cases: after which the process is replaced; None: never.
    isolates: it has processes of FMUs beside it, whose memory counts, too.
    """

    def __init__(
        self,
        folder: Path,
        timeout_s: float | None = None,
        memory_bytes: int | None = None,
        most_cases: int | None = None,
        isolates: bool = False,
    ) -> None:
        self._folder, self._timeout, self._memory = folder, timeout_s, memory_bytes
        self._wanted, self._isolates = most_cases, isolates
        self._left: int | None = None
        self._process: subprocess.Popen[bytes] | None = None
        self._printed: IO[bytes] | None = None
        self._buffer = b""

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
            job = {"case": index, "values": dict(values)}
            if index in signals:
                job["signals"] = str(signals[index])
            row = self._run_one(job)
            yield self._run_one(job) if row["status"] == KILLED else row

    def close(self) -> None:
        """End the process; safe to call twice."""
        process, self._process = self._process, None
        if process is not None:
            process.kill()
            process.wait()
            for pipe in (process.stdin, process.stdout):
                assert pipe is not None
                with suppress(BrokenPipeError):  # what it had not read yet
                    pipe.close()
        if self._printed is not None:
            self._printed.close()
            self._printed = None

    def _run_one(self, job: Mapping[str, Any]) -> Row:
        if self._left == 0:
            self.close()
        if self._process is None:
            self._start()
        if self._left is not None:
            self._left -= 1
        began = time.perf_counter()
        status = KILLED
        try:
            self._send(job)
            line = self._read_line(self._timeout)
            if line:
                answer = json.loads(line)
                if "stopped" in answer:
                    self.close()
                    raise OSError(answer["stopped"])
                if answer["last"]:
                    self.close()
                row: Row = answer["row"]
                return row
            error = self._explain_end()
        except TimeoutError:
            status, error = LATE, f"no result after {self._timeout:g} s: the process was ended"
        except MemoryError:
            error = f"the process was ended when it had {self._memory} bytes of memory"
        except BrokenPipeError:
            error = self._explain_end()
        self.close()
        return {"case": job["case"], "status": status, "error": error, "warnings": None,
                "wall_s": time.perf_counter() - began}  # fmt: skip

    def _start(self) -> None:
        for _ in range(STARTS):
            answer, printed = self._try_to_start()
            if "ready" in answer:
                self._left = self._wanted
                return
            self.close()
            if "refused" in answer:
                raise VersionError(answer["refused"])
        raise StartError(f"the process for the cases does not start: {printed}")

    def _try_to_start(self) -> tuple[dict[str, Any], str]:
        """The first answer of a new process; without one, how it ended."""
        self._printed = tempfile.TemporaryFile(dir=self._folder)  # noqa: SIM115
        self._buffer = b""
        self._process = subprocess.Popen(
            [sys.executable, "-I", "-m", "ps_fmu.studies.child", str(self._folder)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._printed,
            env={**os.environ, **ONE_THREAD, "TMPDIR": str(self._folder)},
            start_new_session=True,  # Ctrl-C ends the study, which ends the processes in order
        )
        try:
            line = self._read_line(START_LIMIT_S)
        except TimeoutError:
            return {}, f"it is not ready after {START_LIMIT_S:g} s"
        return (json.loads(line), "") if line else ({}, self._explain_end())

    def _send(self, job: Mapping[str, Any]) -> None:
        assert self._process is not None and self._process.stdin is not None
        self._process.stdin.write(json.dumps(job).encode() + b"\n")
        self._process.stdin.flush()

    def _read_line(self, limit_s: float | None) -> bytes:
        """The next line; nothing if the process has ended.

        Raises TimeoutError, and MemoryError where the process has more than it may.
        """
        assert self._process is not None and self._process.stdout is not None
        end = None if limit_s is None else time.monotonic() + limit_s
        with selectors.DefaultSelector() as selector:
            selector.register(self._process.stdout, selectors.EVENT_READ)
            while b"\n" not in self._buffer:
                left = None if end is None else end - time.monotonic()
                if left is not None and left <= 0.0:
                    raise TimeoutError
                if self._memory is not None:
                    self._check_memory()
                    left = min(MEMORY_CHECK_S, MEMORY_CHECK_S if left is None else left)
                if not selector.select(left):
                    continue
                part = os.read(self._process.stdout.fileno(), 1 << 16)
                if not part:
                    return b""
                self._buffer += part
        line, _, self._buffer = self._buffer.partition(b"\n")
        return line

    def _check_memory(self) -> None:
        import psutil

        assert self._process is not None and self._memory is not None
        try:
            own = psutil.Process(self._process.pid)
            used = sum(one.memory_info().rss for one in [own, *(own.children() if self._isolates else ())])
        except psutil.Error:  # it has ended: the pipe will say so
            return
        if used > self._memory:
            raise MemoryError

    def _explain_end(self) -> str:
        """How the process ended, and the last that it printed."""
        assert self._process is not None and self._printed is not None
        try:
            code = self._process.wait(timeout=5.0)
        except subprocess.TimeoutExpired:
            return "the process closed its output"
        how = describe_end(code)
        self._printed.seek(0)
        printed = self._printed.read().decode("utf-8", errors="replace").strip()
        return f"{how}; it printed: {printed[-LONGEST_TEXT:]}" if printed else how
