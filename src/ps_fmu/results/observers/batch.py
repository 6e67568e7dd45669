"""Observers that take rows together: their columns are copied once, and looked at some thousand rows at a time."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .kept import State, check_array
from .observer import ColumnObserver, NamedColumn

Array = NDArray[np.float64]

BATCH_ROWS = 8000
"""As many of six columns as the second cache holds; each look costs as much as some 1000 rows."""


class Batch(ColumnObserver):
    """Hands its members their columns in batches of :data:`BATCH_ROWS` rows, however the run is cut into blocks.

    :meth:`flush` comes before their results are read.

    Parameters
    ----------
    columns: all columns of the run, in the order of the blocks
    members: those that observe some of them, and copy what they keep
    """

    def __init__(self, columns: Sequence[NamedColumn], members: Sequence[ColumnObserver]) -> None:
        super().__init__(columns, list(dict.fromkeys(name for member in members for name in member.names)))
        self._members = [(member, _as_slice([self.names.index(name) for name in member.names])) for member in members]
        self._times: Array = np.empty(BATCH_ROWS)
        self._held: Array = np.empty((len(self.names), BATCH_ROWS))
        self._filled = 0

    def block(self, first_index: int, time: Array, values: Array) -> None:
        """As in :class:`ColumnObserver`."""
        taken = 0
        while taken < len(time):
            count = min(BATCH_ROWS - self._filled, len(time) - taken)
            rows, goal = slice(taken, taken + count), slice(self._filled, self._filled + count)
            self._times[goal] = time[rows]
            self.copy_columns(values[rows], self._held[:, goal])
            taken += count
            self._filled += count
            if self._filled == BATCH_ROWS:
                self.flush()

    def take(self, time: Array, samples: Array) -> None:
        """Hand out a batch."""
        for member, places in self._members:
            member.take_from_start(time, samples[places])

    def flush(self) -> None:
        """Hand out the rows that are held."""
        filled, self._filled = self._filled, 0
        if filled:
            self.take(self._times[:filled], self._held[:, :filled])

    def save_state(self) -> dict[str, Any]:
        """As :meth:`ColumnObserver.save_state`."""
        held = {"times": self._times[: self._filled], "held": self._held[:, : self._filled]}
        return {**held, "members": [member.save_state() for member, _ in self._members]}

    def load_state(self, state: State) -> None:
        """As :meth:`ColumnObserver.load_state`."""
        times = check_array("times", state["times"], self._times, grows=True)
        held = check_array("held", state["held"].T, self._held.T, grows=True)
        if not len(times) == len(held) < BATCH_ROWS:
            raise ValueError(f"held: expected less than {BATCH_ROWS} rows, found {len(times)} and {len(held)}")
        for (member, _), one in zip(self._members, state["members"], strict=True):
            member.load_state(one)
        self._filled = len(times)
        self._times[: self._filled], self._held[:, : self._filled] = times, held.T


def _as_slice(places: list[int]) -> slice | list[int]:
    """Neighbours as a slice, which is no copy."""
    return slice(places[0], places[-1] + 1) if places == list(range(places[0], places[-1] + 1)) else places
