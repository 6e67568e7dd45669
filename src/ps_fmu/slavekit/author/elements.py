"""Elements of a step: what a model does before and after its linear map, in each step, without Python.

A model lists them in :meth:`.model.Model.before_map` and :meth:`.model.Model.after_map`.  They are done in their order,
by the compiled kernel (``elements.c`` and ``timed.c``).

An *operand* is a view of the buffer (``self.x[0:3]``, ``self.view("load")``) or places in it
(``self.places(view)[[2, 0]]``).  An element writes outputs, states, auxiliary inputs and memory.  Constants are one
number for all values, or one for each.  A step in which any number is not finite is refused, and changes nothing.
"""

from __future__ import annotations

import ctypes
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from .blocks import store_by_columns
from .buffer import Array, BufferLayout
from .core import Elements, Map
from .guard import ModelError
from .instructions import (
    DELAY_AGE,
    DELAY_NEWEST,
    DELAY_OUT,
    DELAY_RING,
    Finder,
    Instruction,
    Kind,
    Operand,
    Places,
    tell_neighbours,
)

_SPARSE = 5
"""Time of a column of a dense matrix over that of an entry of a sparse one, in the kernel."""


def ring_size(n: int, longest: int) -> int:
    """Numbers of memory for a :class:`Delay` of ``n`` values, within whose time lie at most ``longest`` steps."""
    return DELAY_RING + (n + 1) * (longest + 1)


class Element(ABC):
    """One thing that a step does beside the map."""

    @abstractmethod
    def instruct(self, find: Finder) -> Instruction:
        """The element for the kernel.  Raises ValueError, naming the field."""


@dataclass(frozen=True, eq=False)
class Sample(Element):
    """At each multiple of the period (s), from the first step on: target <- source.

    A step takes a sample time within it, or the last of several, at the start of the step; a sample time at the end of
    a step belongs to the next step.  ``clock``: one number of the memory, 0 at the start, for the part of a period
    since the last sample.
    """

    source: Operand
    target: Operand
    clock: Operand
    period: float

    def instruct(self, find: Finder) -> Instruction:
        target = find.targets("target", self.target)
        source = find.places("source", self.source, target.size)
        clock = int(find.memory("clock", self.clock, 1)[0])
        period = _time("period", self.period, True)
        return Instruction(Kind.SAMPLE, target, source, n=target.size, clock=clock, time=period)


@dataclass(frozen=True, eq=False)
class Hold(Element):
    """Sample and hold: values are taken at each multiple of the period (s) after the start, and held.

    A step with a sample time within it takes the values at its end; a sample time at the start of a step belongs to the
    last step.  ``kept``: memory for the values.  ``clock``: one number of the memory, for the part of a period since
    the last sample.  Both are 0 at the start, so the values are 0 until the end of the first period.
    """

    values: Operand
    kept: Operand
    clock: Operand
    period: float

    def instruct(self, find: Finder) -> Instruction:
        target = find.targets("values", self.values)
        kept = find.memory("kept", self.kept, target.size)
        clock = int(find.memory("clock", self.clock, 1)[0])
        period = _time("period", self.period, True)
        return Instruction(Kind.HOLD, target, second=kept, n=target.size, clock=clock, time=period)


@dataclass(frozen=True, eq=False)
class Ramp(Element):
    """rate <- (command - reference) / h, held within +-limit: the reference then reaches the command in steps of h.

    The map has to integrate the rate into the reference.
    """

    command: Operand
    reference: Operand
    rate: Operand
    limit: ArrayLike
    """Largest rate, 0 or greater, in units of the command per s; may be infinite."""

    def instruct(self, find: Finder) -> Instruction:
        target = find.targets("rate", self.rate)
        n = target.size
        limit = find.constants("limit", self.limit, n, finite=False)
        if (limit < 0.0).any():
            raise ValueError(f"limit: expected 0 or greater, got {self.limit!r}")
        command, reference = find.places("command", self.command, n), find.places("reference", self.reference, n)
        return Instruction(Kind.RAMP, target, command, reference, -limit, limit, n=n)


