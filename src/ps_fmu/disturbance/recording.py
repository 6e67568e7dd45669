"""Recorded numbers from CSV files, which are hostile until they have been checked; a recorded wrench."""

from __future__ import annotations

import csv
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import ClassVar, TextIO

import numpy as np

from ..mechanism.parameters import Parameters
from ..mechanism.quantities import Array, ParameterError, quantity
from .kind import Kind, SharedSettings, Source

MAX_BYTES = 512 * 1024**2
MAX_ROWS = 2_000_000  # 112 MB in memory for the seven columns of a recording
MAX_LINE = 4096  # characters


def read_columns(path: Path, header: Sequence[str], name: str) -> Array:
    """The columns of a file with one line of names and units, then one line per instant; shape (lines, columns).

    The first column of ``header`` is the time, which increases strictly.  The file may have its columns in any order,
    and others beside them.

    Parameters
    ----------
    path: of the file; relative paths start at the working directory.
    header: names with units, for example ``time [s]``.
    name: of the parameter that names the file, for errors.

    Raises
    ------
    ParameterError: the file cannot be used; the text says why, with the number of the line.
    """
    try:
        if not path.is_file():
            raise ParameterError(name, f"no file {str(path)!r} (relative paths start at {Path.cwd()})")
        if (size := path.stat().st_size) > MAX_BYTES:
            raise ParameterError(name, f"{path.name} has {size} bytes; at most {MAX_BYTES} are read")
        with path.open(newline="", encoding="utf-8-sig") as file:
            return _read_lines(_Lines(file, path.name, name), header)
    except OSError as error:
        raise ParameterError(name, f"cannot read {str(path)!r}: {error.strerror}") from error
    except (UnicodeDecodeError, csv.Error) as error:
        raise ParameterError(name, f"{path.name} is not a CSV file in UTF-8: {error}") from error


class _Lines:
    """Lines of bounded length, without the empty ones: one without an end must not fill the memory."""

    def __init__(self, file: TextIO, name: str, parameter: str) -> None:
        self.number = 0
        self._file, self.name, self.parameter = file, name, parameter
        self._empty: list[int] = []

    def __iter__(self) -> Iterator[str]:
        while line := self._file.readline(MAX_LINE + 1):
            self.number += 1
            if len(line) > MAX_LINE:
                raise self.refuse(f"longer than {MAX_LINE} characters")
            if self.number > 1 and not line.strip():
                self._empty.append(self.number)
                continue
            yield line

    def refuse(self, problem: str, row: int | None = None) -> ParameterError:
        """What to raise for the present line, or for that of a row of numbers."""
        number = self.number if row is None else row + 2
        if row is not None:
            for empty in self._empty:
                number += empty <= number
        return ParameterError(self.parameter, f"{self.name}, line {number}: {problem}")


def _read_lines(lines: _Lines, header: Sequence[str]) -> Array:
    rest = iter(lines)
    columns = _find_columns(next(csv.reader([next(rest, "")], strict=True), []), lines, header)
    rows = np.empty((0, len(header)))
    if first := next(rest, None):  # numpy warns of no rows at all
        try:
            rows = np.loadtxt(
                chain([first], rest), delimiter=",", comments=None, quotechar='"', usecols=columns, ndmin=2,
                max_rows=MAX_ROWS + 1,
            )  # fmt: skip
        except ParameterError:
            raise
        except ValueError as error:
            problem = re.sub(r" at row \d+,? ", " in ", str(error).rstrip("."))  # numpy counts other rows than lines
            raise lines.refuse(problem) from error
    if len(rows) > MAX_ROWS:
        raise lines.refuse(f"more than {MAX_ROWS} lines; thin the file out or cut it", MAX_ROWS)
    wrong = np.argwhere(~np.isfinite(rows))
    if wrong.size:
        row, column = wrong[0]
        raise lines.refuse(f"{header[column]!r}: must be finite, got {rows[row, column]}", row)
    late = np.flatnonzero(~(np.diff(rows[:, 0]) > 0.0))
    if late.size:
        before, time = rows[late[0] : late[0] + 2, 0]
        raise lines.refuse(f"the time {time:g} s does not come after {before:g} s", int(late[0]) + 1)
    if len(rows) < 2:
        raise ParameterError(lines.parameter, f"{lines.name} has {len(rows)} lines of numbers; interpolation needs two")
    return np.asarray(rows)


