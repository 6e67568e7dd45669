"""The base of the streaming observers: they take a run block by block and keep only what their result needs.

A co-simulation master hands each block of rows to ``block(first_index, time, values)``; an observer picks its
columns by name.  Memory does not grow with the length of the run, and the result does not depend on how the
run was cut into blocks (beyond rounding).
"""

from __future__ import annotations

import difflib
import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any, ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray

from ...reduction.columns import ColumnCopy
from .kept import State, load_attributes, save_attributes

Array = NDArray[np.float64]


class NamedColumn(Protocol):
    """What an observer needs to know of a recorded column."""

    @property
    def name(self) -> str:
        """Component and variable, for example ``plant.los.x``."""

    @property
    def unit(self) -> str:
        """SI unit, for example ``m``."""


def find_columns(columns: Sequence[NamedColumn], names: Sequence[str]) -> list[int]:
    """Places of the named columns, in the order of ``names``.

    Raises ``KeyError`` for a name that is not there, with the closest names that are.
    """
    places = {column.name: place for place, column in enumerate(columns)}
    missing = [name for name in names if name not in places]
    if missing:
        near = difflib.get_close_matches(missing[0], places, n=3, cutoff=0.5)
        hint = f"the closest are {', '.join(near)}" if near else f"there are {len(places)} columns"
        raise KeyError(f"no column named {', '.join(missing)}: {hint}")
    return [places[name] for name in names]


class ColumnObserver(ABC):
    """Picks the named columns out of each block and passes them on to :meth:`take`.

    Parameters
    ----------
    columns: all columns of the run, in the order of the blocks
    names: the columns to observe, in the order of the results
    start_s: rows before this time [s] are left out (settling)

    Raises ``KeyError`` when a name is not among the columns, ``ValueError`` when there are no names.
    """

    KEPT: ClassVar[tuple[str, ...]] = ()
    """Attributes that change during a run: a checkpoint keeps them."""
    GROWING: ClassVar[tuple[str, ...]] = ()
    """Those that are arrays whose length changes."""

    def __init__(self, columns: Sequence[NamedColumn], names: Sequence[str], *, start_s: float = -math.inf) -> None:
        if not names:
            raise ValueError("names: at least one column is needed")
        self.names = tuple(names)
        self.places = find_columns(columns, names)
        self._copy = ColumnCopy(self.places, len(columns))
        self.units = tuple(columns[place].unit for place in self.places)
        self.start_s = start_s

    def block(self, first_index: int, time: Array, values: Array) -> None:
        """Take ``values`` (rows, columns) at ``time`` (rows,) [s]; ``first_index`` counts rows from 0."""
        samples = np.empty((len(self.names), len(time)))
        self.copy_columns(values, samples)
        self.take_from_start(time, samples)

    def copy_columns(self, values: Array, samples: Array) -> None:
        """Copy the named columns of ``values`` (rows, columns) into ``samples`` (signals, rows).

        Samples of one signal lie side by side: numpy sums pairwise and transforms along the last axis.
        """
        self._copy.run(np.ascontiguousarray(values, dtype=np.float64), samples)

    def take_from_start(self, time: Array, samples: Array) -> None:
        """As :meth:`take`, but of the rows from ``start_s`` on, if there are any."""
        first = int(np.searchsorted(time, self.start_s)) if len(time) and time[0] < self.start_s else 0
        if first < len(time):
            self.take(time[first:], samples[:, first:])

    def save_state(self) -> dict[str, Any]:
        """What a checkpoint keeps; valid until the next block."""
        return save_attributes(self, self.KEPT)

    def load_state(self, state: State) -> None:
        """Go on from a state of :meth:`save_state` of an observer made in the same way.

        Raises KeyError or ValueError for a state that is none of this observer.
        """
        load_attributes(self, self.KEPT, state, self.GROWING)

    @abstractmethod
    def take(self, time: Array, samples: Array) -> None:
        """Take the observed ``samples`` (signals, rows), a copy of the block; ``time`` (rows,) [s]."""
