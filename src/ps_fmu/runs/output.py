"""The output folder of a run: locked against other runs; earlier results stay until there are new ones."""

from __future__ import annotations

import mmap
import os
import shutil
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path

from ..cosim.checkpoint.state import DamagedCheckpointError
from ..results.datasets import open_results
from ..results.style import mark_picture
from .keeping import RUN, can_go_on
from .options import CHECKPOINTS, INPUTS, PARAMETERS, PLOT, REPORT, RESULTS, SUMMARY, WRITTEN, OptionError, RunOptions

MARK = b"ps_fmu"
"""What each file of results says of its origin."""


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
    put back if none are, as after a misspelt parameter or a killed run.  With ``resume`` the checkpoints stay.  Raises
    :class:`OptionError` if another run uses the folder, and for a file or folder of such a name that is not of ps_fmu.
    """
    lock = lock_folder(folder)
    figures = (path.name.removesuffix(".earlier") for path in folder.glob("*.png*") if _is_own(path))
    names = {RESULTS, SUMMARY, REPORT, PLOT, *figures, *(() if resume else (CHECKPOINTS,))}
    aside = {folder / name: folder / f"{name}.earlier" for name in names}
    kept = {} if resume else {folder / name: folder / f"{name}.earlier" for name in INPUTS}
    try:
        for path, earlier in aside.items():
            _check_own(path)
            _check_own(earlier)
        if any(earlier.exists() for earlier in aside.values()):  # of a run that was killed
            _settle({**aside, **kept}, stored=_has_rows(folder / RESULTS))
        for path, earlier in aside.items():
            if path.exists():
                path.replace(earlier)
        for path, earlier in kept.items():
            if path.is_file():  # a copy: the new run may read it
                shutil.copy2(path, earlier)
        made = [path for path in kept if not path.exists()]
        try:
            yield
        finally:
            stored = (folder / RESULTS).exists()
            _settle({**aside, **kept}, stored)
            if not stored:
                for path in made:
                    _remove(path)
    finally:
        if lock is not None:
            os.close(lock)


def remove_old_values(options: RunOptions) -> None:
    """Remove the parameter file that an earlier ``ps_fmu.simulate`` has left in the output folder, if no run reads it.

    In the body of :func:`hold_folder`, which puts it back if nothing is stored.
    """
    path = options.output / PARAMETERS
    is_read = path.resolve() in [given.resolve() for given in options.parameters]
    if not is_read and path.is_file() and WRITTEN.encode() in path.read_bytes():
        path.unlink()


def _has_rows(path: Path) -> bool:
    """Has a run that was killed stored anything?  Its results.nc is there from the beginning."""
    try:
        with open_results(path) as file:
            return any(len(group.dimensions["time"]) for group in file.groups.values() if "time" in group.dimensions)
    except (OSError, RuntimeError):  # there is none, or it cannot be read
        return False


def _settle(aside: Mapping[Path, Path], stored: bool) -> None:
    """Remove what was set aside if there are new results, else put it back."""
    for path, earlier in aside.items():
        if stored:
            _remove(earlier)
        elif earlier.exists():
            _remove(path)
            earlier.replace(path)


def _check_own(path: Path) -> None:
    """Raises :class:`OptionError` for a file or folder that no run of ps_fmu has written."""
    if path.exists() and not _is_own(path):
        raise OptionError(
            f"--output: {path} was not written by ps_fmu, and the run would replace it: name another folder, or move "
            "it away"
        )


def _is_own(path: Path) -> bool:
    name = path.name.removesuffix(".earlier")
    if name == CHECKPOINTS:
        marks = (path / RUN, *path.glob("*/row-*.msgpack"))
        return path.is_dir() and (any(mark.is_file() for mark in marks) or not any(path.iterdir()))
    if not path.is_file():
        return False
    if path.stat().st_size == 0:  # of a run that was killed at once
        return True
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content:
        return content.find(mark_picture(name).encode() if name.endswith(".png") else MARK) >= 0


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
