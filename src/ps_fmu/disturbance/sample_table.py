"""Values on an equidistant time grid, read at any time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..mechanism.quantities import Array

# Six-point Lagrange interpolation: its error for a sine at the fraction r of the sampling rate is at most
# 0.0049 (2 pi r)^6, that is 5e-6 at r = 1/20 and 3e-4 at r = 1/10.
_NODES = range(-2, 4)
_SCALE = np.array([1.0 / np.prod([a - b for b in _NODES if b != a]) for a in _NODES])
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
        position = (time - self.start) * self.rate
        nearest = np.rint(position)
        on_grid = np.abs(position - nearest) < _SNAP
        if on_grid.all():
            return self._rows(nearest.astype(np.int64))
        position = np.where(on_grid, nearest, position)
        below = np.floor(position)
        cell = below.astype(np.int64)
        nodes = np.array(_NODES)[:, np.newaxis]
        weights = np.repeat(_SCALE[:, np.newaxis], time.size, axis=1)
        for i, distance in enumerate(position - below - nodes):
            weights[:i] *= distance
            weights[i + 1 :] *= distance
        parts = self._rows(cell + nodes)
        parts *= weights[:, :, np.newaxis]
        return np.asarray(np.add.reduce(parts, axis=0, initial=0.0))

    def _rows(self, places: NDArray[np.int64]) -> Array:
        if places.size and (places.flat[0] < 0 or places.flat[-1] >= len(self.values)):
            places = places % len(self.values)  # takes longer than the copy
        return self.values.take(places, axis=0)
