"""Values on an equidistant time grid, read at any time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..mechanism.quantities import Array

# Six-point Lagrange interpolation: its error for a sine at the fraction r of the sampling rate is at most
# 0.0049 (2 pi r)^6, that is 5e-6 at r = 1/20 and 3e-4 at r = 1/10.
_NODES = range(-2, 4)
_COLUMN = np.array(_NODES)[:, np.newaxis]
_SCALE = np.array([1.0 / np.prod([a - b for b in _NODES if b != a]) for a in _NODES])
_CHUNK = 256  # rows at once: for more, memory would come from the system, page by page, which takes 100 us
_SNAP = 1e-6  # grid steps; rounding of t = t_0 + k h stays below that for days at 10 kHz


class Places(NamedTuple):
    """Places of values in a table, for k times."""

    cell: NDArray[np.int64]
    """Rows of the table (k,); with weights, the rows from two before to three behind each."""
    weights: Array | None
    """(6, k); None: all times are grid points."""


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
        return self.read(self.find(time))

    def find(self, time: Array) -> Places:
        """Where :meth:`read` finds the rows at ascending times (k,): the first half of the work."""
        position = (time - self.start) * self.rate
        nearest = np.rint(position)
        on_grid = np.abs(position - nearest) < _SNAP
        if on_grid.all():
            return Places(nearest.astype(np.int64), None)
        position = np.where(on_grid, nearest, position)
        below = np.floor(position)
        weights = np.repeat(_SCALE[:, np.newaxis], time.size, axis=1)
        for i, distance in enumerate(position - below - _COLUMN):
            weights[:i] *= distance
            weights[i + 1 :] *= distance
        return Places(below.astype(np.int64), weights)

    def read(self, places: Places) -> Array:
        """The rows (k, m) that :meth:`find` has found the places of."""
        cell, weights = places
        if weights is None:
            return self._rows(cell)
        found = np.empty((cell.size, self.values.shape[1]))
        for first in range(0, cell.size, _CHUNK):
            chunk = slice(first, first + _CHUNK)
            parts = self._rows(cell[chunk] + _COLUMN)
            parts *= weights[:, chunk, np.newaxis]
            np.add.reduce(parts, axis=0, initial=0.0, out=found[chunk])
        return found

    def _rows(self, places: NDArray[np.int64]) -> Array:
        if places.size and (places.flat[0] < 0 or places.flat[-1] >= len(self.values)):
            places = places % len(self.values)  # takes longer than the copy
        return self.values.take(places, axis=0)
