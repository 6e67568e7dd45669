"""Columns of numbers from a CSV file, which is hostile until it has been checked."""

from __future__ import annotations

import csv
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TextIO

import numpy as np

from ..mechanism.quantities import Array, ParameterError

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
    return _Reader(path, tuple(header), name).read()


@dataclass(frozen=True)
class _Reader:
    path: Path
    header: tuple[str, ...]
    name: str

    def read(self) -> Array:
        try:
            if not self.path.is_file():
                raise ParameterError(self.name, f"no file {str(self.path)!r} (relative paths start at {Path.cwd()})")
            size = self.path.stat().st_size
            if size > MAX_BYTES:
                raise ParameterError(self.name, f"{self.path.name} has {size} bytes; at most {MAX_BYTES} are read")
            with self.path.open(newline="", encoding="utf-8-sig") as file:
                return self._parse(file)
        except OSError as error:
            raise ParameterError(self.name, f"cannot read {str(self.path)!r}: {error.strerror}") from error
        except (UnicodeDecodeError, csv.Error) as error:
            raise ParameterError(self.name, f"{self.path.name} is not a CSV file in UTF-8: {error}") from error

    def _parse(self, file: TextIO) -> Array:
        lines = csv.reader(self._bounded(file), strict=True)
        columns = self._columns(next(lines, []))
        rows = np.empty((1024, len(self.header)))
        count, last = 0, -np.inf
        for fields in lines:
            if not fields:
                continue  # an empty line
            row = self._numbers(lines.line_num, fields, columns)
            if not row[0] > last:
                raise self._bad(lines.line_num, f"the time {row[0]:g} s does not come after {last:g} s")
            if count == MAX_ROWS:
                raise self._bad(lines.line_num, f"more than {MAX_ROWS} lines; thin the file out or cut it")
            if count == len(rows):
                rows = np.resize(rows, (min(2 * count, MAX_ROWS), len(self.header)))
            rows[count] = row
            last, count = row[0], count + 1
        if count < 2:
            raise ParameterError(self.name, f"{self.path.name} has {count} lines of numbers; interpolation needs two")
        return rows[:count].copy()

    def _bounded(self, file: TextIO) -> Iterator[str]:
        """Lines of bounded length: one without an end must not fill the memory."""
        number = 0
        while line := file.readline(MAX_LINE + 1):
            number += 1
            if len(line) > MAX_LINE:
                raise self._bad(number, f"longer than {MAX_LINE} characters")
            yield line

    def _columns(self, header: list[str]) -> list[int]:
        names = [" ".join(field.split()) for field in header]
        columns = []
        for wanted in self.header:
            if names.count(wanted) == 1:
                columns.append(names.index(wanted))
                continue
            others = [name for name in names if name.split(" ")[0] == wanted.split(" ")[0]]
            if names.count(wanted) > 1:
                problem = f"two columns {wanted!r}"
            elif others:
                problem = f"column {others[0]!r} must be {wanted!r}: convert the values to this unit"
            else:
                problem = f"no column {wanted!r}; expected {', '.join(self.header)}"
            raise self._bad(1, problem)
        return columns

    def _numbers(self, line: int, fields: list[str], columns: list[int]) -> list[float]:
        row = []
        for name, column in zip(self.header, columns, strict=True):
            try:
                value = float(fields[column])
            except IndexError:
                raise self._bad(line, f"{len(fields)} fields, but {name!r} is in column {column + 1}") from None
            except ValueError:
                raise self._bad(line, f"{name!r}: expected a number, got {fields[column][:40]!r}") from None
            if not np.isfinite(value):
                raise self._bad(line, f"{name!r}: must be finite, got {value}")
            row.append(value)
        return row

    def _bad(self, line: int, problem: str) -> ParameterError:
        return ParameterError(self.name, f"{self.path.name}, line {line}: {problem}")
