"""Processes that run an FMU and report the stages of its life: a crash, or an exit, ends only such a process.

They write a line ``["stage", problem]`` into a file: the problem is null when a stage begins, "" when it ended well.
"""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path

from . import trial
from .errors import BuildError

TIME_LIMIT = 120.0  # s
_TAIL = 40  # different lines of output that a failure repeats
_MOST_OUTPUT = 1_000_000  # bytes of output that are read
END = "end of the process"
"""The last stage; a process that ends in another one was ended by the FMU."""
StageResult = tuple[str, str]
"""A stage and its problem; "" if it went well."""


class StateError(BuildError):
    """The FMU runs, but its states are not what it claims."""


def check_trial(fmu: Path) -> None:
    """A short life of an FMU that was just built, by itself.  Raises StateError if only states fail, or BuildError."""
    for stage, problem in live_in_fmpy(fmu, "brief"):
        if problem and stage in trial.STATES:
            raise StateError(" ".join(problem.splitlines()[0].split()))
        if problem:
            raise BuildError(f"{fmu.name} does not run by itself: {problem}")


def live_in_fmpy(fmu: Path, kind: str) -> list[StageResult]:
    """The stages of a life of this kind, see :mod:`.trial`; the first failure is the last stage."""
    with tempfile.TemporaryDirectory(prefix="fmu_life_") as folder:
        report = Path(folder, "report")
        command = [sys.executable, "-I", "-B", trial.__file__, kind, str(fmu.resolve()), folder, str(report)]
        return watch_stages(command, report)


def watch_stages(
    command: Sequence[str], report: Path, environment: Mapping[str, str] | None = None, limit: float = TIME_LIMIT
) -> list[StageResult]:
    """Run a process that writes the file ``report``; the stages that it began, in order.

    Parameters
    ----------
    command: the program and its arguments; it runs in the folder of ``report``.
    environment: of the process, by default that of this one.
    limit: s; after that time the process is killed, with the processes that it started.

    Raises OSError if the process cannot be started.
    """
    output = report.with_suffix(".output")
    with output.open("wb") as file:
        process = subprocess.Popen(
            command, stdin=subprocess.DEVNULL, stdout=file, stderr=file, cwd=report.parent, env=environment,
            start_new_session=True,
        )  # fmt: skip
        try:
            code: int | None = process.wait(limit)
        except subprocess.TimeoutExpired:
            code = None
        finally:
            _kill_group(process)
    lines = report.read_text(encoding="utf-8", errors="replace").split("\n")[:-1] if report.is_file() else []
    stages: dict[str, str | None] = dict(map(json.loads, lines)) or {"start": None}
    messages = list(dict.fromkeys(_read_end(output).splitlines()))[-_TAIL:]
    results = []
    for stage, problem in stages.items():
        if problem is None and code == 0 and stage == END:
            problem = ""
        elif problem is None:
            problem = _explain_end(code, limit)
        results.append((stage, "\n".join([problem, *messages]) if problem else ""))
    return results


def _read_end(path: Path) -> str:
    """The end of a text file, which an FMU may have filled with anything."""
    with path.open("rb") as file:
        file.seek(max(0, path.stat().st_size - _MOST_OUTPUT))
        return file.read(_MOST_OUTPUT).decode("utf-8", errors="replace")


def _kill_group(process: subprocess.Popen[bytes]) -> None:
    """Kill a process and the processes that it started."""
    if sys.platform == "win32":
        process.kill()
    else:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
    process.wait()


def _explain_end(code: int | None, limit: float) -> str:
    """Why a process ended within a stage."""
    if code is None:
        return f"did not end within {limit:g} s"
    return f"the process was killed by {signal.Signals(-code).name}" if code < 0 else f"the process exited with {code}"
