"""Checkpoints in the folder ``checkpoint`` of the results: those of each case, and the options of the run.

``run.json`` has the options, so that ``--resume`` needs no others.
"""

from __future__ import annotations

import json
import math
import re
import shutil
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import __version__
from ..cosim import Observer
from ..cosim.checkpoint.checkpoints import Checkpoints
from ..cosim.checkpoint.files import CheckpointFolder
from ..cosim.checkpoint.state import CheckpointError
from ..cosim.checkpoint.warm_start import WarmStart
from ..files.plain import compute_file_digest, write_atomically
from .options import CHECKPOINTS, REPORT, RESULTS, OptionError, RunOptions, from_json, list_files, name_option, to_json
from .scenario import find_scenario

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


RUN = "run.json"
"""Name of the file in the folder of the checkpoints."""
FORMAT = 2


@contextmanager
def keep_run(options: RunOptions) -> Iterator[None]:
    """Note what runs during the body, and that it is complete once the report is in the output folder.

    Where nothing was stored, there is nothing to go on with, and the note is removed.  Raises OSError, and
    :class:`.options.OptionError` for a run that cannot go on with these options.
    """
    output = options.output
    if options.checkpoint_s is None:
        yield
        return
    if options.resume:
        check_options(options)
    else:
        write_run(options)
    try:
        yield
    finally:
        if not options.resume and not (output / RESULTS).exists():
            shutil.rmtree(output / CHECKPOINTS, ignore_errors=True)
        elif (output / REPORT).is_file():
            with suppress(OSError):  # all results are there
                _write(output, {**_read(output), "complete": True})
                for folder in (output / CHECKPOINTS).iterdir():
                    if folder.is_dir():
                        CheckpointFolder(folder).leave_last()


def write_run(options: RunOptions) -> None:
    """Note what runs in an output folder.  Raises OSError, and SystemFileError for a file of the run that is gone."""
    (options.output / CHECKPOINTS).mkdir(parents=True, exist_ok=True)
    document = {
        "format": FORMAT, "package": __version__, "complete": False, "scenario": options.scenario.name,
        "options": to_json(options), "files": {str(path): compute_file_digest(path) for path in list_files(options)},
    }  # fmt: skip
    _write(options.output, document)


def can_go_on(output: Path) -> bool:
    """Whether there is a run in an output folder that is not complete."""
    try:
        return _read(output).get("complete") is False
    except OptionError:
        return False


def read_run(output: Path) -> RunOptions:
    """The options of the run in an output folder, to go on with.

    Raises :class:`.options.OptionError`: there is none, it is complete, it is of another version of ps_fmu, a file that
    it uses has changed, or the file about it is damaged.
    """
    document = _read(output)
    if document.get("complete") is not False:
        raise OptionError(f"--resume: the run in {output} is complete, and there is nothing to resume")
    if (found := document.get("package")) != __version__:
        versions = f"is of ps_fmu {found}, this is {__version__}"
        raise OptionError(f"--resume: the run in {output} {versions}: start the run again")
    try:
        scenario, files = find_scenario(document["scenario"]), {Path(p): text for p, text in document["files"].items()}
        if scenario is None:
            raise OptionError(f"--resume: ps_fmu has no scenario {document['scenario']!r}")
        for path, sha256 in files.items():
            if not path.is_file() or compute_file_digest(path) != sha256:
                raise OptionError(f"--resume: {path} has changed since the run began: start the run again")
        return replace(from_json(document["options"], scenario, output), resume=True)
    except OptionError:
        raise
    except (LookupError, ValueError, TypeError, AttributeError) as error:
        raise OptionError(f"--resume: {output / CHECKPOINTS / RUN} is damaged: {error}") from error


def check_options(options: RunOptions) -> None:
    """Raises :class:`.options.OptionError` as :func:`read_run`, and for options with which the run cannot go on.

    Whether figures are drawn is free.
    """
    kept = read_run(options.output)
    where = f"--resume: the run in {options.output}"
    if kept.scenario != options.scenario:
        raise OptionError(f"{where} is one of {kept.scenario.name!r}, this is one of {options.scenario.name!r}")
    there, here = to_json(kept), to_json(options)
    for name, value in there.items():
        if name != "figures" and value != here[name]:
            raise OptionError(
                f"{where} was begun with another value of {name_option(name)}: {value!r} there, {here[name]!r} here: "
                "it goes on with the options that it has"
            )


def _write(output: Path, document: Mapping[str, Any]) -> None:
    write_atomically(output / CHECKPOINTS / RUN, json.dumps(document, indent=1) + "\n")


def _read(output: Path) -> dict[str, Any]:
    path = output / CHECKPOINTS / RUN
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise OptionError(f"--resume: there is no run with checkpoints in {output}: no file {path}") from None
    except (OSError, ValueError, RecursionError) as error:
        raise OptionError(f"--resume: {path} cannot be read: {error}") from error
    if not isinstance(document, dict) or document.get("format") != FORMAT:
        raise OptionError(f"--resume: {path} is damaged, or of another version of ps_fmu")
    return document
