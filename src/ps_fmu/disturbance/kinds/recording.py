"""A recorded wrench from a CSV file, which is hostile until it has been checked."""

from __future__ import annotations

import csv
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, TextIO

import numpy as np

from ...mechanism.parameters import Parameters
from ...mechanism.quantities import Array, ParameterError, quantity
from ..kind import Kind, SharedSettings, Source

HEADER = (
    "time [s]",
    "force.x [N]", "force.y [N]", "force.z [N]",
    "torque.x [N.m]", "torque.y [N.m]", "torque.z [N.m]",
)  # fmt: skip
MAX_BYTES = 512 * 1024**2
MAX_ROWS = 2_000_000  # 112 MB in memory
MAX_LINE = 4096  # characters

NAME = "path"

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
        table = read(path)
        self._time, self._wrench = table[:, 0].copy(), scale * table[:, 1:]
        self._repeat = repeat

    @property
    def end(self) -> float:
        """Time where the recording is cut off, s; infinite if it is repeated, or has died away in its last line."""
        died_away = np.abs(self._wrench[-1]).max() <= _DIED_AWAY * np.abs(self._wrench).max()
        return np.inf if self._repeat or died_away else float(self._time[-1])

    def __call__(self, time: Array) -> Array:
        """Force (N) and torque (N.m) in B at its origin at the times (n,) in s, shape (n, 6)."""
        first, last = self._time[0], self._time[-1]
        at = first + np.mod(time - first, last - first) if self._repeat else np.clip(time, first, last)
        after = np.clip(np.searchsorted(self._time, at, side="right"), 1, self._time.size - 1)
        before = after - 1
        part = (at - self._time[before]) / (self._time[after] - self._time[before])
        wrench = self._wrench[before] + part[:, None] * (self._wrench[after] - self._wrench[before])
        if not self._repeat:
            # The slack is for times that are sums of steps: the last line acts.
            slack = 1e-9 * (last - first)
            wrench[(time < first - slack) | (time > last + slack)] = 0.0
        return np.asarray(wrench)


def read(path: Path) -> Array:
    """The columns of :data:`HEADER` of a file, shape (lines, 7).

    Raises
    ------
    ParameterError: see :class:`Recording`.
    """
    try:
        if not path.is_file():
            raise ParameterError(NAME, f"no file {str(path)!r} (relative paths start at {Path.cwd()})")
        size = path.stat().st_size
        if size > MAX_BYTES:
            raise ParameterError(NAME, f"{path.name} has {size} bytes; at most {MAX_BYTES} are read")
        with path.open(newline="", encoding="utf-8-sig") as file:
            return _parse(path, file)
    except OSError as error:
        raise ParameterError(NAME, f"cannot read {str(path)!r}: {error.strerror}") from error
    except (UnicodeDecodeError, csv.Error) as error:
        raise ParameterError(NAME, f"{path.name} is not a CSV file in UTF-8: {error}") from error


def _parse(path: Path, file: TextIO) -> Array:
    lines = csv.reader(_bounded(path, file), strict=True)
    columns = _columns(path, next(lines, []))
    rows = np.empty((1024, len(HEADER)))
    count, last = 0, -np.inf
    for fields in lines:
        if not fields:
            continue  # an empty line
        row = _numbers(path, lines.line_num, fields, columns)
        if not row[0] > last:
            raise _bad(path, lines.line_num, f"the time {row[0]:g} s does not come after {last:g} s")
        if count == MAX_ROWS:
            raise _bad(path, lines.line_num, f"more than {MAX_ROWS} lines; thin the recording out or cut it")
        if count == len(rows):
            rows = np.resize(rows, (min(2 * count, MAX_ROWS), len(HEADER)))
        rows[count] = row
        last, count = row[0], count + 1
    if count < 2:
        raise ParameterError(NAME, f"{path.name} has {count} lines of numbers; interpolation needs two")
    return rows[:count].copy()


def _bounded(path: Path, file: TextIO) -> Iterator[str]:
    """Lines of bounded length: one without an end must not fill the memory."""
    number = 0
    while line := file.readline(MAX_LINE + 1):
        number += 1
        if len(line) > MAX_LINE:
            raise _bad(path, number, f"longer than {MAX_LINE} characters")
        yield line


def _columns(path: Path, header: list[str]) -> list[int]:
    names = [" ".join(field.split()) for field in header]
    columns = []
    for wanted in HEADER:
        if names.count(wanted) == 1:
            columns.append(names.index(wanted))
            continue
        others = [name for name in names if name.split(" ")[0] == wanted.split(" ")[0]]
        if names.count(wanted) > 1:
            problem = f"two columns {wanted!r}"
        elif others:
            problem = f"column {others[0]!r} must be {wanted!r}: convert the values to this unit"
        else:
            problem = f"no column {wanted!r}; expected {', '.join(HEADER)}"
        raise _bad(path, 1, problem)
    return columns


def _numbers(path: Path, line: int, fields: list[str], columns: list[int]) -> list[float]:
    row = []
    for name, column in zip(HEADER, columns, strict=True):
        try:
            value = float(fields[column])
        except IndexError:
            raise _bad(path, line, f"{len(fields)} fields, but {name!r} is in column {column + 1}") from None
        except ValueError:
            raise _bad(path, line, f"{name!r}: expected a number, got {fields[column][:40]!r}") from None
        if not np.isfinite(value):
            raise _bad(path, line, f"{name!r}: must be finite, got {value}")
        row.append(value)
    return row


def _bad(path: Path, line: int, problem: str) -> ParameterError:
    return ParameterError(NAME, f"{path.name}, line {line}: {problem}")


@dataclass(frozen=True)
class RecordingSettings(Kind):
    """A file; no path means off."""

    name: ClassVar[str] = "recording"
    place: ClassVar[int] = 50

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
