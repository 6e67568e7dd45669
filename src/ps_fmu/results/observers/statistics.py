"""Statistics of pointing errors, block by block: mean, RMS, standard deviation, peak.

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

from ...reduction.moments import find_moments
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

    KEPT = ("_count", "_mean", "_squares", "_peak")

    def __init__(self, columns: Sequence[NamedColumn], names: Sequence[str], *, start_s: float = -math.inf) -> None:
        super().__init__(columns, names, start_s=start_s)
        self._count = 0
        self._mean = np.zeros(len(self.names))
        self._squares = np.zeros(len(self.names))  # sum of squared deviations from the mean
        self._peak = np.zeros(len(self.names))

    def take(self, time: Array, samples: Array) -> None:
        """Combine the block's mean and squared deviations with those so far."""
        new = samples.shape[1]
        mean, squares, peak = find_moments(samples).T
        total = self._count + new
        offset = mean - self._mean
        self._squares += squares + np.square(offset) * (self._count * new / total)
        self._mean += offset * (new / total)
        self._count = total
        np.maximum(self._peak, peak, out=self._peak)

    def result(self) -> SignalStatistics:
        """The statistics so far; raises ``ValueError`` if no row has been seen."""
        if not self._count:
            raise ValueError(f"no rows seen at or after {self.start_s} s")
        variance = np.maximum(self._squares, 0.0) / self._count
        return SignalStatistics(
            names=self.names,
            units=self.units,
            count=self._count,
            mean=self._mean.copy(),
            rms=np.sqrt(np.square(self._mean) + variance),
            std=np.sqrt(variance),
            peak=self._peak.copy(),
        )
