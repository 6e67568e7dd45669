"""One communication step as data: what is copied where, and which library function gets which arguments.

The plan is made once and executed by a short loop in C (:mod:`.compiled`): the index arrays, the addresses and the
constants in here are all that it needs.
"""

from __future__ import annotations

from collections.abc import Sequence
from ctypes import Structure, addressof, c_int64, c_void_p
from dataclasses import dataclass
from itertools import chain
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .checkpoint.state import Stateful
from .faults.effects import EffectGroup
from .fmu_instance import FmuInstance
from .rows import Array
from .signals import BoundSignal
from .structure import PortName


@dataclass(frozen=True)
class Call:
    """A library function with all its arguments, which are always the same objects.

    ``later`` says that it reads what fmi2DoStep has made.  To set or get, it takes the addresses of the value
    references and of the first of the ``values``, as many of each as there are names.  ``span`` (2,) is that of an
    fmi2DoStep over another time than the step: how much later it begins, and how long it is [s]; ``orders`` are
    those of derivatives.
    """

    instance: FmuInstance
    function: str
    address: int
    names: tuple[str, ...] = ()
    references: NDArray[np.uint32] | None = None
    values: NDArray[Any] | None = None
    later: bool = False
    span: Array | None = None
    orders: NDArray[np.int32] | None = None

    def check(self, status: int, time: float, step: float) -> None:
        """Count a warning in the step from ``time`` on [s], raise :class:`SlaveError` on anything worse."""
        self.instance.check(self.function, status, self._find_time(time, step), self.names)

    def describe(self, step: float) -> tuple[str, float]:
        """What last words call it, and how much later than a step of this size it is [s]."""
        return f"{self.instance.name}: {self.function}", self._find_time(0.0, step)

    def _find_time(self, time: float, step: float) -> float:
        if self.span is not None:
            return time + float(self.span[0])
        return time + step if self.later else time


@dataclass(frozen=True)
class Gather:
    """``inputs[i] = outputs[sources[i]]``: what the connections carry, for one kind of numbers.

    ``targets`` are the names of the inputs.
    """

    outputs: NDArray[Any]
    sources: NDArray[np.int64]
    inputs: NDArray[Any]
    targets: tuple[PortName, ...] = ()


@dataclass(frozen=True, eq=False)
class Change:
    """What else changes the gathered ``inputs`` in place.

    ``function``: ``"scale"`` multiplies the inputs at the places in ``table`` (n,), then adds; ``numbers`` (n, 2) are
    factor and offset.  ``"look_up"``: ``table`` (n, 3) has the place of an input, a value of it, and what it becomes.
    ``"extend"`` does what the ``Lines`` of lines.h at ``address`` say, which ``keeps`` has.
    """

    function: str
    inputs: NDArray[Any] | None = None
    table: NDArray[Any] | None = None
    numbers: NDArray[np.float64] | None = None
    address: int = 0
    keeps: object = None

    @property
    def count(self) -> int:
        """Length of the table."""
        return 0 if self.table is None else len(self.table)


class _Feed(Structure):
    """``Feed`` of loop.c."""

    _fields_ = (("samples", c_void_p), ("row", c_int64))


class Feed:
    """Puts the inputs of a run at the end of a ``step`` [s] to their places in the latest ``values``."""

    def __init__(
        self, values: NDArray[Any], places: Sequence[int], signals: Sequence[BoundSignal], step: float
    ) -> None:
        self.values, self.places = values, np.array(places, dtype=np.int64)
        self._signals, self._step = signals, step
        self._samples = np.zeros((0, len(signals)))
        self._native = _Feed()

    @property
    def address(self) -> int:
        """Of the structure that loop.c takes."""
        return addressof(self._native)

    def prepare(self, times: NDArray[np.float64]) -> None:
        """Be ready for a step from each of the ``times`` [s]."""
        self._samples = np.stack([s.sample(times + self._step, self._step) for s in self._signals], axis=1)
        self._native.samples, self._native.row = self._samples.ctypes.data, 0


Gathered = Gather | EffectGroup | Change


@dataclass(frozen=True)
class Move:
    """A connection of Strings, which have no place in an array: the loop returns to Python for it."""

    source: FmuInstance
    output: str
    target: FmuInstance
    input: str

    def carry(self, time: float) -> None:
        """From output to input.  Raises :class:`SlaveError`."""
        self.target.set({self.input: self.source.get([self.output], time)[self.output]}, time)


Operation = Gather | EffectGroup | Change | Feed | Move | Call


@dataclass(frozen=True)
class Plan:
    """The operations of a step of ``step`` [s], in their order.

    Steps that differ come in turn: each of the ``ranges`` is one of them, the first one at ``start`` [s].  ``memories``
    go from step to step, beside those of faults.
    """

    ranges: tuple[tuple[Operation, ...], ...]
    step: float
    start: float = 0.0
    memories: tuple[Stateful, ...] = ()

    def find_phase(self, time: float) -> int:
        """Which of the ranges the step from ``time`` [s] on is."""
        return round((time - self.start) / self.step) % len(self.ranges)

    @property
    def operations(self) -> list[Operation]:
        """Those of all ranges."""
        return list(chain(*self.ranges))

    @property
    def prepared(self) -> list[EffectGroup | Feed]:
        """What has to know the times of the steps before."""
        return [operation for operation in self.operations if isinstance(operation, EffectGroup | Feed)]
