"""One communication step as data: what is copied where, and which library function gets which arguments.

The plan is made once and executed by a short loop, in Python (:mod:`.loops`) or in C (:mod:`.compiled`): the index
arrays, the addresses and the constants in here are all that either needs.
"""

from __future__ import annotations

from collections.abc import Callable
from ctypes import c_double
from dataclasses import dataclass, field
from itertools import accumulate
from typing import Any, NoReturn, Protocol

import numpy as np
from numpy.typing import NDArray

from .checkpoint.state import Stateful
from .errors import SlaveEnded
from .faults.effects import EffectGroup
from .fmu_instance import FmuInstance
from .guard import End
from .signals import BoundSignal
from .structure import PortName


@dataclass(frozen=True)
class Span:
    """A time other than the step, for an fmi2DoStep: it begins ``offset`` after the step, and is ``length`` long [s].

    ``begin`` is the argument of the call, which the loop makes right.
    """

    offset: float
    length: float
    begin: c_double = field(default_factory=c_double)
    numbers: NDArray[np.float64] = field(init=False)
    """Offset and length, for the loop in C."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "numbers", np.array([self.offset, self.length]))


@dataclass(frozen=True)
class Call:
    """A library function with all its arguments, which are always the same objects.

    ``invoke()`` calls it and returns the fmi2Status; ``address`` is where it is.  ``later`` says that it reads what
    fmi2DoStep has made.  To set or get, it takes the addresses of the value references and of the first of the
    ``values``, as many of each as there are names.  ``span`` is that of an fmi2DoStep over another time than the step,
    ``orders`` are those of derivatives.
    """

    instance: FmuInstance
    function: str
    invoke: Callable[[], int]
    address: int
    names: tuple[str, ...] = ()
    references: NDArray[np.uint32] | None = None
    values: NDArray[Any] | None = None
    later: bool = False
    span: Span | None = None
    orders: NDArray[np.int32] | None = None

    def check(self, status: int, time: float, step: float) -> None:
        """Count a warning in the step from ``time`` on [s], raise :class:`SlaveError` on anything worse."""
        try:
            self.instance.check(self.function, status, self._find_time(time, step), self.names)
        except SlaveEnded as ended:
            ended.during = self
            raise

    def give_up(self, end: End, time: float, step: float) -> NoReturn:
        """Raise what a call means that did not return in the step from ``time`` on [s]."""
        self.instance.give_up(self.function, end, self._find_time(time, step))

    def _find_time(self, time: float, step: float) -> float:
        if self.span is not None:
            return time + self.span.offset
        return time + step if self.later else time


class InputExtension(Protocol):
    """What inputs do within a step, see :class:`.schemes.history.Extension`."""

    def apply(self) -> None:
        """Change the gathered inputs in place."""

    @property
    def address(self) -> int:
        """Of the same as data: ``Lines`` of lines.h."""


@dataclass(frozen=True)
class Gather:
    """``inputs[i] = outputs[sources[i]]``: what the connections carry, for one kind of numbers.

    ``convert()`` then changes the inputs in place, where some have other units or transformations.  ``extension`` says
    what inputs do within the step, where they are not held.  ``targets`` are the names of the inputs.
    """

    outputs: NDArray[Any]
    sources: NDArray[np.intp]
    inputs: NDArray[Any]
    convert: Callable[[], None] | None = None
    targets: tuple[PortName, ...] = ()
    extension: InputExtension | None = None

    @property
    def needs_python(self) -> bool:
        """Whether only the loop in Python can do it."""
        return self.convert is not None

    def apply(self) -> None:
        """Do all this."""
        self.outputs.take(self.sources, None, self.inputs, "clip")
        for change in self.list_changes():
            change()

    def list_changes(self) -> list[Callable[[], None]]:
        """What changes the inputs after they have been copied, in order."""
        changes = [] if self.convert is None else [self.convert]
        return changes if self.extension is None else [*changes, self.extension.apply]


@dataclass(frozen=True, eq=False)
class Change:
    """What else changes the gathered inputs in place.

    ``function`` of lines.h does the same with the data at ``address``; without one, only the loop in Python can do it.
    """

    apply: Callable[[], None]
    function: str = ""
    address: int = 0

    @property
    def needs_python(self) -> bool:
        """As of :attr:`Gather.needs_python`."""
        return not self.function

    def list_changes(self) -> list[Callable[[], None]]:
        """As :meth:`Gather.list_changes`."""
        return [self.apply]


@dataclass(frozen=True)
class Move:
    """A connection of Strings, which have no place in an array."""

    source: FmuInstance
    output: str
    target: FmuInstance
    input: str

    def carry(self, time: float) -> None:
        """From output to input.  Raises :class:`SlaveError`."""
        self.target.set({self.input: self.source.get([self.output], time)[self.output]}, time)


@dataclass(frozen=True)
class Stage:
    """A part of a step: first all that is gathered, with what faults do to it, and moved, then the calls in order."""

    gathers: tuple[Gather | EffectGroup | Change, ...]
    calls: tuple[Call, ...]
    moves: tuple[Move, ...] = ()


@dataclass(frozen=True)
class Plan:
    """The stages of a step.  ``now`` [s], where it begins, is an argument of every fmi2DoStep.

    Steps that differ come in turn: ``phases`` says how many stages each of them has, the first one at ``start`` [s].
    ``memories`` go from step to step, beside those of faults.
    """

    stages: tuple[Stage, ...]
    now: c_double
    step: float
    signals: tuple[BoundSignal, ...] = ()
    phases: tuple[int, ...] = ()
    start: float = 0.0
    memories: tuple[Stateful, ...] = ()

    def find_phase(self, time: float) -> int:
        """Which of the phases the step from ``time`` [s] on is."""
        return round((time - self.start) / self.step) % len(self.phases) if self.phases else 0

    def list_phases(self) -> list[tuple[Stage, ...]]:
        """The stages of each phase."""
        ends = tuple(accumulate(self.phases)) or (len(self.stages),)
        return [self.stages[begin:end] for begin, end in zip((0, *ends[:-1]), ends, strict=True)]

    def list_spans(self) -> list[Span]:
        """Those of all calls that have one."""
        calls = (call for stage in self.stages for call in stage.calls)
        return [call.span for call in calls if call.span is not None]

    @property
    def effects(self) -> list[EffectGroup]:
        """What faults do."""
        return [part for stage in self.stages for part in stage.gathers if isinstance(part, EffectGroup)]

    @property
    def needs_python(self) -> bool:
        """Whether it has what only the loop in Python can do: inputs over time, Strings, changes of other kinds."""
        parts = (part for stage in self.stages for part in stage.gathers)
        moves = any(stage.moves for stage in self.stages)
        return bool(self.signals or moves or any(part.needs_python for part in parts))
