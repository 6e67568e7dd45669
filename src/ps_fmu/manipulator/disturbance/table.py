"""Values on an equidistant time grid, read at any time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Six-point Lagrange interpolation: its error for a sine at the fraction r of the sampling rate is at most
# 0.0049 (2 pi r)^6, that is 5e-6 at r = 1/20 and 3e-4 at r = 1/10.
_NODES = np.arange(-2.0, 4.0)
_SCALE = np.array([1.0 / np.prod([a - b for b in _NODES if b != a]) for a in _NODES])
_SNAP = 1e-6  # grid steps; rounding of t = t_0 + k h stays below that for days at 10 kHz


@dataclass(frozen=True)
class Table:
    """Rows (n, m) at start, start + 1/rate, ... (s, Hz); past its end the table begins again."""

    values: Array
    rate: float
    start: float = 0.0

    @property
    def end(self) -> float:
        """One grid step after the last row, s."""
        return self.start + self.values.shape[0] / self.rate

    def __call__(self, time: Array) -> Array:
        """Rows at the times (k,), shape (k, m).

        A time within 1e-6 grid steps of a grid point gets that point's row, bit for bit: common times of
        different step sizes then give equal values.
        """
        position = (time - self.start) * self.rate
        nearest = np.rint(position)
        if np.all(np.abs(position - nearest) < _SNAP):
            return self._rows(nearest)
        position = np.where(np.abs(position - nearest) < _SNAP, nearest, position)
        below = np.floor(position)
        offsets = [position - below - node for node in _NODES]
        rows = np.zeros((time.size, self.values.shape[1]))
        for i, node in enumerate(_NODES):
            weight = np.full(time.size, _SCALE[i])
            for other in offsets[:i] + offsets[i + 1 :]:
                weight *= other
            rows += weight[:, None] * self._rows(below + node)
        return rows

    def _rows(self, index: Array) -> Array:
        return np.take(self.values, index.astype(np.int64), axis=0, mode="wrap")
