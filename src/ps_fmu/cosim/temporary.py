"""Temporary folders that do not outlive their process for long: the next one removes those of processes that are gone.

A folder holds a file that its process keeps locked.  Where that can be locked, its process has ended.  A folder without
the file, or of another user, is left alone.
"""

from __future__ import annotations

import os
import shutil
import stat
import sys
import tempfile
from collections.abc import Iterable
from pathlib import Path

LOCK = ".in-use"
PREFIXES = ("fmus_", "ssp_")

_locks: dict[Path, int] = {}
"""Descriptor of each folder's lock."""
_cleared: set[str] = set()
"""Folders for temporary files that this process has looked through."""


def make_temporary(prefix: str) -> Path:
    """A new folder for this process, after what killed processes have left has been removed, once.

    Give it back by :func:`remove_temporary`.  ``prefix``: one of :data:`PREFIXES`.
    """
    above = tempfile.gettempdir()
    if above not in _cleared:
        _cleared.add(above)
        for folder in _find_leftovers(above):
            shutil.rmtree(folder, ignore_errors=True)
    folder = Path(tempfile.mkdtemp(prefix=prefix))
    _lock(folder)
    return folder


def remove_temporary(folder: Path) -> None:
    """Remove a folder, and whatever is in it."""
    shutil.rmtree(folder, ignore_errors=True)
    descriptor = _locks.pop(folder, None)
    if descriptor is not None:
        os.close(descriptor)


def _lock(folder: Path) -> None:
    """Locked before it has its name, so that nobody sees it without its lock."""
    if sys.platform == "win32":
        return
    import fcntl

    file = folder / f"{LOCK}-new"
    descriptor = os.open(file, os.O_RDWR | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o600)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        file.rename(folder / LOCK)
    except OSError:  # a file system without locks: the folder stays if this process is killed
        os.close(descriptor)
        return
    _locks[folder] = descriptor


def _find_leftovers(above: str) -> Iterable[Path]:
    if sys.platform == "win32":
        return
    try:
        with os.scandir(above) as entries:
            names = [entry.name for entry in entries if entry.name.startswith(PREFIXES)]
    except OSError:  # one that all may write to and nobody may list
        return
    for name in names:
        folder = Path(above, name)
        if _is_own(folder) and _is_abandoned(folder / LOCK):
            yield folder


def _is_own(folder: Path) -> bool:
    try:
        found = folder.lstat()
    except OSError:
        return False
    return stat.S_ISDIR(found.st_mode) and found.st_uid == os.geteuid()


def _is_abandoned(lock: Path) -> bool:
    """Whether there is a lock, and nobody holds it."""
    import fcntl

    try:
        descriptor = os.open(lock, os.O_RDONLY | os.O_NOFOLLOW | os.O_CLOEXEC)
    except OSError:
        return False
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return False
    finally:
        os.close(descriptor)
    return True
