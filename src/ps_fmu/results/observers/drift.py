"""Drift of a run: the mean of a signal over the second half of a window less that over the first.

The mean of a noisy signal over half a window is not zero without drift: its slowest lines leave something behind.
So both halves are weighted by a Hann window, w(t) = 1 - cos(2 pi t / T), T the length of a half: a line that makes
n cycles in T is reduced to 1/(pi n (n^2 - 1)) of its amplitude at most, 0.3 % for n = 5.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ...reduction.moments import weigh_hann
from .observer import ColumnObserver, NamedColumn

Array = NDArray[np.float64]


class DriftObserver(ColumnObserver):
    """Weighted mean of the second half of a window less that of the first half.

    Parameters
    ----------
    columns, names: as in :class:`ColumnObserver`
    start_s, end_s: the window [s]; rows after its start and up to its end count
    """

    KEPT = ("_weights", "_sums")

    def __init__(self, columns: Sequence[NamedColumn], names: Sequence[str], *, start_s: float, end_s: float) -> None:
        if not end_s > start_s:
            raise ValueError(f"window: expected an end after its start {start_s!r} s, got {end_s!r} s")
        super().__init__(columns, names)
        self._window = start_s, end_s
        self._weights = np.zeros(2)
        self._sums = np.zeros((len(self.names), 2))

    def take(self, time: Array, samples: Array) -> None:
        """Add the rows to the half they belong to."""
        start, end = self._window
        place = 2.0 * (time - start) / (end - start)  # 0 to 1: first half, 1 to 2: second half
        weight = weigh_hann(place)
        first, middle, last = np.searchsorted(place, (0.0, 1.0, 2.0), side="right")
        for half, inside in enumerate((slice(first, middle), slice(middle, last))):
            self._weights[half] += weight[inside].sum()
            self._sums[:, half] += samples[:, inside] @ weight[inside]

    def result(self) -> Array:
        """The difference (signals,) in the unit of each signal; NaN until both halves have rows."""
        if not (self._weights > 0.0).all():
            return np.full(len(self.names), np.nan)
        means = self._sums / self._weights
        drift: Array = means[:, 1] - means[:, 0]
        return drift