@dataclass(frozen=True, eq=False)
class Product(Element):
    """target[k] <- first[k] * second[k], in the order of k."""

    first: Operand
    second: Operand
    target: Operand

    def instruct(self, find: Finder) -> Instruction:
        target = find.targets("target", self.target)
        first, second = (find.places(name, getattr(self, name), target.size) for name in ("first", "second"))
        return Instruction(Kind.PRODUCT, target, first, second, n=target.size)


@dataclass(frozen=True, eq=False)
class Linear(Element):
    """target <- matrix @ source, with a matrix (targets, sources)."""

    source: Operand
    matrix: ArrayLike
    target: Operand

    def instruct(self, find: Finder) -> Instruction:
        target, source = find.targets("target", self.target), find.places("source", self.source)
        matrix = np.asarray(self.matrix, dtype=np.float64)
        if matrix.shape != (target.size, source.size):
            raise ValueError(f"matrix is of shape {matrix.shape}; expected {(target.size, source.size)}")
        if not np.isfinite(matrix).all():
            raise ValueError("matrix contains numbers that are not finite")
        entries = max(int(np.count_nonzero(matrix, axis=1).max()), 1)
        if target.size * entries <= _SPARSE * source.size:
            return _instruct_sparse(target, source, matrix, entries)
        columns = store_by_columns(matrix)
        return Instruction(Kind.LINEAR, target, source, matrix=columns, n=target.size, n_source=source.size)


@dataclass(frozen=True, eq=False)
class Clip(Element):
    """values <- values held between lower and upper; -inf and inf where there is no limit."""

    values: Operand
    lower: ArrayLike
    upper: ArrayLike
    flag: Operand | str | None = None
    """A Boolean output, by its view or its name, that becomes 1 where a limit is met; it does not become 0."""

    def instruct(self, find: Finder) -> Instruction:
        target = find.targets("values", self.values)
        low, high = _limits(find, self.lower, self.upper, target.size)
        return Instruction(Kind.CLIP, target, low=low, high=high, n=target.size, clock=find.flag("flag", self.flag))


@dataclass(frozen=True, eq=False)
class Excess(Element):
    """target <- max(source - upper, 0) + min(source - lower, 0): how far a stop is passed, 0 between the stops."""

    source: Operand
    lower: ArrayLike
    upper: ArrayLike
    target: Operand

    def instruct(self, find: Finder) -> Instruction:
        target = find.targets("target", self.target)
        source = find.places("source", self.source, target.size)
        low, high = _limits(find, self.lower, self.upper, target.size)
        return Instruction(Kind.EXCESS, target, source, low=low, high=high, n=target.size)


@dataclass(frozen=True, eq=False)
class Sine(Element):
    """target <- sin(factor * source + phase), phase in rad."""

    source: Operand
    factor: ArrayLike
    phase: ArrayLike
    target: Operand

    def instruct(self, find: Finder) -> Instruction:
        target = find.targets("target", self.target)
        source = find.places("source", self.source, target.size)
        low, high = (find.constants(name, getattr(self, name), target.size) for name in ("factor", "phase"))
        return Instruction(Kind.SINE, target, source, low=low, high=high, n=target.size)


@dataclass(frozen=True, eq=False)
class Quantise(Element):
    """values <- the nearest whole multiple of the resolution (half-way: the even multiple); resolution 0: unchanged."""

    values: Operand
    resolution: ArrayLike

    def instruct(self, find: Finder) -> Instruction:
        target = find.targets("values", self.values)
        resolution = find.constants("resolution", self.resolution, target.size)
        if (resolution < 0.0).any():
            raise ValueError(f"resolution: expected 0 or greater, got {self.resolution!r}")
        neighbours = tell_neighbours(target) if resolution.all() else 0
        return Instruction(Kind.QUANTISE, target, low=resolution, n=target.size, n_source=neighbours)


