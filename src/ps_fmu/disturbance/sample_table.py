"""Values on an equidistant time grid, read at any time by six-point Lagrange interpolation.

Its error for a sine at the fraction r of the sampling rate is at most 0.0049 (2 pi r)^6, that is 5e-6 at r = 1/20 and
3e-4 at r = 1/10.
"""

from __future__ import annotations

from collections.abc import Sequence
from ctypes import byref, pointer
from dataclasses import dataclass

import numpy as np

from ..mechanism.quantities import Array
from ..numerics import library
from ..numerics.calls import Pair, Progress, TableRows
from ..numerics.library import Tables, find_address

_COLUMNS = 6  # of a table, as in tables.h


@dataclass(frozen=True)
class SampleTable:
    """Rows (n, 6) at start, start + 1/rate, ... (s, Hz); past its end the table begins again."""

    values: Array
    rate: float
    start: float = 0.0

    @property
    def end(self) -> float:
        """One grid step after the last row, s."""
        return self.start + self.values.shape[0] / self.rate

    def __call__(self, time: Array) -> Array:
        """Rows at ascending times (k,), shape (k, 6).

        A time within 1e-6 grid steps of a grid point gets that point's row, bit for bit: common times of
        different step sizes then give equal values.  Raises ValueError for another number of columns.
        """
        if self.values.shape[1] != _COLUMNS:
            raise ValueError(f"a table of shape {self.values.shape}: expected {_COLUMNS} columns")
        values = np.ascontiguousarray(self.values, dtype=np.float64)
        time = np.ascontiguousarray(time, dtype=np.float64)
        found = np.zeros((time.size, _COLUMNS))
        table = _describe([values], [0], self.start, self.rate)
        library.find_arithmetic().add_rows(byref(table), find_address(time), time.size, find_address(found))
        return found


def make_calls(
    rows: Array,
    time: Array,
    tables: Sequence[Array],
    shifts: Sequence[int],
    start: float,
    rate: float,
    at_once: int,
    *,
    clear: bool,
) -> tuple[list[Pair], list[object]]:
    """Add to ``rows`` the sum of one or two periodic tables (n, 6) of one grid at ascending times (k,), s.

    Parameters
    ----------
    rows: (k, 6), contiguous; with ``clear``, what they hold before does not count.
    shifts: by how many rows further each table is read.
    start, rate: of the grid, s and Hz.

    Returns
    -------
    Calls for ``at_once`` rows each, and what has to be kept as long.
    """
    both = _describe(tables, shifts, start, rate)
    given = TableRows(
        Progress(find_address(rows), time.size, at_once), pointer(both), find_address(time), clear
    )  # the pointer keeps what it points to
    return [(library.find_arithmetic().add_some_rows, given)] * -(-time.size // at_once), [rows, time, *tables]


def _describe(tables: Sequence[Array], shifts: Sequence[int], start: float, rate: float) -> Tables:
    one, other = find_address(tables[0]), find_address(tables[-1])
    return Tables(one, other if len(tables) == 2 else None, len(tables[0]), shifts[0], shifts[-1], start, rate)
