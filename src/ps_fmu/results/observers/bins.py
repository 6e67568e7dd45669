"""Long runs in a few thousand time bins: extremes and means.

The memory does not grow with the run: bins start one row wide, and are joined in pairs when the run outgrows them.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from ...reduction.moments import widen_bins
from .observer import ColumnObserver, NamedColumn

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Envelope:
    """Extremes per bin: ``time`` (bins,) [s] of its first row, ``low`` and ``high`` (signals, bins)."""

    names: tuple[str, ...]
    units: tuple[str, ...]
    time: Array
    low: Array
    high: Array

    @property
    def middle(self) -> Array:
        """Half-way between the extremes (signals, bins); the signal itself where bins hold one row."""
        return 0.5 * (self.low + self.high)

    @property
    def magnitude(self) -> Array:
        """Largest magnitude per bin (signals, bins)."""
        return np.maximum(np.abs(self.low), np.abs(self.high))

    def coarsen(self, most: int) -> Envelope:
        """The envelope in at most ``most`` bins, joined in pairs as often as that takes."""
        width = 1
        while len(self.time) > most * width:
            width *= 2
        starts = np.arange(0, len(self.time), width)
        low, high = np.minimum.reduceat(self.low, starts, axis=1), np.maximum.reduceat(self.high, starts, axis=1)
        return Envelope(self.names, self.units, self.time[starts], low, high)


@dataclass(frozen=True, eq=False)
class Means:
    """Mean per bin: ``time`` (bins,) [s] of its first row, ``values`` (signals, bins)."""

    names: tuple[str, ...]
    time: Array
    values: Array

    def of(self, names: Sequence[str]) -> Array:
        """Some of the signals, (bins, names)."""
        return self.values[[self.names.index(name) for name in names]].T


class _BinObserver(ColumnObserver):
    """Sorts the rows of the named columns into at most ``2 * bins`` time bins of equal width."""

    KEPT: ClassVar[tuple[str, ...]] = ("_rows_per_bin", "_rows", "_time")

    def __init__(self, columns: Sequence[NamedColumn], names: Sequence[str], *, bins: int = 1500) -> None:
        super().__init__(columns, names)
        if bins < 1:
            raise ValueError(f"bins: expected 1 or more, got {bins}")
        self._bins = 2 * bins
        self._rows_per_bin = 1
        self._rows = 0
        self._time = np.zeros(self._bins)

    def take(self, time: Array, samples: Array) -> None:
        """Sort the rows into bins, doubling their width first if they would not fit."""
        count = samples.shape[1]
        while self._rows + count > self._bins * self._rows_per_bin:
            half = self._bins // 2
            self._time[:half] = self._time[::2]
            self._join_pairs(half)
            self._rows_per_bin *= 2
        width, begun = self._rows_per_bin, self._rows % self._rows_per_bin
        first = self._rows // width
        self._rows += count
        if begun:  # the first bin began in an earlier block
            end = min(width - begun, count)
            self._add(slice(first, first + 1), samples[:, :end], end)
            time, samples, first = time[end:], samples[:, end:], first + 1
        whole = len(time) // width
        used, inside = slice(first, first + whole), whole * width
        self._time[used] = time[:inside:width]
        self._add(used, samples[:, :inside], width)
        if inside < len(time):
            self._time[first + whole] = time[inside]
            self._add(slice(first + whole, first + whole + 1), samples[:, inside:], len(time) - inside)

    @abstractmethod
    def _add(self, bins: slice, samples: Array, width: int) -> None:
        """Add ``width`` samples to each of some bins."""

    @abstractmethod
    def _join_pairs(self, half: int) -> None:
        """Make one bin of each two, which are then the first half."""

    def _count_used(self) -> int:
        """How many bins have rows; raises ``ValueError`` if none has been seen."""
        self.take_held()
        if not self._rows:
            raise ValueError("no rows seen")
        return math.ceil(self._rows / self._rows_per_bin)


class EnvelopeObserver(_BinObserver):
    """Extremes of the named columns in at most ``2 * bins`` time bins: every peak survives."""

    KEPT = (*_BinObserver.KEPT, "_low", "_high")

    def __init__(self, columns: Sequence[NamedColumn], names: Sequence[str], *, bins: int = 1500) -> None:
        super().__init__(columns, names, bins=bins)
        self._low = np.full((len(self.names), self._bins), np.inf)
        self._high = np.full((len(self.names), self._bins), -np.inf)

    def _add(self, bins: slice, samples: Array, width: int) -> None:
        widen_bins(samples, width, self._low[:, bins], self._high[:, bins])

    def _join_pairs(self, half: int) -> None:
        self._low[:, :half] = np.minimum(self._low[:, ::2], self._low[:, 1::2])
        self._high[:, :half] = np.maximum(self._high[:, ::2], self._high[:, 1::2])
        self._low[:, half:], self._high[:, half:] = np.inf, -np.inf

    def result(self) -> Envelope:
        """The envelope so far; raises ``ValueError`` if no row has been seen."""
        used = self._count_used()
        kept = (each[..., :used].copy() for each in (self._time, self._low, self._high))
        return Envelope(self.names, self.units, *kept)


class MeanObserver(_BinObserver):
    """Means of the named columns in at most ``2 * bins`` time bins, for what is played back rather than measured.

    What is faster than a bin is averaged away instead of being folded down to a motion that never was.
    """

    KEPT = (*_BinObserver.KEPT, "_sum")

    def __init__(self, columns: Sequence[NamedColumn], names: Sequence[str], *, bins: int = 1500) -> None:
        super().__init__(columns, names, bins=bins)
        self._sum = np.zeros((len(self.names), self._bins))

    def _add(self, bins: slice, samples: Array, width: int) -> None:
        starts = np.arange(0, samples.shape[1], width)
        if len(starts):
            self._sum[:, bins] += np.add.reduceat(samples, starts, axis=1)

    def _join_pairs(self, half: int) -> None:
        self._sum[:, :half] = self._sum[:, ::2] + self._sum[:, 1::2]
        self._sum[:, half:] = 0.0

    def result(self) -> Means:
        """The means so far; raises ``ValueError`` if no row has been seen."""
        used = self._count_used()
        counts = np.full(used, self._rows_per_bin)
        counts[-1] = self._rows - (used - 1) * self._rows_per_bin
        return Means(self.names, self._time[:used].copy(), self._sum[:, :used] / counts)
