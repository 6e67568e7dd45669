"""Processes that run an FMU and tell the stages of its life as they begin and end: what crashes there does no harm.

They write a line ``["stage", problem]`` into a file: the problem is null when a stage begins, "" when it ended well.
"""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

TIME_LIMIT = 120.0  # s
_TAIL = 12  # different lines of output that a failure repeats
Result = tuple[str, str]
"""A stage and what went wrong in it; nothing if nothing did."""


def watch(
    command: Sequence[str], report: Path, environment: Mapping[str, str] | None = None, limit: float = TIME_LIMIT
) -> list[Result]:
    """Run a process that writes the file ``report``, in the folder of that; the stages that were begun, in order.

    ``environment``: all that the process gets, by default what this one has.  After ``limit`` s it is killed, with
    whatever it started.  Raises OSError if it cannot be started.
    """
    output = report.with_suffix(".output")
    with output.open("wb") as file:
        process = subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=file,
            stderr=file,
            cwd=report.parent,
            env=environment,
            start_new_session=True,
        )
        try:
            code: int | None = process.wait(limit)
        except subprocess.TimeoutExpired:
            code = None
        finally:
            _end(process)
    lines = report.read_text(encoding="utf-8", errors="replace").splitlines() if report.is_file() else []
    stages: dict[str, str | None] = dict(map(json.loads, lines)) or {"start": None}
    said = list(dict.fromkeys(output.read_text(encoding="utf-8", errors="replace").splitlines()))[-_TAIL:]
    results = []
    for stage, problem in stages.items():
        if problem is None and code == 0:
            problem = ""  # the last stage is the end of the process
        elif problem is None:
            problem = _ending(code, limit)
        results.append((stage, "\n".join([problem, *said]) if problem else ""))
    return results


def _end(process: subprocess.Popen[bytes]) -> None:
    """Kill what is left of a process and of those that it started."""
    if sys.platform == "win32":
        process.kill()
    else:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
    process.wait()


def _ending(code: int | None, limit: float) -> str:
    """Why a process is no more that never said how its last stage ended."""
    if code is None:
        return f"did not end within {limit:g} s"
    return f"the process was killed by {signal.Signals(-code).name}" if code < 0 else f"the process exited with {code}"
