"""``run.json`` beside the checkpoints of a run: its options, so that ``--resume`` needs no others."""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

from .. import __version__
from ..cosim.checkpoint.files import CheckpointFolder
from ..slavekit.pack.files import write_atomically
from .options import CHECKPOINTS, REPORT, RESULTS, OptionError, RunOptions, from_json, list_files, name_option, to_json
from .scenario import find_scenario

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
    """Note what runs in an output folder.  Raises OSError."""
    (options.output / CHECKPOINTS).mkdir(parents=True, exist_ok=True)
    document = {
        "format": FORMAT, "package": __version__, "complete": False, "scenario": options.scenario.name,
        "options": to_json(options), "files": {str(path): _hash(path) for path in list_files(options)},
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
        raise OptionError(f"--resume: the run in {output} is complete: there is nothing to go on with")
    if (found := document.get("package")) != __version__:
        raise OptionError(f"--resume: the run in {output} is of ps_fmu {found}, this is {__version__}: run it anew")
    try:
        scenario, files = find_scenario(document["scenario"]), {Path(p): text for p, text in document["files"].items()}
        if scenario is None:
            raise OptionError(f"--resume: there is no scenario {document['scenario']!r} any longer")
        for path, sha256 in files.items():
            if not path.is_file() or _hash(path) != sha256:
                raise OptionError(f"--resume: {path} is not as it was when the run began: run it anew")
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


def _hash(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
