"""Temporary folders, and those that FMUs are unpacked into: one for each content in a process, removed at its end.

Each temporary folder has a lock of the process that made it: what a killed process has left, the next one removes.

So a library is loaded from one place only, however many systems use it.  What is in memory and on disk depends on the
number of different FMUs, not on how often they are instantiated.
"""

from __future__ import annotations

import itertools
import os
import shutil
import stat
import sys
import tempfile
import threading
from collections import Counter
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from multiprocessing.util import Finalize
from pathlib import Path

from fmpy import platform

from ..child_processes import collect_rarely
from ..files.archive import extract
from ..files.plain import compute_file_digest
from ..native import find_platform
from .errors import SystemFileError

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
    _lock_folder(folder)
    return folder


def remove_temporary(folder: Path) -> None:
    """Remove a folder, and whatever is in it."""
    shutil.rmtree(folder, ignore_errors=True)
    descriptor = _locks.pop(folder, None)
    if descriptor is not None:
        os.close(descriptor)


def _lock_folder(folder: Path) -> None:
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


_NUMBERS = itertools.count(1)
_SYSTEMS = ("linux", "win", "darwin")  # the names of platforms in FMI 2.0 begin with them
_KEPT = f"{find_platform()}/", "__pycache__/"  # in the folder ``native`` of an FMU of ps_fmu
_LAST = -100  # of multiprocessing's finalizers: after its child processes have been joined


@dataclass
class _Store:
    """The folders of one process."""

    process: int
    above: str
    """The folder for temporary files."""
    root: Path
    folders: dict[str, Path] = field(default_factory=dict)
    """Those that are handed out again, by SHA-256 of the archive."""
    sizes: dict[Path, dict[str, int]] = field(default_factory=dict)
    """Size of each file (bytes), by folder and then by path in it."""
    users: Counter[Path] = field(default_factory=Counter)


_lock = threading.Lock()
_imports_lock = threading.RLock()
_store: _Store | None = None


def provide_unpacked(archive: Path, shared: bool = True) -> Path:
    """The folder with the content of an archive; it is unpacked if this process has not done so yet.

    Parameters
    ----------
    archive: checked and unpacked by :func:`..files.archive.extract`, but for what only other systems and readers need.
    shared: False for a folder that nobody else gets.

    Give the folder back by :func:`release_unpacked`.  Raises :class:`SystemFileError` as ``extract``, and
    if the file changes meanwhile.
    """
    with _lock:
        digest = compute_file_digest(archive)
        store = _open_store(archive)
        folder = store.folders.get(digest) if shared else None
        if folder is None or not _is_whole(folder, store.sizes[folder]):
            if folder is not None:
                _forget(store, folder)
            folder = _unpack(archive, digest, store.root / str(next(_NUMBERS)))
            if shared:
                store.folders[digest] = folder
                store.sizes[folder] = _list_sizes(folder)
        store.users[folder] += 1
        return folder


def release_unpacked(folder: Path) -> None:
    """The instance that runs from a folder is freed.  The folder stays if another instance may get it."""
    with _lock:
        if _store is None or folder not in _store.users:
            return  # of an earlier store
        _store.users[folder] -= 1
        if not _store.users[folder]:
            del _store.users[folder]
            if folder not in _store.sizes:
                shutil.rmtree(folder, ignore_errors=True)


def discard_unpacked(folder: Path) -> None:
    """Do not hand out a folder again, for its library cannot be trusted any longer."""
    with _lock:
        if _store is not None:
            _forget(_store, folder)


@contextmanager
def ease_imports() -> Iterator[None]:
    """Let FMUs in Python import their modules with nothing else to do.

    What they are compiled to is not written: no other process reads it, for the folders go with this one.
    """
    with _imports_lock, collect_rarely():
        before, sys.dont_write_bytecode = sys.dont_write_bytecode, True
        try:
            yield
        finally:
            sys.dont_write_bytecode = before


def _forget(store: _Store, folder: Path) -> None:
    store.folders = {digest: kept for digest, kept in store.folders.items() if kept != folder}
    store.sizes.pop(folder, None)
    if folder not in store.users:
        shutil.rmtree(folder, ignore_errors=True)


def _unpack(archive: Path, digest: str, folder: Path) -> Path:
    try:
        extract(archive, folder, _is_for_running)
        if compute_file_digest(archive) != digest:
            raise SystemFileError(archive, "was changed while it was unpacked: start again")
    except BaseException:
        shutil.rmtree(folder, ignore_errors=True)
        raise
    return folder


def _is_for_running(member: str) -> bool:
    """Whether an FMU may need a member of its archive here: not its documentation, nor libraries for other systems.

    An FMU is told only where its resources are, and its library knows where it lies itself.  Those of ps_fmu have more
    libraries in their resources, in folders of the platforms' names: see :mod:`..native`.
    """
    top, _, rest = member.partition("/")
    if top == "resources":
        package, _, library = rest.partition("/native/")
        return not (library.count("/") == 1 and package.startswith("ps_fmu_")) or library.startswith(_KEPT)
    others = [name for name in _SYSTEMS if not platform.startswith(name)]
    return top != "documentation" and not (top == "binaries" and rest.startswith(tuple(others)))


def _open_store(archive: Path) -> _Store:
    """That of this process and its folder for temporary files: a forked process must not touch those of its parent.

    Raises :class:`SystemFileError`, about ``archive``: an FMU could not be run from there.
    """
    global _store
    above = tempfile.gettempdir()
    if _store is None or (_store.process, _store.above) != (os.getpid(), above) or not _store.root.is_dir():
        # Some FMUs decode no escapes but %20 in the location of their resources, and crash.
        if "%" in Path(above).absolute().as_uri().replace("%20", ""):
            raise SystemFileError(
                archive,
                f"would be unpacked in {above}, which some FMUs cannot read.\n"
                "  Set TMPDIR to a folder whose path contains only ASCII letters, digits, and . _ - /",
            )
        _store = _Store(os.getpid(), above, make_temporary("fmus_"))
        # Not atexit: processes that multiprocessing forks call none of its functions, others those of their parents.
        Finalize(None, remove_temporary, args=(_store.root,), exitpriority=_LAST)
    return _store


def _list_sizes(folder: Path) -> dict[str, int]:
    return {str(path.relative_to(folder)): path.stat().st_size for path in folder.rglob("*") if path.is_file()}


def _is_whole(folder: Path, sizes: dict[str, int]) -> bool:
    """Whether all files are as they were unpacked: systems clear old files out of their temporary folders."""
    try:
        return all(os.stat(os.path.join(folder, name)).st_size == size for name, size in sizes.items())
    except OSError:
        return False
