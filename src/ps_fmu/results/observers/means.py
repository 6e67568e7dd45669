"""Mean values of a run in a few thousand time bins, for what is played back rather than measured.

What is faster than a bin is averaged away instead of being folded down to a motion that never was, and the memory does
not grow with the run.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .observer import ColumnObserver, NamedColumn

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Means:
    """Mean per bin: ``time`` (bins,) [s] of its first row, ``values`` (signals, bins)."""

    names: tuple[str, ...]
    time: Array
    values: Array

    def of(self, names: Sequence[str]) -> Array:
        """Some of the signals, (bins, names)."""
        return self.values[[self.names.index(name) for name in names]].T


class MeanObserver(ColumnObserver):
    """Means of the named columns in at most ``2 * bins`` time bins.

    Bins start one row wide; when the run outgrows them they are joined in pairs.
    """

    KEPT = ("_rows_per_bin", "_rows", "_time", "_sum")

    def __init__(self, columns: Sequence[NamedColumn], names: Sequence[str], *, bins: int = 1500) -> None:
        super().__init__(columns, names)
        if bins < 1:
            raise ValueError(f"bins: expected 1 or more, got {bins}")
        self._bins = 2 * bins
        self._rows_per_bin = 1
        self._rows = 0
        self._time = np.zeros(self._bins)
        self._sum = np.zeros((len(self.names), self._bins))

    def take(self, time: Array, samples: Array) -> None:
        """Add the rows to bins of equal width, doubling the width first if they would not fit."""
        count = samples.shape[1]
        while self._rows + count > self._bins * self._rows_per_bin:
            self._join_pairs()
        bins = np.arange(self._rows, self._rows + count) // self._rows_per_bin
        starts = np.flatnonzero(np.diff(bins, prepend=-1))
        self._sum[:, bins[starts]] += np.add.reduceat(samples, starts, axis=1)
        new = int(self._rows % self._rows_per_bin > 0)  # the first bin may have begun in an earlier block
        self._time[bins[starts[new:]]] = time[starts[new:]]
        self._rows += count

    def _join_pairs(self) -> None:
        half = self._bins // 2
        self._time[:half] = self._time[::2]
        self._sum[:, :half] = self._sum[:, ::2] + self._sum[:, 1::2]
        self._sum[:, half:] = 0.0
        self._rows_per_bin *= 2

    def result(self) -> Means:
        """The means so far; raises ``ValueError`` if no row has been seen."""
        if not self._rows:
            raise ValueError(f"no rows seen at or after {self.start_s} s")
        used = math.ceil(self._rows / self._rows_per_bin)
        counts = np.full(used, self._rows_per_bin)
        counts[-1] = self._rows - (used - 1) * self._rows_per_bin
        return Means(self.names, self._time[:used].copy(), self._sum[:, :used] / counts)
