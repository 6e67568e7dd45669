"""Time histories of long runs for figures: smallest and largest value in each of a few thousand time bins.

Every peak survives, unlike in a decimated history, and the memory does not grow with the run.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...reduction.moments import widen_bins
from .kept import State, check_array
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
        return Envelope(
            self.names,
            self.units,
            self.time[starts],
            np.minimum.reduceat(self.low, starts, axis=1),
            np.maximum.reduceat(self.high, starts, axis=1),
        )


class EnvelopeObserver(ColumnObserver):
    """Extremes of the named columns in at most ``2 * bins`` time bins.

    Bins start one row wide; when the run outgrows them they are joined in pairs.
    """

    KEPT = ("_rows_per_bin", "_rows")

    def __init__(
        self,
        columns: Sequence[NamedColumn],
        names: Sequence[str],
        *,
        bins: int = 1500,
        start_s: float = -math.inf,
    ) -> None:
        super().__init__(columns, names, start_s=start_s)
        if bins < 1:
            raise ValueError(f"bins: expected 1 or more, got {bins}")
        self._bins = 2 * bins
        self._rows_per_bin = 1
        self._rows = 0
        self._time = np.zeros(self._bins)
        self._low = np.full((len(self.names), self._bins), np.inf)
        self._high = np.full((len(self.names), self._bins), -np.inf)

    def take(self, time: Array, samples: Array) -> None:
        """Sort the rows into bins of equal width, doubling the width first if they would not fit."""
        count = samples.shape[1]
        while self._rows + count > self._bins * self._rows_per_bin:
            self._join_pairs()
        width, begun = self._rows_per_bin, self._rows % self._rows_per_bin
        first = self._rows // width
        self._rows += count
        if begun:  # the first bin began in an earlier block
            end = min(width - begun, count)
            self._widen(slice(first, first + 1), samples[:, :end], end)
            time, samples, first = time[end:], samples[:, end:], first + 1
        whole = len(time) // width
        used, inside = slice(first, first + whole), whole * width
        self._time[used] = time[:inside:width]
        self._widen(used, samples[:, :inside], width)
        if inside < len(time):
            self._time[first + whole] = time[inside]
            self._widen(slice(first + whole, first + whole + 1), samples[:, inside:], len(time) - inside)

    def _widen(self, bins: slice, samples: Array, width: int) -> None:
        """Widen some bins by ``width`` samples each."""
        widen_bins(samples, width, self._low[:, bins], self._high[:, bins])

    def _join_pairs(self) -> None:
        half = self._bins // 2
        self._time[:half] = self._time[::2]
        self._low[:, :half] = np.minimum(self._low[:, ::2], self._low[:, 1::2])
        self._high[:, :half] = np.maximum(self._high[:, ::2], self._high[:, 1::2])
        self._low[:, half:] = np.inf
        self._high[:, half:] = -np.inf
        self._rows_per_bin *= 2

    def save_state(self) -> dict[str, Any]:
        """As :meth:`ColumnObserver.save_state`: the bins that are used."""
        used = math.ceil(self._rows / self._rows_per_bin)
        bins = {"time": self._time[:used], "low": self._low[:, :used], "high": self._high[:, :used]}
        return {**super().save_state(), **bins}

    def load_state(self, state: State) -> None:
        """As :meth:`ColumnObserver.load_state`."""
        super().load_state(state)
        used = len(state["time"])
        if self._rows_per_bin < 1 or used != math.ceil(self._rows / self._rows_per_bin) or used > self._bins:
            raise ValueError(f"time: {used} bins of {self._rows_per_bin} rows for {self._rows} rows")
        self._low[:], self._high[:] = np.inf, -np.inf
        for name, own in (("time", self._time[None]), ("low", self._low), ("high", self._high)):
            found = np.atleast_2d(state[name])
            check_array(name, found, own[:, :used])
            own[:, :used] = found

    def result(self) -> Envelope:
        """The envelope so far; raises ``ValueError`` if no row has been seen."""
        if not self._rows:
            raise ValueError(f"no rows seen at or after {self.start_s} s")
        used = math.ceil(self._rows / self._rows_per_bin)
        return Envelope(
            names=self.names,
            units=self.units,
            time=self._time[:used].copy(),
            low=self._low[:, :used].copy(),
            high=self._high[:, :used].copy(),
        )
