"""The base of the streaming observers: they take a run block by block and keep only what their result needs.

A co-simulation master hands each block of rows to ``block(first_index, time, values)``; an observer picks its
columns by name.  Memory does not grow with the length of the run, and the result does not depend on how the
run was cut into blocks (beyond rounding).  Observers of one run may share a :class:`Batch`.
"""

from __future__ import annotations

import difflib
import math
from abc import ABC, abstractmethod
from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import Any, ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray

from ...reduction.columns import ColumnCopy

Array = NDArray[np.float64]

BATCH_ROWS = 8000
"""As many of six columns as the second cache holds; each look costs as much as some 1000 rows."""


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
        self.batch: Batch | None = None  # that hands it its rows

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

    def take_held(self) -> None:
        """Take the rows that its batch still holds: a result begins with this."""
        if self.batch is not None:
            self.batch.flush()

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


class Buffer:
    """Samples (signals, rows) that are gathered until there is no room for more.

    ``held`` are the rows so far, and ``room`` is the whole.
    """

    def __init__(self, signals: int, rows: int) -> None:
        self.room: Array = np.empty((signals, rows))
        self.filled = 0

    @property
    def held(self) -> Array:
        """The rows so far, (signals, filled)."""
        return self.room[:, : self.filled]

    def add(self, samples: Array) -> Iterator[Array]:
        """Add rows (signals, n); the whole, each time that it is full.  Who takes it sets ``filled``."""
        taken, rows = 0, self.room.shape[1]
        while taken < samples.shape[1]:
            count = min(rows - self.filled, samples.shape[1] - taken)
            self.room[:, self.filled : self.filled + count] = samples[:, taken : taken + count]
            taken += count
            self.filled += count
            if self.filled == rows:
                yield self.room

    def save_state(self) -> dict[str, Any]:
        """As :meth:`ColumnObserver.save_state`."""
        return {"held": self.held}

    def load_state(self, state: State) -> None:
        """As :meth:`ColumnObserver.load_state`."""
        held = check_array("held", state["held"].T, self.room.T, grows=True).T
        if held.shape[1] >= self.room.shape[1]:
            raise ValueError(f"held: expected less than {self.room.shape[1]} rows, found {held.shape[1]}")
        self.filled = held.shape[1]
        self.held[:] = held


class Batch(ColumnObserver):
    """Hands its members their columns in batches of :data:`BATCH_ROWS` rows, however the run is cut into blocks.

    The columns are copied once, and looked at some thousand rows at a time.  Results of the members have all rows.

    Parameters
    ----------
    columns: all columns of the run, in the order of the blocks
    members: those that observe some of them, and copy what they keep
    """

    KEPT = ("_times", "_rows", "_members")

    def __init__(self, columns: Sequence[NamedColumn], members: Sequence[ColumnObserver]) -> None:
        super().__init__(columns, list(dict.fromkeys(name for member in members for name in member.names)))
        self._members = list(members)
        self._places = [_as_slice([self.names.index(name) for name in member.names]) for member in members]
        self._times, self._rows = Buffer(1, BATCH_ROWS), Buffer(len(self.names), BATCH_ROWS)
        for member in members:
            member.batch = self

    def block(self, first_index: int, time: Array, values: Array) -> None:
        """As in :class:`ColumnObserver`."""
        taken = 0
        while taken < len(time):
            filled = self._rows.filled
            count = min(BATCH_ROWS - filled, len(time) - taken)
            rows, goal = slice(taken, taken + count), slice(filled, filled + count)
            self._times.room[0, goal] = time[rows]
            self.copy_columns(values[rows], self._rows.room[:, goal])
            taken += count
            self._times.filled = self._rows.filled = filled + count
            if self._rows.filled == BATCH_ROWS:
                self.flush()

    def take(self, time: Array, samples: Array) -> None:
        """Hand out a batch."""
        for member, places in zip(self._members, self._places, strict=True):
            member.take_from_start(time, samples[places])

    def flush(self) -> None:
        """Hand out the rows that are held."""
        times, rows = self._times.held[0], self._rows.held
        self._times.filled = self._rows.filled = 0
        if len(times):
            self.take(times, rows)


def _as_slice(places: list[int]) -> slice | list[int]:
    """Neighbours as a slice, which is no copy."""
    return slice(places[0], places[-1] + 1) if places == list(range(places[0], places[-1] + 1)) else places


# --- States for checkpoints: attributes that change during a run, by name ---------------------------------------------

State = Mapping[str, Any]
"""Numbers, texts, arrays, None, and lists and dicts of such, by name."""


def save_attributes(owner: object, names: Sequence[str]) -> dict[str, Any]:
    """Attributes by name, without leading underscore; those that have a state of their own by that.

    Arrays are not copied.
    """
    return {name.lstrip("_"): _save(getattr(owner, name)) for name in names}


def load_attributes(owner: object, names: Sequence[str], state: State, growing: Collection[str] = ()) -> None:
    """Set attributes from a state of :func:`save_attributes`.

    Each has to be of the type that it has now, an array of the same dtype and shape; the first dimension of those that
    are ``growing`` may be another.  Raises KeyError for one that is missing, ValueError for one that does not fit.
    """
    for name in names:
        setattr(owner, name, _load(name.lstrip("_"), state[name.lstrip("_")], getattr(owner, name), name in growing))


def check_array(name: str, found: Any, like: NDArray[Any], *, grows: bool = False) -> NDArray[Any]:
    """The array, if it has the dtype and shape of another one, but perhaps for its length.  Raises ValueError."""
    fits = isinstance(found, np.ndarray) and found.dtype == like.dtype and found.ndim == like.ndim
    if not fits or found.shape[grows:] != like.shape[grows:]:
        what = f"{found.dtype} {found.shape}" if isinstance(found, np.ndarray) else type(found).__name__
        raise ValueError(f"{name}: expected an array {like.dtype} {like.shape}, found {what}")
    return np.array(found)


def _save(value: Any) -> Any:
    if isinstance(value, list):
        return [_save(one) for one in value]
    return value.save_state() if hasattr(value, "save_state") else value


def _load(name: str, found: Any, present: Any, grows: bool) -> Any:
    if hasattr(present, "load_state"):
        present.load_state(found)
        return present
    if isinstance(present, np.ndarray):
        return check_array(name, found, present, grows=grows)
    if type(found) is not type(present) or (isinstance(present, list) and len(found) != len(present)):
        raise ValueError(f"{name}: expected {type(present).__name__} as before, found {found!r}")
    if isinstance(present, list):
        return [_load(name, one, own, grows) for one, own in zip(found, present, strict=True)]
    return found
