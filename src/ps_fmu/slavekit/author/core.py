"""The words of one instance that Python and C share: what a plain step is, and when the next one is plain.

Each of these facts is kept here alone, whoever makes the steps: both read it here and write it here.  The launcher
learns the address when the instance is made (``Values.get_string``); what the words mean is in
``native/kernel/core.h``.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Sequence
from ctypes import PYFUNCTYPE, c_bool, c_char, c_char_p, c_double, c_int64, c_uint64, c_void_p
from dataclasses import dataclass
from math import inf
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...numerics.library import find_library
from .blocks import MapWords, Matrices, Matrix
from .buffer import Array, BufferLayout, allocate_aligned
from .instructions import Instruction, Kind, find_address, find_spans, write_words

REFERENCE, LINEAR_REFERENCE = 2**31 - 1, 2**31 - 2
"""Value references of Strings that no description lists: the address of the core; nothing, and the linear model in the
core is renewed."""


@dataclass(frozen=True, eq=False)
class OutputLimits:
    """Between which a step holds its first results."""

    lower: Array
    upper: Array
    flag: int
    """The place that becomes 1 if a limit is met; -1: none."""


class Elements:
    """The elements of a step, in their order, for :meth:`Core.use_elements`."""

    def __init__(self, before: Sequence[Instruction] = (), after: Sequence[Instruction] = ()) -> None:
        self.before, self.after = tuple(before), tuple(after)
        self.every = (*self.before, *self.after)
        self.words = write_words(self.before), write_words(self.after)


_MAGIC = 0x30312D65726F63  # "core-10"
NOTHING, MAP = range(2)
FOUND_DUE = 2
"""Value of ``pending`` if an element has found, before the map, that an event is due before this step."""

MESSAGE_NONE, MESSAGE_WARNING, MESSAGE_REFUSAL = 0, 1, 3
"""Values of ``message_status``."""

_MOST_MAPS = 2
_STEP = PYFUNCTYPE(c_bool, c_char_p, c_void_p)  # keeps Python's lock: to give it up takes as long as a step

Step = Callable[[], bool]
"""Makes a plain step.  False, and nothing in the buffer has changed: a number is not finite, of the
result, in ``work``, or of an element; or an element has found that an event is due before the step: FOUND_DUE."""


@dataclass(frozen=True, eq=False)
class Map:
    """``target <- matrix @ source``; both are views of the buffer."""

    matrix: Matrix
    source: Array
    target: Array
    work: Array
    """Where the result comes to first, padded."""

    @classmethod
    def make(cls, matrix: Matrix, source: Array, target: Array) -> Map:
        """With the operands that there are columns for, from the first one of ``source`` on."""
        n, stride = matrix.by_columns.shape
        return cls(matrix, source[:n], target, allocate_aligned(stride))

    def write_words(self) -> MapWords:
        """For the kernel; the arrays have to be kept as long."""
        matrix = self.matrix
        source, target, work = (find_address(array) for array in (self.source, self.target, self.work))
        parts = [find_address(array) for array in (matrix.blocks, matrix.columns, matrix.numbers)]
        return MapWords(source, target, work, self.target.size, len(matrix.blocks), *parts)


class Core(ctypes.Structure):
    """The structure of the same name in ``native/kernel/core.h``, and the arrays that it points to.

    Made by :func:`make_core`.  An array is exchanged by a method, which keeps the new one alive.
    """

    _fields_ = (
        ("magic", c_uint64), ("size", c_uint64),
        ("data", c_void_p), ("kinds", c_void_p), ("low", c_void_p), ("high", c_void_p), ("n_references", c_int64),
        ("plain", c_int64), ("target", c_void_p), ("n_target", c_int64), ("map_words", MapWords * _MOST_MAPS),
        ("n_maps", c_int64),
        ("before", c_void_p), ("after", c_void_p), ("n_before", c_int64), ("n_after", c_int64),
        ("spans", c_void_p), ("n_spans", c_int64), ("kept_spans", c_void_p), ("kept_values", c_void_p),
        ("scratch", c_void_p),
        ("lower", c_void_p), ("upper", c_void_p), ("n_limited", c_int64), ("limit_flag", c_int64),
        ("stepping", c_int64), ("pending", c_int64), ("watching", c_int64),
        ("time", c_double), ("step", c_double),
        ("time_slack", c_double), ("step_slack", c_double), ("last_start", c_double),
        ("count", c_int64),
        ("native_steps", c_int64), ("python_steps", c_int64),
        ("any_step", c_int64), ("origin", c_double), ("stop", c_double),
        ("message_status", c_int64), ("message", c_char * 512), ("label", c_char_p),
        ("linear", c_void_p), ("linear_holds", c_int64),
        *((name, c_int64) for name in ("n_rates", "first_rate", "n_outputs", "first_input", "n_inputs")),
    )  # fmt: skip

    arrays: dict[str, NDArray[Any]]
    """By the name of their word."""
    source: Array
    """States, inputs and auxiliary inputs."""
    elements: Elements
    maps: tuple[Map, ...] = ()

    def make_step(self) -> Step:
        """Plain steps as the words say at each of them, by the compiled kernel.  Raises NotCompiledError."""
        kernel, address = _STEP(("ps_fmu_step_by", find_library())), ctypes.addressof(self)
        return lambda: kernel(b"", address)

    def use_maps(self, *maps: Map) -> None:
        """A plain step is these maps, one after the other: each reads what those before it have written."""
        if self.maps != maps:
            self.maps = maps
            for place, found in enumerate(maps):
                self.map_words[place] = found.write_words()
            self.n_maps = len(maps)
        self.plain = MAP

    def use_elements(self, elements: Elements) -> None:
        """What is done before and after the map."""
        self.elements = elements
        self.n_before, self.n_after = len(elements.before), len(elements.after)
        self.before, self.after = (ctypes.addressof(words) for words in elements.words)
        self._point(scratch=allocate_aligned(max((element.count_scratch() for element in elements.every), default=0)))
        self._make_room_to_undo()

    def use_nothing(self) -> None:
        """No step is a plain one."""
        self.plain = NOTHING

    def use_linear(self, matrices: Matrices, holds: bool) -> None:
        """The linear model for directional derivatives; ``holds``: whatever the state is, until ``remap``."""
        A, B, C, D = matrices
        by_columns = np.vstack([np.hstack([A, B]), np.hstack([C, D])]).T
        self._point(linear=np.ascontiguousarray(by_columns, dtype=np.float64))
        self.linear_holds = holds

    def use_limits(self, limits: OutputLimits | None) -> None:
        """The result of a plain step is held within these."""
        self.n_limited = 0
        if limits is not None:
            self._point(lower=limits.lower, upper=limits.upper)
            self.n_limited, self.limit_flag = limits.lower.size, limits.flag

    def _make_room_to_undo(self) -> None:
        """For what the elements write, known beforehand, the results, and a row of each ring."""
        first, target = (find_address(self.arrays[name]) or 0 for name in ("data", "target"))
        kept_as_target = range((target - first) // 8, (target - first) // 8 + self.n_target if self.n_after else 0)
        written = {place for element in self.elements.every for place in element.list_writes()}
        spans = find_spans([place for place in written if place not in kept_as_target])
        rings = [element.n + 1 for element in self.elements.every if element.kind == Kind.DELAY]
        room = np.zeros((len(spans) + len(rings) + 1, 2), dtype=np.int64)
        self._point(spans=spans, kept_spans=room)
        self._point(kept_values=np.zeros(int(spans[:, 1].sum()) + sum(rings) + self.n_target))
        self.n_spans = len(spans)

    def _point(self, **arrays: NDArray[Any]) -> None:
        self.arrays |= arrays
        for name, array in arrays.items():
            setattr(self, name, find_address(array))


def make_core(layout: BufferLayout, data: Array) -> Core:
    """The core of an instance with the buffer ``data``; no step is a plain one yet."""
    # Whole cache lines: another thread steps the next instance.
    memory = allocate_aligned(-(-ctypes.sizeof(Core) // 64) * 8)
    core = Core.from_buffer(memory.data)
    core.magic, core.size = _MAGIC, ctypes.sizeof(Core)
    source, target = data[layout.source], data[layout.target]
    core.n_references, core.n_target = data.size, target.size
    core.step_slack, core.stop = -1.0, inf
    core.n_rates, core.first_rate = len(layout.rates), layout.first_rate
    core.n_outputs, core.first_input = layout.y.stop, layout.u.start
    core.n_inputs = layout.u.stop - layout.u.start
    core.watching = 1
    core.arrays, core.source = {}, source
    core._point(
        data=data, kinds=layout.kinds, low=layout.low, high=layout.high,
        target=target,
    )  # fmt: skip
    core.use_elements(Elements())
    return core
