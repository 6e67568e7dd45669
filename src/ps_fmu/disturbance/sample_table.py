"""Values on an equidistant time grid, read at any time."""

from __future__ import annotations

from collections.abc import Sequence
from ctypes import byref, pointer
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..mechanism.quantities import Array
from ..numerics import library
from ..numerics.calls import Pair, Progress, TableRows
from ..numerics.library import Arithmetic, Tables, find_address

# Six-point Lagrange interpolation: its error for a sine at the fraction r of the sampling rate is at most
# 0.0049 (2 pi r)^6, that is 5e-6 at r = 1/20 and 3e-4 at r = 1/10.
_NODES = range(-2, 4)
_COLUMN = np.array(_NODES)[:, np.newaxis]
_SCALE = np.array([[1.0 / np.prod([a - b for b in _NODES if b != a])] for a in _NODES])
_CHUNK = 256  # rows at once: for more, memory would come from the system, page by page, which takes 100 us
_FEW = 3  # rows a time, up to which tables are added before they are interpolated
_COMPILED_COLUMNS = 6  # of tables that the compiled library reads
_SNAP = 1e-6  # grid steps; rounding of t = t_0 + k h stays below that for days at 10 kHz


@dataclass(frozen=True)
class SampleTable:
    """Rows (n, m) at start, start + 1/rate, ... (s, Hz); past its end the table begins again."""

    values: Array
    rate: float
    start: float = 0.0

    @property
    def end(self) -> float:
        """One grid step after the last row, s."""
        return self.start + self.values.shape[0] / self.rate

    def __call__(self, time: Array) -> Array:
        """Rows at ascending times (k,), shape (k, m).

        A time within 1e-6 grid steps of a grid point gets that point's row, bit for bit: common times of
        different step sizes then give equal values.
        """
        found = np.zeros((time.size, self.values.shape[1]))
        add_rows(found, time, [self.values], [0], self.start, self.rate, library.find_arithmetic())
        return found


def add_rows(
    rows: Array,
    time: Array,
    tables: Sequence[Array],
    shifts: Sequence[int],
    start: float,
    rate: float,
    arithmetic: Arithmetic | None,
) -> None:
    """Add to ``rows`` (k, m) the sum of one or two periodic tables (n, m) of one grid at ascending times (k,), s.

    Parameters
    ----------
    shifts: by how many rows further each table is read.
    start, rate: of the grid, s and Hz.
    arithmetic: compiled functions; None, or other than six columns: numpy does the same.
    """
    if arithmetic is None or rows.shape != (time.size, _COMPILED_COLUMNS):
        rows += _read_sum(tables, shifts, (time - start) * rate)
        return
    tables = [np.ascontiguousarray(table, dtype=np.float64) for table in tables]
    time = np.ascontiguousarray(time, dtype=np.float64)
    both = _describe(tables, shifts, start, rate)
    arithmetic.add_rows(byref(both), find_address(time), time.size, find_address(rows))


def make_calls(
    rows: Array,
    time: Array,
    tables: Sequence[Array],
    shifts: Sequence[int],
    start: float,
    rate: float,
    arithmetic: Arithmetic,
    at_once: int,
    *,
    clear: bool,
) -> tuple[list[Pair], list[object]]:
    """What :func:`add_rows` does, as calls for so many rows each, and what has to be kept as long.

    ``rows``: (k, 6), contiguous; with ``clear``, what they hold before does not count.
    """
    both = _describe(tables, shifts, start, rate)
    given = TableRows(
        Progress(find_address(rows), time.size, at_once), pointer(both), find_address(time), clear
    )  # the pointer keeps what it points to
    return [(arithmetic.add_some_rows, given)] * -(-time.size // at_once), [rows, time, *tables]


def _describe(tables: Sequence[Array], shifts: Sequence[int], start: float, rate: float) -> Tables:
    one, other = find_address(tables[0]), find_address(tables[-1])
    return Tables(one, other if len(tables) == 2 else None, len(tables[0]), shifts[0], shifts[-1], start, rate)


def _compute_weights(distances: Array) -> Array:
    """Weights of the nodes (6, k) at these distances (6, k) from them: of each, the product of the distances to all
    others, from those before it and those behind it."""
    weights = np.empty_like(distances)
    weights[0], after = 1.0, distances[-1]
    for i in range(len(distances) - 1):
        np.multiply(weights[i], distances[i], out=weights[i + 1])
    for i in reversed(range(len(distances) - 1)):
        weights[i] *= after
        after = after * distances[i]
    weights *= _SCALE
    return weights


def _read_sum(tables: Sequence[Array], shifts: Sequence[int], position: Array) -> Array:
    """The sum of periodic tables (n, m) at ascending positions (k,) in grid steps, shape (k, m).

    They are added before they are interpolated: where many times fall between two grid points, there is less to do.
    """
    nearest = np.rint(position)
    on_grid = np.abs(position - nearest) < _SNAP
    if on_grid.all():
        return _add_tables(tables, shifts, nearest.astype(np.int64))
    position = np.where(on_grid, nearest, position)
    below = np.floor(position)
    cell, weights = below.astype(np.int64), _compute_weights(position - below - _COLUMN)
    first, last = (int(cell[i]) + node for i, node in ((0, _NODES[0]), (-1, _NODES[-1])))
    if last - first < _FEW * cell.size:  # each row is added once, not once for each time that needs it
        rows = _add_tables(tables, shifts, np.arange(first, last + 1))
        tables, shifts, cell = [rows], [0], cell - first
    found = np.empty((cell.size, tables[0].shape[1]))
    for start in range(0, cell.size, _CHUNK):
        chunk = slice(start, start + _CHUNK)
        parts = _add_tables(tables, shifts, cell[chunk] + _COLUMN)
        parts *= weights[:, chunk, np.newaxis]
        np.add.reduce(parts, axis=0, initial=0.0, out=found[chunk])
    return found


def _add_tables(tables: Sequence[Array], shifts: Sequence[int], places: NDArray[np.int64]) -> Array:
    rows = [_take(table, places + shift if shift else places) for table, shift in zip(tables, shifts, strict=True)]
    for more in rows[1:]:
        rows[0] += more
    return rows[0]


def _take(table: Array, places: NDArray[np.int64]) -> Array:
    if places.size and (places.flat[0] < 0 or places.flat[-1] >= len(table)):
        places = places % len(table)  # takes longer than the copy
    return table.take(places, axis=0)
