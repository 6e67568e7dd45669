"""The output folder of a run: locked against other runs; earlier results stay until there are new ones."""

from __future__ import annotations

import os
import shutil
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from ..cosim.checkpoint.state import DamagedCheckpointError
from .kept_options import can_go_on
from .options import CHECKPOINTS, PLOT, REPORT, RESULTS, SUMMARY, OptionError


@contextmanager
def leave_no_empty_folder(folder: Path) -> Iterator[None]:
    """Remove folders that the body makes, ``folder`` or those above it, and leaves empty, as when it is refused."""
    folder = folder.absolute()
    missing = [path for path in (folder, *folder.parents) if not path.exists()]
    try:
        yield
    finally:
        with suppress(OSError):  # there are results in it, or it was not made
            for path in missing:
                path.rmdir()


@contextmanager
def hold_folder(folder: Path, resume: bool = False) -> Iterator[None]:
    """Lock an existing folder against other runs, and set the results of an earlier run aside, during the body.

    Nobody can take them for the results of a run that stops early.  They are removed once new results are stored, and
    put back if none are, as after a misspelt parameter.  With ``resume`` the checkpoints stay.  Raises
    :class:`OptionError` if another run uses the folder.
    """
    lock = lock_folder(folder)
    names = (RESULTS, SUMMARY, REPORT, PLOT, *(() if resume else (CHECKPOINTS,)))
    aside = {folder / name: folder / f"{name}.earlier" for name in names}
    try:
        for path, earlier in aside.items():
            _remove(earlier)  # of a run that was killed
            if path.exists():
                path.replace(earlier)
        try:
            yield
        finally:
            stored = (folder / RESULTS).exists()
            for path, earlier in aside.items():
                if stored:
                    _remove(earlier)
                elif earlier.exists():
                    _remove(path)
                    earlier.replace(path)
    finally:
        if lock is not None:
            os.close(lock)


def _remove(path: Path) -> None:
    """Remove a file, or a folder with all that is in it."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)


def lock_folder(folder: Path) -> int | None:
    """A handle that locks the folder until it or the process ends; None where the system has no such locks.

    Raises :class:`OptionError` if another run uses the folder.
    """
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


def report_end(program: str, why: str, output: Path, code: int, error: BaseException | None = None) -> int:
    """Say why a run failed, where its results are and how it goes on; returns the exit code.

    ``error``: that which ended it, as far as it tells whether there is a way on.
    """
    results = output / RESULTS
    kept = f"results so far: {results}" if results.is_file() else "nothing was stored"
    if not results.is_file() and results.with_name(f"{RESULTS}.earlier").is_file():
        kept = f"the results of before stay: {results}"
    if (output / REPORT).is_file():  # the last that is written: the run is complete, and what it found is the failure
        kept = f"all results are written: {output}"
    print(f"{program}: {why}\n{program}: {kept}", file=sys.stderr)
    if can_go_on(output):
        command = f"{'python system/run.py' if program == 'run.py' else program} --resume {output}"
        print(f"{program}: {_tell_way_on(command, output, error)}", file=sys.stderr)
    return code


def _tell_way_on(command: str, output: Path, error: BaseException | None) -> str:
    if isinstance(error, DamagedCheckpointError):
        folder = error.path.parent
        if folder.resolve().is_relative_to((output / CHECKPOINTS).resolve()):
            return f"to compute this case anew, and the others from their checkpoints: remove {folder}, then {command}"
    return f"to go on from the last checkpoint: {command}"