@dataclass(frozen=True, eq=False)
class Delay(Element):
    """values <- the newest values that are at least ``delay`` (s) old; values before the start are 0.

    A step's values are those at its end.  With ``sampled`` they came with that element's last sample, or at the start
    of a step without one: behind a :class:`Sample` the step is a part of the delay.  ``ring`` is memory of
    :func:`ring_size` (n, longest), 0 at the start; see also :func:`put_before_start`.  If more than ``longest`` steps
    lie within the delay, a step is refused.
    """

    values: Operand
    ring: Operand
    delay: float
    sampled: Sample | Hold | None = None

    def instruct(self, find: Finder) -> Instruction:
        target = find.targets("values", self.values)
        n = target.size
        ring = find.places("ring", self.ring)
        rows = (ring.size - DELAY_RING) // (n + 1)
        if rows < 2 or ring.size != ring_size(n, rows - 1) or (np.diff(ring) != 1).any():
            raise ValueError(f"ring has {ring.size} numbers; expected ring_size({n}, longest), side by side")
        ring = find.memory("ring", ring, ring.size)
        for place in ring[[DELAY_NEWEST, DELAY_OUT]].tolist():
            if find.value(place) not in range(rows):
                kept = f"{find.value(place):g}; expected 0 to {rows - 1}"
                raise ModelError(f"delay of {n} values: it keeps the row {kept}")
        found = Instruction(
            Kind.DELAY, target, n=n, n_source=rows, clock=int(ring[0]), time=_time("delay", self.delay, False)
        )
        if self.sampled is None:
            return found
        # Where the clock is 0, a sample is due at the start of the next step, or has been held at the end of this one.
        since = np.array([1.0 if isinstance(self.sampled, Sample) else 0.0])
        clock, period = find.places("sampled", self.sampled.clock, 1), find.constants("sampled", self.sampled.period, 1)
        return replace(found, source=clock, low=since, high=period)


def put_before_start(ring: Array, values: Array) -> None:
    """Have the :class:`Delay` with this new ring put out these values as those before the start."""
    ring[DELAY_RING + 1 : DELAY_RING + 1 + values.size] = values


@dataclass(frozen=True, eq=False)
class Watch(Element):
    """Make ``event`` due when a value is further than ``distance`` from ``centre``.

    Before the map the event is due before this step; after the map it is due before the next step.  With ``last``,
    memory for the values, it is also due when the values stop changing at more than ``least`` from the centre.
    """

    values: Operand
    centre: Operand
    distance: ArrayLike
    last: Operand | None = None
    least: ArrayLike = 0.0

    def instruct(self, find: Finder) -> Instruction:
        source = find.places("values", self.values)
        n = source.size
        centre = find.places("centre", self.centre, n)
        high = find.constants("distance", self.distance, n, finite=False)
        low = find.constants("least", self.least, n, finite=False)
        last = None if self.last is None else find.memory("last", self.last, n)
        return Instruction(Kind.WATCH, last, source, centre, low, high, n=n, n_source=tell_neighbours(source, centre))


@dataclass(frozen=True, eq=False)
class Count(Element):
    """target <- number of times that |values| rose above ``above`` since the start, per value or in total.

    ``kept``: memory for 2 n numbers, 0 at the start: for each value whether it is above, and how often it rose.
    """

    values: Operand
    above: ArrayLike
    kept: Operand
    target: Operand
    """As many as values, or one for the sum."""

    def instruct(self, find: Finder) -> Instruction:
        source = find.places("values", self.values)
        n = source.size
        target = find.targets("target", self.target)
        if target.size not in (1, n):
            raise ValueError(f"target has {target.size} numbers; expected 1 or {n}")
        high = find.constants("above", self.above, n, finite=False)
        kept = find.memory("kept", self.kept, 2 * n)
        return Instruction(Kind.COUNT, target, source, kept, high=high, n=n, n_source=target.size)


