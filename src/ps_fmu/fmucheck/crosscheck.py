"""Reference runs by the rules 4.1 of the FMI cross-check, beside the sources of each FMU.

Authors write ``<Model>_ref.opt`` (times, step, tolerance) and ``<Model>_in.csv`` (inputs, linear between its rows).
FMPy computes ``<Model>_ref.csv`` from them: the outputs of the FMU, at most ten.
"""

from __future__ import annotations

import csv
import io
import math
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..cosim.guard import note_interrupts

MAXIMUM_BYTES = 1_000_000
"""The rules' limit for a CSV file."""
MAXIMUM_ROWS = MAXIMUM_BYTES // 4
"""No CSV file of that size has more rows."""
MAXIMUM_VARIABLES = 10
"""The rules' recommendation for a reference file."""
_DIGITS = 9
_HEADER = re.compile(r'"[^"]+"(,"[^"]+")*')
_REQUIRED = ("StartTime", "StopTime", "StepSize", "RelTol")

Signals = NDArray[Any]
"""Structured array: a float64 column ``time``, then one for each variable."""


class CrossCheckError(ValueError):
    """A reference that cannot be used; the text says which file and why."""


@dataclass(frozen=True)
class ReferenceOptions:
    """A ``<Model>_ref.opt`` file; times in s."""

    start_time: float
    stop_time: float
    step: float
    relative_tolerance: float


@dataclass(frozen=True)
class Reference:
    """The files of one model: ``options`` is its ``_ref.opt``."""

    options: Path

    @property
    def model(self) -> str:
        """Name of the model and of its FMU."""
        return self.options.name.removesuffix("_ref.opt")

    @property
    def results(self) -> Path:
        """The reference solution."""
        return self.options.with_name(f"{self.model}_ref.csv")

    @property
    def inputs(self) -> Path:
        """The input signals; the file may be missing."""
        return self.options.with_name(f"{self.model}_in.csv")


def find_references(folder: Path) -> list[Reference]:
    """All references in the folders below ``folder``.  Raises CrossCheckError if there are none."""
    found = [Reference(path) for path in sorted(folder.glob("*/*_ref.opt"))]
    if not found:
        raise CrossCheckError(f"{folder}: no folder below it has a file <Model>_ref.opt")
    return found


def _read_text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        raise CrossCheckError(f"{path}: is not text in UTF-8: {error}") from error


def read_options(path: Path) -> ReferenceOptions:
    """Read a ``_ref.opt`` file.  Raises CrossCheckError where an option is missing or no number."""
    rows = [row for row in csv.reader(_read_text(path).splitlines()) if row]
    given = {row[0].strip(): row[1].strip() for row in rows if len(row) == 2}
    values = []
    for name in _REQUIRED:
        try:
            values.append(float(given[name]))
        except (KeyError, ValueError):
            raise CrossCheckError(f"{path}: {name} is missing or no number") from None
    options = ReferenceOptions(*values)
    if not (options.stop_time > options.start_time and options.step > 0.0 and options.relative_tolerance > 0.0):
        raise CrossCheckError(f"{path}: StopTime after StartTime, StepSize and RelTol above 0 are needed")
    if (options.stop_time - options.start_time) / options.step > MAXIMUM_ROWS:
        raise CrossCheckError(f"{path}: at most {MAXIMUM_ROWS} steps of StepSize from StartTime to StopTime")
    return options


def read_signals(path: Path) -> Signals:
    """Read a CSV file by the rules.

    Raises CrossCheckError: larger than 1 MB, names not quoted, first column not ``time``, time that goes back, a row
    of another length, a cell that is no number.
    """
    if path.stat().st_size > MAXIMUM_BYTES:
        raise CrossCheckError(f"{path}: {path.stat().st_size} bytes, at most {MAXIMUM_BYTES} are allowed")
    lines = _read_text(path).splitlines()
    names = next(csv.reader(lines), [""])
    if names[0] != "time" or not _HEADER.fullmatch(lines[0]):
        raise CrossCheckError(f'{path}: the first line must be quoted names, the first of them "time"')
    rows = []
    for number, line in enumerate(lines[1:], 2):
        try:
            row = tuple(map(float, line.split(",")))
        except ValueError:
            raise CrossCheckError(f"{path}, line {number}: not numbers with commas between them") from None
        if len(row) != len(names) or not all(map(math.isfinite, row)):
            raise CrossCheckError(f"{path}, line {number}: expected {len(names)} finite numbers")
        rows.append(row)
    signals = np.array(rows, dtype=[(name, np.float64) for name in names])
    if len(rows) < 2 or np.any(np.diff(signals["time"]) < 0.0):
        raise CrossCheckError(f"{path}: fewer than two rows, or the time goes back")
    return signals


