"""Statistics of pointing errors, block by block: mean, RMS, standard deviation, peak, drift; of motions, too.

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

SAME_TIME_S = 1e-9  # times are products of a step: rounding of a thousand seconds and more


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


@dataclass(frozen=True, eq=False)
class Arrival:
    """A motion and what came after it; arrays in the order of ``names``."""

    names: tuple[str, ...]
    began_s: float | None  # first and last row with the flag up; None: never
    ended_s: float | None
    during: SignalStatistics | None  # rows with the flag up
    after: SignalStatistics | None  # rows since; None: there are none
    settled: bool  # the run went on for the asked time after the end
    final_s: float  # when ``final`` was taken: that time after the end, or the last row
    final: Array  # (signals,)

    def value(self, *names: str) -> Array:
        """The final values of named signals, (len(names),)."""
        return self.final[[self.names.index(name) for name in names]]


class ArrivalObserver(ColumnObserver):
    """Observes the named columns while ``flag`` (a Boolean column) is up and after it went down for good.

    Parameters
    ----------
    flag: name of the column that is 1 while something moves, else 0
    settle_s: time after the end of the motion at which the final values are taken [s]
    """

    KEPT = ("_during", "_after", "_began_s", "_ended_s", "_settled", "_final_s", "_final")

    def __init__(self, columns: Sequence[NamedColumn], names: Sequence[str], *, flag: str, settle_s: float) -> None:
        super().__init__(columns, (flag, *names))
        self._make_statistics = lambda: Statistics(columns, names)
        self._during, self._after = self._make_statistics(), self._make_statistics()
        self._settle_s = settle_s
        self._began_s = self._ended_s = self._final_s = math.nan  # not yet
        self._settled = False
        self._final = np.empty(len(names))

    def take(self, time: Array, samples: Array) -> None:
        """Add the rows of the block to the statistics of the motion or to those after it."""
        moving = samples[0] > 0.5
        signals = samples[1:]
        first = 0
        if moving.any():
            first = int(np.flatnonzero(moving)[-1]) + 1
            if math.isnan(self._began_s):
                self._began_s = float(time[moving][0])
            self._ended_s = float(time[first - 1])
            self._during.take(time[moving], signals[:, moving])
            # What came between two motions is neither.
            self._after, self._settled = self._make_statistics(), False
        moved = not math.isnan(self._ended_s)
        if moved and first < len(time):
            self._after.take(time[first:], signals[:, first:])
        if not self._settled:
            place = len(time) - 1
            if moved:
                late = time >= self._ended_s + self._settle_s - SAME_TIME_S
                self._settled = bool(late.any())
                place = int(np.argmax(late)) if self._settled else place
            self._final_s, self._final = float(time[place]), signals[:, place].copy()

    def result(self) -> Arrival:
        """The motion so far; raises ``ValueError`` if no row has been seen."""
        self.take_held()
        if math.isnan(self._final_s):
            raise ValueError("no rows seen")
        began_s, ended_s = (None if math.isnan(time) else time for time in (self._began_s, self._ended_s))
        during, after = (one.result() if one.count else None for one in (self._during, self._after))
        return Arrival(self.names[1:], began_s, ended_s, during, after, self._settled, self._final_s, self._final)