@dataclass(frozen=True, eq=False)
class Call(Element):
    """A compiled function, see ``Function`` in ``native/kernel/core.h``: it reads the buffer and writes ``target``.

    It may refuse the step, or complete it: neither the map nor further elements follow then.  What changes from step to
    step lies in the buffer, among the targets: so the kernel undoes it, and the FMU state contains it.
    """

    function: int
    """Its address, for example ``ctypes.cast(library.name, ctypes.c_void_p).value``."""
    arguments: ctypes.Structure
    """Constants, places, and caches: functions of constants and of the buffer, with their keys beside them."""
    target: Operand | None = None
    """All places of the buffer that the function writes; None: caches alone."""
    kept: object = None
    """What ``arguments`` point to; it lives as long as the element."""

    def instruct(self, find: Finder) -> Instruction:
        if not (isinstance(self.function, int) and self.function):
            raise ValueError(f"function: expected the address of a compiled function, got {self.function!r}")
        if not isinstance(self.arguments, ctypes.Structure):
            raise ValueError(f"arguments: expected a ctypes.Structure, got a {type(self.arguments).__name__}")
        target = None if self.target is None else find.targets("target", self.target)
        self.arguments.kept = self.kept
        n = 0 if target is None else target.size
        return Instruction(Kind.CALL, target, n=n, function=self.function, arguments=self.arguments)


def _instruct_sparse(target: Places, source: Places, matrix: Array, entries: int) -> Instruction:
    """As many ``entries`` of each row, in their order: all that are not zero, and the first of the others."""
    columns = np.sort(np.argsort(matrix == 0.0, axis=1, kind="stable")[:, :entries], axis=1)
    factors = np.take_along_axis(matrix, columns, axis=1).copy()
    return Instruction(Kind.SPARSE, target, source[columns].ravel(), matrix=factors, n=target.size, n_source=entries)


def _time(what: str, value: float, above: bool) -> float:
    """s."""
    time = float(value)
    if not (0.0 < time < np.inf or (time == 0.0 and not above)):
        raise ValueError(f"{what}: expected a finite time {'above 0' if above else 'of 0 or more'} s, got {value!r}")
    return time


def _limits(find: Finder, lower: ArrayLike, upper: ArrayLike, n: int) -> tuple[Array, Array]:
    low, high = find.constants("lower", lower, n, finite=False), find.constants("upper", upper, n, finite=False)
    if not (low <= high).all():
        raise ValueError(f"lower = {lower!r} and upper = {upper!r}: expected lower <= upper")
    return low, high

# --- Lists of elements, checked and compiled --------------------------------------------------------------------------


class StepMap(NamedTuple):
    """What a model says of steps of one size."""

    step: float
    """s."""
    maps: tuple[Map, ...]
    """One after the other."""
    elements: Elements


def compile_elements(
    layout: BufferLayout, data: Array, before: Sequence[Element], after: Sequence[Element]
) -> Elements:
    """The elements before and after the map as the kernel reads them.

    Raises
    ------
    ValueError: an element is wrong; the text names model, element and field.
    ModelError: what an element keeps in memory is impossible.
    """
    find = Finder(layout, data)
    return Elements(*(_compile(f"{layout.model}.{name}", elements, find) for name, elements in (
        ("before_map", before), ("after_map", after),
    )))  # fmt: skip


def _compile(where: str, elements: Sequence[Element], find: Finder) -> list[Instruction]:
    compiled = []
    for element in elements:
        if not isinstance(element, Element):
            raise TypeError(f"{where} contains a {type(element).__name__}; expected elements")
        try:
            compiled.append(element.instruct(find))
        except ModelError:
            raise
        except ValueError as error:
            raise ValueError(f"{where}: {type(element).__name__}.{error}") from None
    return compiled


def find_full_delay(elements: Elements, data: Array, step: float) -> str:
    """What to say of a delay that cannot keep another step of ``step`` (s); empty: all can."""
    for e in elements.every:
        if e.kind == Kind.DELAY:
            newest, out = (int(data[e.clock + kept]) for kept in (DELAY_NEWEST, DELAY_OUT))
            gap = data[e.clock + DELAY_RING + (out + 1) % e.n_source * (e.n + 1)]
            is_late = data[e.clock + DELAY_AGE] + step - gap >= e.time - 1e-6 * step - 1e-9 * e.time
            if (newest + 1) % e.n_source == out and not is_late:
                return f"more than {e.n_source - 1} steps lie within a delay of {e.time:g} s, which keeps no more"
    return ""
