"""Statistics of pointing errors, block by block: mean, RMS, standard deviation, peak, drift.

The sums of squares are kept about the running mean and combined pairwise (T. F. Chan, G. H. Golub, R. J.
LeVeque, Algorithms for computing the sample variance, The American Statistician 37 (1983) 242-247).  A
sum of plain squares would lose the jitter under a pointing offset.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...reduction.moments import find_moments, weigh_hann
from .observer import ColumnObserver, NamedColumn

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class SignalStatistics:
    """Statistics of each signal, in the order of ``names``: arrays of shape (signals,) in its unit."""

    names: tuple[str, ...]
    units: tuple[str, ...]
    count: int
    mean: Array
    rms: Array
    std: Array  # about the mean, divided by count
    peak: Array  # largest magnitude


class Statistics(ColumnObserver):
    """Mean, RMS, standard deviation and peak of the named columns."""

    KEPT = ("count", "_mean", "_squares", "_peak")

    def __init__(self, columns: Sequence[NamedColumn], names: Sequence[str], *, start_s: float = -math.inf) -> None:
        super().__init__(columns, names, start_s=start_s)
        self.count = 0
        self._mean = np.zeros(len(self.names))
        self._squares = np.zeros(len(self.names))  # sum of squared deviations from the mean
        self._peak = np.zeros(len(self.names))

    def take(self, time: Array, samples: Array) -> None:
        """Combine the block's mean and squared deviations with those so far."""
        new = samples.shape[1]
        mean, squares, peak = find_moments(samples).T
        total = self.count + new
        offset = mean - self._mean
        self._squares += squares + np.square(offset) * (self.count * new / total)
        self._mean += offset * (new / total)
        self.count = total
        np.maximum(self._peak, peak, out=self._peak)

    def result(self) -> SignalStatistics:
        """The statistics so far; raises ``ValueError`` if no row has been seen."""
        self.take_held()
        if not self.count:
            raise ValueError(f"no rows seen at or after {self.start_s} s")
        variance = np.maximum(self._squares, 0.0) / self.count
        return SignalStatistics(
            names=self.names,
            units=self.units,
            count=self.count,
            mean=self._mean.copy(),
            rms=np.sqrt(np.square(self._mean) + variance),
            std=np.sqrt(variance),
            peak=self._peak.copy(),
        )


class DriftObserver(ColumnObserver):
    """Weighted mean of the second half of a window less that of the first half.

    The mean of a noisy signal over half a window is not zero without drift: its slowest lines leave something behind.
    So both halves are weighted by a Hann window, w(t) = 1 - cos(2 pi t / T), T the length of a half: a line that makes
    n cycles in T is reduced to 1/(pi n (n^2 - 1)) of its amplitude at most, 0.3 % for n = 5.

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
        self.take_held()
        if not (self._weights > 0.0).all():
            return np.full(len(self.names), np.nan)
        means = self._sums / self._weights
        drift: Array = means[:, 1] - means[:, 0]
        return drift
