"""Statistics of signals during a motion and after it; a Boolean column says when something moves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .kept import State, check_array
from .observer import ColumnObserver, NamedColumn
from .statistics import SignalStatistics, Statistics

Array = NDArray[np.float64]

SAME_TIME_S = 1e-9  # times are products of a step: rounding of a thousand seconds and more


class LastRow(ColumnObserver):
    """The last row of the named columns."""

    def __init__(self, columns: Sequence[NamedColumn], names: Sequence[str]) -> None:
        super().__init__(columns, names)
        self._taken = np.array(self.places)
        self._last: Array | None = None

    def save_state(self) -> dict[str, Any]:
        """As :meth:`ColumnObserver.save_state`."""
        return {"last": self._last}

    def load_state(self, state: State) -> None:
        """As :meth:`ColumnObserver.load_state`."""
        last = state["last"]
        self._last = None if last is None else check_array("last", last, np.zeros(len(self.names)))

    def block(self, first_index: int, time: Array, values: Array) -> None:
        """As in :class:`ColumnObserver`; the other rows are not looked at."""
        if len(time):
            self._last = values[-1].take(self._taken)

    def take(self, time: Array, samples: Array) -> None:
        """Keep the last row."""
        self._last = samples[:, -1].copy()

    def result(self) -> Array:
        """Values (signals,) of the last row so far; raises ``ValueError`` if no row has been seen."""
        if self._last is None:
            raise ValueError("no rows seen")
        return self._last


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

    def __init__(self, columns: Sequence[NamedColumn], names: Sequence[str], *, flag: str, settle_s: float) -> None:
        super().__init__(columns, (flag, *names))
        self._statistics = lambda: Statistics(columns, names)
        self._during: Statistics | None = None
        self._after: Statistics | None = None
        self._settle_s = settle_s
        self._began_s: float | None = None
        self._ended_s: float | None = None
        self._settled = False
        self._final: tuple[float, Array] | None = None

    def save_state(self) -> dict[str, Any]:
        """As :meth:`ColumnObserver.save_state`."""
        return {
            "during": None if self._during is None else self._during.save_state(),
            "after": None if self._after is None else self._after.save_state(),
            "began_s": self._began_s,
            "ended_s": self._ended_s,
            "settled": self._settled,
            "final": None if self._final is None else list(self._final),
        }

    def load_state(self, state: State) -> None:
        """As :meth:`ColumnObserver.load_state`."""
        self._during, self._after = (self._load_statistics(state[name]) for name in ("during", "after"))
        times = [state["began_s"], state["ended_s"]]
        self._began_s, self._ended_s = (None if time is None else float(time) for time in times)
        if not isinstance(state["settled"], bool):
            raise ValueError(f"settled: expected true or false, found {state['settled']!r}")
        self._settled, self._final = state["settled"], None
        if state["final"] is not None:
            time, values = state["final"]
            self._final = float(time), check_array("final", values, np.zeros(len(self.names) - 1))

    def _load_statistics(self, state: State | None) -> Statistics | None:
        if state is None:
            return None
        found = self._statistics()
        found.load_state(state)
        return found

    def take(self, time: Array, samples: Array) -> None:
        """Add the rows of the block to the statistics of the motion or to those after it."""
        moving = samples[0] > 0.5
        signals = samples[1:]
        first = 0
        if moving.any():
            first = int(np.flatnonzero(moving)[-1]) + 1
            if self._began_s is None:
                self._began_s = float(time[moving][0])
            self._ended_s = float(time[first - 1])
            self._during = self._during or self._statistics()
            self._during.take(time[moving], signals[:, moving])
            # What came between two motions is neither.
            self._after, self._settled = None, False
        if self._ended_s is not None and first < len(time):
            self._after = self._after or self._statistics()
            self._after.take(time[first:], signals[:, first:])
        if not self._settled:
            place = len(time) - 1
            if self._ended_s is not None:
                late = time >= self._ended_s + self._settle_s - SAME_TIME_S
                self._settled = bool(late.any())
                place = int(np.argmax(late)) if self._settled else place
            self._final = float(time[place]), signals[:, place].copy()

    def result(self) -> Arrival:
        """The motion so far; raises ``ValueError`` if no row has been seen."""
        if self._final is None:
            raise ValueError("no rows seen")
        return Arrival(
            names=self.names[1:],
            began_s=self._began_s,
            ended_s=self._ended_s,
            during=self._during.result() if self._during is not None else None,
            after=self._after.result() if self._after is not None else None,
            settled=self._settled,
            final_s=self._final[0],
            final=self._final[1],
        )