def _find_columns(names: list[str], lines: _Lines, header: Sequence[str]) -> list[int]:
    """The places of the names of a header among those of a file."""
    names = [" ".join(name.split()) for name in names]
    for wanted in header:
        others = [name for name in names if name.split(" ")[0] == wanted.split(" ")[0]]
        if names.count(wanted) > 1:
            raise lines.refuse(f"two columns {wanted!r}")
        if wanted not in names and others:
            raise lines.refuse(f"column {others[0]!r} must be {wanted!r}: convert the values to this unit")
        if wanted not in names:
            raise lines.refuse(f"no column {wanted!r}; expected {', '.join(header)}")
    return [names.index(wanted) for wanted in header]


HEADER = (
    "time [s]",
    "force.x [N]", "force.y [N]", "force.z [N]",
    "torque.x [N.m]", "torque.y [N.m]", "torque.z [N.m]",
)  # fmt: skip
_DIED_AWAY = 1e-9  # of the largest value


class Recording:
    """Linear interpolation in a file with one line of names and units, then one line per instant.

    The names are those of :data:`HEADER`, in any order; other columns are ignored.  Times increase strictly.

    Parameters
    ----------
    path: the file.
    repeat: the last line is also the first of the next repetition; else nothing acts before the first and after the
        last line.
    scale: factor on force and torque.

    Raises
    ------
    ParameterError: the file cannot be used; the text says why, with the number of the line.
    """

    def __init__(self, path: Path, repeat: bool = False, scale: float = 1.0) -> None:
        table = read_columns(path, HEADER, "path")
        self._time, self._wrench = table[:, 0].copy(), scale * table[:, 1:]
        self.repeats = repeat

    @property
    def span(self) -> tuple[float, float]:
        """Times of the first and the last line, s."""
        return float(self._time[0]), float(self._time[-1])

    @property
    def end(self) -> float:
        """Time where the recording is cut off, s; infinite if it is repeated, or has died away in its last line."""
        died_away = np.abs(self._wrench[-1]).max() <= _DIED_AWAY * np.abs(self._wrench).max()
        return np.inf if self.repeats or died_away else float(self._time[-1])

    def __call__(self, time: Array) -> Array:
        """Force (N) and torque (N.m) in B at its origin at the times (n,) in s, shape (n, 6)."""
        first, last = self._time[0], self._time[-1]
        at = first + np.mod(time - first, last - first) if self.repeats else np.clip(time, first, last)
        after = np.clip(np.searchsorted(self._time, at, side="right"), 1, self._time.size - 1)
        before = after - 1
        part = (at - self._time[before]) / (self._time[after] - self._time[before])
        wrench = self._wrench[before] + part[:, None] * (self._wrench[after] - self._wrench[before])
        if not self.repeats:
            # The slack is for times that are sums of steps: the last line acts.
            slack = 1e-9 * (last - first)
            wrench[(time < first - slack) | (time > last + slack)] = 0.0
        return np.asarray(wrench)


@dataclass(frozen=True)
class RecordingSettings(Kind):
    """A file; no path means off."""

    name: ClassVar[str] = "recording"

    path: str = quantity("", "CSV file with time, force and torque in B at its origin; empty: none")
    repeat: bool = quantity("", "True: begin again after the last line; false: nothing acts after it")
    scale: float = quantity("1", "Factor on the recorded wrench")

    def __post_init__(self) -> None:
        super().__post_init__()
        if not isinstance(self.path, str):
            raise ParameterError("path", f"expected text, got {self.path!r}")

    @classmethod
    def make_defaults(cls, p: Parameters) -> RecordingSettings:
        """No file."""
        return cls(path="", repeat=False, scale=1.0)

    def make_source(self, shared: SharedSettings, number: int) -> Source | None:
        """The recording.  Raises ParameterError: the file cannot be used."""
        return Recording(Path(self.path), self.repeat, self.scale) if self.path else None
