"""What runs on the workers of a cluster.  They need ps_fmu; all else of the study comes to them."""

from __future__ import annotations

import json
import os
import socket
import tempfile
import threading
from collections.abc import Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from .bundle import Bundle
from .case_process import CaseProcess
from .parts import encode_part, write_part
from .rows import Row

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


def keep(bundle: Bundle) -> Bundle:
    """The files of a study, as a task: workers get them from each other, and a lost copy is made anew."""
    return bundle


def run_batch(bundle: Bundle, jobs: Sequence[Job], order: Order) -> Done:
    """Run neighbouring cases, write their part.

    Raises :class:`.rows.StartError`, :class:`.rows.VersionError`, and ``OSError`` if the part cannot be written.
    """
    name = _name_worker()
    with _borrow(bundle, order.timeout_s) as process:
        rows: list[Row] = [{**row, "worker": name} for row in process.run(jobs)]
    content: bytes | None = encode_part(rows)
    output = Path(order.output)
    if sees(output, order.plan_hash):
        write_part(output, order.plan_hash, rows, content)
        content = None
    not_done = sum(row["status"] != "done" for row in rows)
    return Done(len(rows), not_done, sum(row["wall_s"] for row in rows), content)


def sees(output: Path, plan_hash: str) -> bool:
    """Whether this is the study's output folder also here: on another machine the path may lead elsewhere."""
    try:
        found = json.loads((output / MANIFEST).read_bytes())
    except (OSError, ValueError):
        return False
    return isinstance(found, dict) and found.get("plan_sha256") == plan_hash


_LOCK = threading.Lock()
_FOLDERS: dict[str, Path] = {}
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
        idle = _IDLE.setdefault(key, [])
        found = idle.pop() if idle else None
        if found is None:
            if bundle.sha256 not in _FOLDERS:
                _FOLDERS[bundle.sha256] = bundle.unpack(_find_scratch())
            found = CaseProcess(_FOLDERS[bundle.sha256], timeout_s, _find_memory_limit())
    try:
        yield found
    except BaseException:
        found.close()
        raise
    with _LOCK:
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