def write_signals(path: Path, signals: Signals) -> None:
    """Write a CSV file by the rules.  Raises CrossCheckError if it would be too large."""
    text = io.StringIO()
    text.write(",".join(f'"{name}"' for name in signals.dtype.names or ()) + "\n")
    for row in signals:
        text.write(",".join(f"{float(value):.{_DIGITS}g}" for value in row) + "\n")
    content = text.getvalue().encode()
    if len(content) > MAXIMUM_BYTES:
        raise CrossCheckError(f"{path}: would have {len(content)} bytes, at most {MAXIMUM_BYTES} are allowed")
    path.write_bytes(content)


def simulate(fmu: Path, reference: Reference, variables: Sequence[str] | None = None) -> Signals:
    """Run an FMU in FMPy with the inputs and options of a reference.

    ``variables`` are recorded; by default those of the reference solution, or the first ten outputs if there is none.
    Raises CrossCheckError, also for what FMPy raises, and KeyboardInterrupt after a step.
    """
    from fmpy import read_model_description, simulate_fmu

    if not fmu.is_file():
        raise CrossCheckError(f"there is no {fmu}: build it")
    options = read_options(reference.options)
    with _blame(fmu):
        description = read_model_description(str(fmu))
    outputs = [v.name for v in description.modelVariables if v.causality == "output" and v.type != "String"]
    if variables is None and reference.results.is_file():
        variables = next(csv.reader(_read_text(reference.results).splitlines()), ["time"])[1:]
    wanted = list(variables or outputs[:MAXIMUM_VARIABLES])
    if unknown := sorted(set(wanted) - set(outputs)):
        raise CrossCheckError(f"{reference.results}: there is no output {', '.join(unknown)} in {fmu.name}")
    if len(wanted) > MAXIMUM_VARIABLES:
        raise CrossCheckError(f"{reference.results}: {len(wanted)} variables, expected at most {MAXIMUM_VARIABLES}")
    inputs = read_signals(reference.inputs) if reference.inputs.is_file() else None
    if inputs is not None:
        declared = {v.name for v in description.modelVariables if v.causality == "input"}
        if unknown := sorted(set(inputs.dtype.names or ()) - declared - {"time"}):
            raise CrossCheckError(f"{reference.inputs}: there is no input {', '.join(unknown)} in {fmu.name}")
    with _blame(fmu), note_interrupts() as interrupted:
        result = simulate_fmu(
            str(fmu),
            start_time=options.start_time,
            stop_time=options.stop_time,
            output_interval=options.step,
            input=inputs,
            output=wanted,
            step_finished=lambda time, recorder: not interrupted,
        )
    if interrupted:
        raise KeyboardInterrupt
    return result.astype([(name, np.float64) for name in ("time", *wanted)])


@contextmanager
def _blame(fmu: Path) -> Iterator[None]:
    """Turn whatever FMPy raises, plain Exception too, into a CrossCheckError that names the FMU."""
    try:
        yield
    except Exception as error:
        raise CrossCheckError(f"{fmu}: {' '.join(str(error).split()) or type(error).__name__}") from error


def find_deviation(result: Signals, expected: Signals) -> float:
    """Largest difference of any variable, over the largest magnitude that the variable has in ``expected``.

    Raises CrossCheckError if the two do not have the same columns and times.
    """
    if result.dtype.names != expected.dtype.names or len(result) != len(expected):
        raise CrossCheckError(
            f"expected {len(expected)} rows of {', '.join(expected.dtype.names or ())}, "
            f"got {len(result)} rows of {', '.join(result.dtype.names or ())}"
        )
    largest = 0.0
    for name in expected.dtype.names or ():
        scale = float(np.abs(expected[name]).max()) or 1.0
        largest = max(largest, float(np.abs(result[name] - expected[name]).max()) / scale)
    return largest
