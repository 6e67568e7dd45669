"""What runs on the workers of a cluster.  They need ps_fmu; all else of the study comes to them."""

from __future__ import annotations

import json
import os
import shutil
import socket
import tempfile
import threading
from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ..terminal import reason
from .bundle import TASK, Bundle
from .case_process import CaseProcess
from .parts import FOLDER as PARTS
from .parts import encode_part, write_part
from .rows import Row, StartError, VersionError
from .signals import FOLDER, name_file
from .task import Task

MANIFEST = "manifest.json"  # in the output folder
Job = tuple[int, Mapping[str, Any]]
"""Index of a case, and its start values."""


@dataclass(frozen=True)
class Order:
    """What a worker is told besides its cases."""

    output: str
    """Output folder of the study, where a worker that sees it writes its parts."""
    plan_hash: str
    timeout_s: float | None
    stored: tuple[int, ...] = ()
    """Cases whose signals are stored."""


@dataclass(frozen=True)
class Done:
    """What comes back of a batch."""

    cases: int
    not_done: int
    """Cases whose status is not ``done``."""
    wall_s: float
    """Time of all cases together, s."""
    content: bytes | None
    """The part, where the worker does not see the output folder; None: it has written it."""
    signals: Mapping[int, bytes] = field(default_factory=dict)
    """The files of signals, by case, where the worker does not see the output folder."""


def keep(bundle: Bundle) -> Bundle:
    """The files of a study, as a task: workers get them from each other, and a lost copy is made anew."""
    return bundle


def run_batch(bundle: Bundle, jobs: Sequence[Job], order: Order) -> Done:
    """Run neighbouring cases, write their part.

    Raises :class:`.rows.StartError`, :class:`.rows.VersionError`, and ``OSError`` if the study's files, signals or the
    part cannot be written; all name the worker.
    """
    name = _name_worker()
    try:
        return _run_batch(name, bundle, jobs, order)
    except (StartError, VersionError) as error:
        raise type(error)(f"worker {name}: {error}") from error
    except OSError as error:
        raise OSError(f"worker {name}: {reason(error)}") from error


def _run_batch(name: str, bundle: Bundle, jobs: Sequence[Job], order: Order) -> Done:
    output = Path(order.output)
    here = sees(output, order.plan_hash)
    rows: list[Row] = []
    signals: dict[int, bytes] = {}
    with _borrow(bundle, order.timeout_s) as process:
        folder = (output if here else process.folder) / FOLDER
        files = {case: folder / name_file(case) for case in order.stored}
        if files:
            folder.mkdir(exist_ok=True)
        try:
            rows.extend({**row, "worker": name} for row in process.run(jobs, files))
        except (OSError, StartError):  # no room for signals, no process for the rest: what there is of rows is kept
            if here and rows:
                write_part(output, order.plan_hash, rows)
            raise
    if not here:
        signals = {case: path.read_bytes() for case, path in files.items() if path.exists()}
        for path in files.values():
            path.unlink(missing_ok=True)
    content: bytes | None = encode_part(rows)
    if here:
        write_part(output, order.plan_hash, rows, content)
        content = None
    not_done = sum(row["status"] != "done" for row in rows)
    return Done(len(rows), not_done, sum(row["wall_s"] for row in rows), content, signals)


def sees(output: Path, plan_hash: str) -> bool:
    """Whether this is the study's output folder also here, and parts can be written.

    On another machine the path may lead elsewhere, or to a share that is read only.
    """
    try:
        found = json.loads((output / MANIFEST).read_bytes())
    except (OSError, ValueError):
        return False
    own = isinstance(found, dict) and found.get("plan_sha256") == plan_hash
    return own and os.access(output / PARTS, os.W_OK)


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
