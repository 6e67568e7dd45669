"""The folder of the results: one run at a time, and no run that stores nothing costs what an earlier one left."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from .options import REPORT, RESULTS, SUMMARY, OptionError


@contextmanager
def hold_folder(folder: Path) -> Iterator[None]:
    """Keep other runs out of an existing folder, and the results of an earlier run aside, during the body.

    They must not pass for those of a run that stops early, so they are removed once there are new ones. Where there
    are none - a misspelt parameter - they are put back.  Raises :class:`OptionError` if another run holds the folder.
    """
    lock = _lock(folder)
    aside = {folder / name: folder / f"{name}.earlier" for name in (RESULTS, SUMMARY, REPORT)}
    try:
        for path, earlier in aside.items():
            earlier.unlink(missing_ok=True)  # of a run that was killed
            if path.exists():
                path.replace(earlier)
        try:
            yield
        finally:
            stored = (folder / RESULTS).exists()
            for path, earlier in aside.items():
                if stored:
                    earlier.unlink(missing_ok=True)
                elif earlier.exists():
                    earlier.replace(path)
    finally:
        if lock is not None:
            os.close(lock)


def _lock(folder: Path) -> int | None:
    """A handle that holds the folder until it is closed, also by the end of the process; None where that is unknown."""
    try:
        import fcntl
    except ImportError:  # not on Windows
        return None
    handle = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(handle)
        raise OptionError(f"--output: another run is writing in {folder}: name another folder") from None
    except OSError:  # a file system without locks
        pass
    return handle
