"""Statistics of signals during a motion and after it; a Boolean column says when something moves."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .observer import ColumnObserver, NamedColumn
from .statistics import SignalStatistics, Statistics

Array = NDArray[np.float64]

SAME_TIME_S = 1e-9  # times are products of a step: rounding of a thousand seconds and more


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
