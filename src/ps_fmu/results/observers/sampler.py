"""Rows of a run as they are: all of them, those at given places, the last one."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .observer import ColumnObserver, NamedColumn, State, check_array, find_columns, load_attributes, save_attributes

Array = NDArray[np.float64]


class HistoryObserver(ColumnObserver):
    """Keeps every row of the named columns: 8 bytes for each value, 24 MB for 3 signals over 100 s at 0.1 ms."""

    def __init__(self, columns: Sequence[NamedColumn], names: Sequence[str]) -> None:
        super().__init__(columns, names)
        self._blocks: list[Array] = [np.empty((len(self.names), 0))]

    def take(self, time: Array, samples: Array) -> None:
        """Keep the rows."""
        self._blocks.append(samples)

    def save_state(self) -> dict[str, Any]:
        """As :meth:`ColumnObserver.save_state`."""
        return {"rows": self._join()}

    def load_state(self, state: State) -> None:
        """As :meth:`ColumnObserver.load_state`."""
        self._blocks = [check_array("rows", state["rows"].T, self._blocks[0].T, grows=True).T]

    def result(self) -> Array:
        """(signals, rows).  Raises ``ValueError`` if no row has been seen."""
        if not (found := self._join()).size:
            raise ValueError("no rows seen")
        return found

    def _join(self) -> Array:
        self._blocks = [np.concatenate(self._blocks, axis=1)]
        return self._blocks[0]


class SampleObserver:
    """Keeps the rows with the given indices, row 0 being the state after initialisation.

    Parameters
    ----------
    columns: all columns of the run, in the order of the blocks
    names: the columns to keep
    rows: indices of the rows, in any order
    """

    def __init__(self, columns: Sequence[NamedColumn], names: Sequence[str], rows: Sequence[int]) -> None:
        self.names = tuple(names)
        self._columns = np.array(find_columns(columns, names))
        self._rows = np.asarray(rows, dtype=np.int64)
        self._values = np.full((len(self._rows), len(self.names)), np.nan)

    def block(self, first_index: int, time: Array, values: Array) -> None:
        """Take ``values`` (rows, columns) at ``time`` (rows,) [s]."""
        places = self._rows - first_index
        within = np.flatnonzero((places >= 0) & (places < len(time)))
        self._values[within] = values[np.ix_(places[within], self._columns)]

    def save_state(self) -> dict[str, Any]:
        """As :meth:`ColumnObserver.save_state`."""
        return save_attributes(self, ("_values",))

    def load_state(self, state: State) -> None:
        """As :meth:`ColumnObserver.load_state`."""
        load_attributes(self, ("_values",), state)

    def values(self, *names: str) -> Array:
        """Values of some columns at the rows, (rows, names); NaN where the run did not get there."""
        return self._values[:, [self.names.index(name) for name in names]]


class LastRow(ColumnObserver):
    """The last row of the named columns."""

    KEPT = ("_last", "_seen")

    def __init__(self, columns: Sequence[NamedColumn], names: Sequence[str]) -> None:
        super().__init__(columns, names)
        self._last = np.empty(len(self.names))
        self._seen = False

    def block(self, first_index: int, time: Array, values: Array) -> None:
        """As in :class:`ColumnObserver`; the other rows are not looked at."""
        if len(time):
            self.take(time[-1:], values[-1:, self.places].T)

    def take(self, time: Array, samples: Array) -> None:
        """Keep the last row."""
        self._last, self._seen = samples[:, -1].copy(), True

    def result(self) -> Array:
        """Values (signals,) of the last row so far; raises ``ValueError`` if no row has been seen."""
        if not self._seen:
            raise ValueError("no rows seen")
        return self._last
