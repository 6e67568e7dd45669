"""Checkpoints of the runs of a scenario, or of any system, in the folder ``checkpoint`` of its results."""

from __future__ import annotations

import math
import re
import shutil
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..cosim import Event, Observer
from ..cosim.checkpoint.checkpoints import Checkpoints
from ..cosim.checkpoint.files import CheckpointFolder
from ..cosim.checkpoint.state import CheckpointError
from ..cosim.checkpoint.warm_start import WarmStart
from .kept_options import check_options, note_complete, write_run
from .options import CHECKPOINTS, RESULTS, OptionError

Array = NDArray[np.float64]

SHARE: float | None = 0.02
"""Of the time of a case, checkpoints take at most so much, but for the first one and that at the end."""


def name_folder(output: Path, case: str) -> Path:
    """Folder of the checkpoints of a case."""
    return output / CHECKPOINTS / re.sub(r"[^\w.-]", "_", case)


class CaseKeeper:
    """The checkpoints of one case: when they are taken, and where it goes on or begins.

    They take at most :data:`SHARE` of its time: one that falls due may have to wait.

    Parameters
    ----------
    output: folder of the results
    case: name of the case
    interval_s: simulated time between checkpoints [s]; None: none are taken
    resume: go on from those in the folder
    source: begin in the state of a checkpoint: its file, a folder of them, or the output folder of a run with a case of
        this name
    anew: components that have none of their state there
    given: start values that the case states itself, and that hold there, see :class:`WarmStart`
    notes: what else is kept

    Raises :class:`OptionError` where the source has no such case, :class:`ps_fmu.cosim.CosimError` for a checkpoint
    that cannot be used.
    """

    def __init__(
        self,
        output: Path,
        case: str,
        interval_s: float | None,
        *,
        resume: bool = False,
        source: Path | None = None,
        anew: Sequence[str] = (),
        given: Collection[str] = (),
        notes: Callable[[], Mapping[str, Any]] = dict,
    ) -> None:
        begin = None if source is None else WarmStart(find_source(source, case), anew, given)
        folder = None if interval_s is None else name_folder(output, case)
        self.checkpoints = Checkpoints(
            folder, interval_s or math.inf, share=SHARE, resume=resume, source=begin, notes=notes
        )
        self.start_time: float | None = None if begin is None else begin.time
        """Of a run that begins in the state of another one [s]; None: as the system says."""

    @property
    def kept_notes(self) -> Mapping[str, Any]:
        """The notes of the checkpoint that the case goes on from; nothing without one."""
        return self.checkpoints.kept_notes

    @property
    def attributes(self) -> dict[str, float]:
        """What results.nc says of it: the time of the checkpoint, for a run that begins in its state [s]."""
        return {} if self.start_time is None else {"warm_start_s": self.start_time}

    def shift_events(self, events: Sequence[Event]) -> list[Event]:
        """Events at times since the start of the run, at those of the simulation."""
        return [(time + (self.start_time or 0.0), name, value) for time, name, value in events]

    def shift_observer(self, observer: Observer, step_s: float) -> Observer:
        """An observer that is told times since the start of the run."""
        return observer if self.start_time is None else SinceStart(observer, step_s)


class SinceStart:
    """Passes rows on to another observer, with times since the start of the run."""

    def __init__(self, observer: Observer, step_s: float) -> None:
        self.observed = observer
        self._step_s = step_s

    def block(self, first_index: int, time: Array, values: Array) -> None:
        """See :meth:`ps_fmu.cosim.Observer.block`."""
        since = np.arange(first_index, first_index + len(time), dtype=np.float64) * self._step_s
        self.observed.block(first_index, since, values)


def find_source(source: Path, case: str) -> Path:
    """The file or folder of checkpoints that a case begins from.  Raises :class:`OptionError` if there is none."""
    if source.is_dir() and (source / CHECKPOINTS).is_dir():
        folder = name_folder(source, case)
        if not folder.is_dir():
            known = sorted(path.name for path in (source / CHECKPOINTS).iterdir() if path.is_dir())
            hint = f": give the folder of one, such as {source / CHECKPOINTS / known[0]}" if known else ""
            raise OptionError(
                f"--from: {source} has no checkpoint of {case}; it has {', '.join(known) or 'none'}{hint}"
            )
        return folder
    return source


@contextmanager
def leave_no_empty_file(results: Path) -> Iterator[None]:
    """Remove a file of results that the body makes, if it is refused to go on or to begin from a checkpoint."""
    there = results.exists()
    try:
        yield
    except CheckpointError:
        if not there:
            results.unlink(missing_ok=True)
        raise


@contextmanager
def keep_run(
    output: Path, kind: str, name: str, options: Mapping[str, Any], *, last: str, resume: bool
) -> Iterator[None]:
    """Note what runs during the body, and that it is complete once the file ``last`` is in the output folder.

    Where nothing was stored, there is nothing to go on with, and the note is removed.  Raises OSError, and
    :class:`OptionError` for a run that cannot ``resume`` with these options.
    """
    if options["checkpoint_s"] is None:
        yield
        return
    if resume:
        check_options(output, kind, name, options)
    else:
        write_run(output, kind, name, options)
    try:
        yield
    finally:
        if not resume and not (output / RESULTS).exists():
            shutil.rmtree(output / CHECKPOINTS, ignore_errors=True)
        elif (output / last).is_file():
            with suppress(OSError):  # all results are there
                note_complete(output)
                for folder in (output / CHECKPOINTS).iterdir():
                    if folder.is_dir():
                        CheckpointFolder(folder).leave_last()
