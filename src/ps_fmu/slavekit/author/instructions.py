"""Elements of a step as the launcher's kernel reads them: kinds, places in the buffer, constants."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from ctypes import c_double, c_int64, c_void_p
from dataclasses import dataclass
from enum import IntEnum
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .buffer import Array, BufferLayout

Places = NDArray[np.int64]
"""Places in the buffer, (n,)."""
Operand = Array | Places
"""A view of the buffer, or places in it."""
_NEAR = 16  # numbers
_MANY = 8  # numbers

DELAY_NEWEST, DELAY_OUT, DELAY_AGE, DELAY_NEWEST_AGE, DELAY_RING = range(5)


class Kind(IntEnum):
    """As in ``native/kernel/core.h``."""

    SAMPLE, RAMP, PRODUCT, LINEAR, CLIP, EXCESS, SINE, QUANTISE, HOLD, DELAY, WATCH, COUNT, SPARSE, CALL = range(1, 15)


@dataclass(frozen=True, eq=False)
class Instruction:
    """What an element is made of; ``elements.c`` and ``timed.c`` say which kind uses what, and for what."""

    kind: Kind
    target: Places | None = None
    source: Places | None = None
    second: Places | None = None
    low: Array | None = None
    high: Array | None = None
    matrix: Array | None = None
    """LINEAR: by columns, see :func:`.blocks.store_by_columns`.  SPARSE: (n, n_source), for as many ``source``."""
    n: int = 0
    n_source: int = 0
    clock: int = -1
    time: float = 0.0
    """Period or delay, s."""
    function: int | None = None
    """Address of a compiled function."""
    arguments: ctypes.Structure | None = None

    def list_writes(self) -> list[int]:
        """Places that it writes, without a ring."""
        written = [] if self.target is None else self.target.tolist()
        if self.second is not None and self.kind in (Kind.HOLD, Kind.COUNT):
            written += self.second.tolist()
        n_kept = 0 if self.clock < 0 else DELAY_RING if self.kind == Kind.DELAY else 1
        return [*written, *range(self.clock, self.clock + n_kept)]

    def count_scratch(self) -> int:
        """Numbers that the kernel needs beside the buffer."""
        if self.matrix is None:
            return 0
        return self.n if self.kind == Kind.SPARSE else self.matrix.shape[1] + self.n_source


def tell_neighbours(*lists: Places) -> int:
    """``n_source`` of an element that is quicker with many places side by side: 1 if those of each list are, else 0.

    Few numbers have often just been written one by one; to read two of them at once then has to wait.
    """
    return int(all(places.size >= _MANY and (np.diff(places) == 1).all() for places in lists))


class Words(ctypes.Structure):
    """The structure ``Element`` in ``native/kernel/core.h``."""

    _fields_ = (
        ("kind", c_int64), ("n", c_int64),
        ("source", c_void_p), ("second", c_void_p), ("target", c_void_p), ("low", c_void_p), ("high", c_void_p),
        ("matrix", c_void_p), ("stride", c_int64), ("n_source", c_int64), ("clock", c_int64), ("time", c_double),
        ("function", c_void_p), ("arguments", c_void_p),
    )  # fmt: skip


def write_words(instructions: Sequence[Instruction]) -> ctypes.Array[Words]:
    """The instructions as one array for the kernel.  Their own arrays have to be kept as long."""
    words = (Words * max(len(instructions), 1))()
    for k, e in enumerate(instructions):
        stride = 0 if e.matrix is None else e.matrix.shape[1]
        addresses = (find_address(array) for array in (e.source, e.second, e.target, e.low, e.high, e.matrix))
        given = None if e.arguments is None else ctypes.addressof(e.arguments)
        words[k] = Words(e.kind, e.n, *addresses, stride, e.n_source, e.clock, e.time, e.function, given)
    return words


def find_spans(places: Sequence[int]) -> Places:
    """Spans of the buffer with all these places, (spans, 2): where each begins, and how many numbers it has.

    Near ones are one span: to copy a few numbers more takes less time than to begin again.
    """
    found = np.array(sorted(set(places)), dtype=np.int64)  # np.unique imports 4 MB first
    if not found.size:
        return np.empty((0, 2), dtype=np.int64)
    ends = np.flatnonzero(np.diff(found) > _NEAR)
    first, last = found[np.append(0, ends + 1)], found[np.append(ends, -1)]
    return np.stack([first, last - first + 1], axis=1)


def find_address(array: NDArray[Any] | None) -> int | None:
    """Where an array begins in memory."""
    return None if array is None else int(array.__array_interface__["data"][0])


class Finder:
    """Finds places and constants of elements, and refuses what is impossible.

    All methods raise ValueError; the text starts with ``what``, the name of the field.
    """

    def __init__(self, layout: BufferLayout, data: Array) -> None:
        self._layout, self._data = layout, data
        self._first = find_address(data) or 0
        y, a, m = layout.y, layout.a, layout.memory
        self._written = np.zeros(layout.size, dtype=bool)
        self._written[y.start : layout.x.stop] = self._written[a] = self._written[m] = True
        self._owned = np.zeros(layout.size, dtype=bool)

    def places(self, what: str, operand: Any, n: int | None = None) -> Places:
        """Places of a view of the buffer, or these places themselves; ``n`` of them, unless None."""
        found = self._find(what, operand)
        if found.size == 0 or (n is not None and found.size != n):
            raise ValueError(f"{what} has {found.size} numbers; expected {n or 'at least 1'}")
        return found

    def targets(self, what: str, operand: Any, n: int | None = None) -> Places:
        """As :meth:`places`, of what a step may write: outputs, states, auxiliary inputs, memory."""
        found = self.places(what, operand, n)
        if not self._written[found].all():
            name = self._layout.describe(int(found[~self._written[found]][0]))
            raise ValueError(f"{what}: a step must not write {name}; expected outputs, states, auxiliary or memory")
        return found

    def memory(self, what: str, operand: Any, n: int) -> Places:
        """As :meth:`places`, of numbers that only this element writes."""
        found, memory = self.places(what, operand, n), self._layout.memory
        if not (memory.start <= found.min() and found.max() < memory.stop):
            raise ValueError(f"{what}: expected a part of memory")
        if self._owned[found].any():
            raise ValueError(f"{what}: expected memory of its own, another element keeps its numbers there")
        self._owned[found] = True
        return found

    def flag(self, what: str, operand: Any) -> int:
        """The place of one Boolean output, by its view or its name; -1 for None."""
        if operand is None:
            return -1
        if isinstance(operand, str):
            place = self._layout.reference.get(operand, -1)
        else:
            place = int(self.places(what, operand, 1)[0])
        port = self._layout.by_reference.get(place)
        if port is None or port.causality != "output" or port.type != "Boolean":
            raise ValueError(f"{what}: expected a Boolean output")
        return place

    def constants(self, what: str, value: ArrayLike, n: int, *, finite: bool = True) -> Array:
        """A number or ``n`` numbers, as (n,)."""
        try:
            given, found = np.asarray(value, dtype=np.float64), np.empty(n)
            if given.ndim > 1:
                raise ValueError
            found[:] = given
        except (TypeError, ValueError):
            raise ValueError(f"{what}: expected a number or {n} numbers, got {value!r}") from None
        if not (np.isfinite(found).all() if finite else not np.isnan(found).any()):
            raise ValueError(f"{what}: expected {'finite numbers' if finite else 'numbers'}, got {value!r}")
        return found

    def value(self, place: int) -> float:
        """The number at a place now."""
        return float(self._data[place])

    def _find(self, what: str, operand: Any) -> Places:
        if not isinstance(operand, np.ndarray) or operand.ndim != 1:
            kind = type(operand).__name__
            raise ValueError(f"{what}: expected a view of the buffer or places, such as memory[0:1]; got {kind}")
        if operand.dtype == np.int64:
            found = np.array(operand)
            inside = not found.size or (found.min() >= 0 and found.max() < self._layout.size)
        elif operand.dtype == np.float64 and operand.strides[0] % 8 == 0:
            first, stride = ((find_address(operand) or 0) - self._first) // 8, operand.strides[0] // 8
            found = np.arange(first, first + stride * operand.size, stride) if stride else np.full(operand.size, first)
            inside = all(0 <= place < self._layout.size for place in (first, first + stride * (operand.size - 1)))
        else:
            raise ValueError(f"{what}: expected numbers of the type float64, or places of the type int64")
        if not inside and found.size:
            raise ValueError(f"{what} does not lie in the buffer; expected a view of it, not a copy, or places")
        return found
