"""The loop over the steps of a plan: a library in the package, in C, that carries out its operations.

It lets go of the interpreter's lock, so that two systems can run at the same time in two threads.
"""

from __future__ import annotations

from collections.abc import Sequence
from ctypes import POINTER, Structure, addressof, c_double, c_int, c_int64, c_void_p
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from .checkpoint.state import Stateful
from .clock import ends_at
from .errors import SlaveEnded
from .faults.effects import EffectGroup
from .guard import NamedCall, NamedSteps, load_library
from .plan import Call, Change, Feed, Gather, Move, Operation, Plan
from .rows import Array, Rows
from .stopwatch import Laps, Timing

BUDGET_S = 0.05
"""So long may C go on before Python looks for signals and reports progress [s]."""

# Kind of an operation, as in loop.c.
_TAKE = {"float64": 0, "int32": 1}
_DO_SPAN = 7
_CHANGE = {"float64": 10, "int32": 11}
_FEED = {"float64": 14, "int32": 15}
_ASK_PYTHON = 16
_FUNCTION = {"extend": 8, "scale": 12, "look_up": 13}
_CALL = {
    "fmi2SetReal": 2,
    "fmi2SetInteger": 3,
    "fmi2SetBoolean": 3,
    "fmi2DoStep": 4,
    "fmi2GetReal": 5,
    "fmi2GetInteger": 6,
    "fmi2GetBoolean": 6,
    "fmi2SetRealInputDerivatives": 9,
}


class _Operation(Structure):
    """``Operation`` of loop.c."""

    _fields_ = (
        ("kind", c_int64),
        ("count", c_int64),
        ("places", c_void_p),
        ("outputs", c_void_p),
        ("values", c_void_p),
        ("component", c_void_p),
        ("function", c_void_p),
    )


class _Loop(Structure):
    """``Loop`` of loop.c."""

    _fields_ = (
        ("operations", POINTER(_Operation)),
        ("n_operations", c_int64),
        ("latest", c_void_p),
        ("columns", c_int64),
        ("step", c_double),
        ("ends", c_void_p),
        ("phases", c_int64),
        ("rows_done", c_int64),
        ("next_operation", c_int64),
        ("phase", c_int64),
        ("is_led", c_int64),
    )


class StepLoop(Protocol):
    """Runs steps."""

    @property
    def memories(self) -> Sequence[Stateful]:
        """What goes from step to step beside the outputs and what faults remember, in an order that the plan fixes."""

    def advance(self, times: Array, interrupted: c_int) -> None:
        """Run one step from each of the ``times`` [s]; ends early, between two steps, once ``interrupted`` is not zero.

        It may end before that, too.  ``rows.filled`` counts the complete rows also when a :class:`SlaveError` ends it:
        with the step at whose end an FMU has ended the simulation.
        """

    def count_rows(self) -> int:
        """Complete rows of the block now, also while the loop runs; rather too few than more."""


class CompiledLoop:
    """Steps of a plan, timed if there are ``laps``.

    ``is_led``: :meth:`run_range` carries out one range of operations after the other, and stores no rows.
    """

    def __init__(self, plan: Plan, rows: Rows, laps: Laps | None = None, is_led: bool = False) -> None:
        library = load_library()
        self._run_steps = library.run_steps if laps is None else library.run_timed_steps
        types = POINTER(_Loop), c_void_p, c_void_p, c_int64, c_double, POINTER(c_int)
        self._run_steps.argtypes = types if laps is None else (*types, POINTER(Timing))
        self._run_steps.restype = c_int
        self._timing = () if laps is None else (laps.timing,)
        self._plan, self._rows, self._prepared = plan, rows, plan.prepared
        self.memories = plan.memories
        self._parts = plan.operations
        operations = (_Operation * len(self._parts))(*map(_make_operation, self._parts))
        self._ends = np.cumsum([len(own) for own in plan.ranges], dtype=np.int64)
        row = rows.latest.ctypes.data, rows.latest.size
        ends = self._ends.ctypes.data, len(self._ends)
        self._loop = _Loop(operations, len(operations), *row, plan.step, *ends, is_led=int(is_led))
        self._time, self._never = np.zeros(1), c_int()  # for ranges
        begin = addressof(self._loop)
        named = [part.describe(plan.step) if isinstance(part, Call) else ("", 0.0) for part in self._parts]
        self._names = NamedSteps(named, begin + _Loop.next_operation.offset, begin + _Loop.rows_done.offset)

    def prepare(self, times: Array) -> None:
        """Be ready for a step from each of the ``times`` [s]."""
        for operation in self._prepared:
            operation.prepare(times)

    def advance(self, times: Array, interrupted: c_int) -> None:
        """As :meth:`StepLoop.advance`; ends early after :data:`BUDGET_S`, too."""
        if not len(times):
            return
        loop, first = self._loop, self._rows.filled
        self.prepare(times)
        self._begin(self._plan.find_phase(float(times[0])))
        try:
            self._run(self._rows.block[first:], times, interrupted)
        finally:
            done, loop.rows_done = loop.rows_done, 0
            self._rows.filled = first + done

    def run_range(self, number: int, time: float) -> None:
        """The operations of one range, in a step from ``time`` [s] on.  Raises :class:`SlaveError`.

        All are carried out where an FMU has ended the simulation at the end of the step.
        """
        self._begin(number)
        self._time[0] = time
        self._run(self._rows.latest, self._time, self._never)

    def count_rows(self) -> int:
        """As :meth:`StepLoop.count_rows`."""
        return int(self._rows.filled + self._loop.rows_done)

    def _begin(self, number: int) -> None:
        loop = self._loop
        loop.rows_done, loop.phase = 0, number
        loop.next_operation = self._ends[number - 1] if number else 0

    def _run(self, rows: Array, times: Array, interrupted: c_int) -> None:
        loop, step = self._loop, self._plan.step
        goal = rows.ctypes.data, times.ctypes.data, len(times)
        named = self._names.at(times.ctypes.data)
        ended: SlaveEnded | None = None
        while status := self._run_named(named, goal, interrupted):
            part, time = self._parts[loop.next_operation - 1], float(times[loop.rows_done])
            if isinstance(part, Move):
                part.carry(time)
                continue
            assert isinstance(part, Call)
            try:
                part.check(status, time, step)
            except SlaveEnded as error:
                ended = ended or error
                if not ends_at(error, time + step, step):
                    break
                # It has made this step, which is the last one: so do the others.
                goal = *goal[:2], loop.rows_done + 1
                loop.next_operation -= part.later  # an FMU in a process of its own has not carried it out
        if ended is not None:
            raise ended

    def _run_named(self, named: NamedCall, goal: tuple[int, int, int], interrupted: c_int) -> int:
        with named:
            return int(self._run_steps(self._loop, *goal, BUDGET_S, interrupted, *self._timing))


def _make_operation(part: Operation) -> _Operation:
    """The addresses in an operation, whose objects the plan keeps."""
    if isinstance(part, Call):
        component, function = part.instance.address, part.address
        if part.span is not None:
            return _Operation(_DO_SPAN, 0, _find(part.span), None, None, component, function)
        arrays = map(_find, (part.references, part.orders, part.values))
        return _Operation(_CALL[part.function], len(part.names), *arrays, component, function)
    if isinstance(part, Gather):
        arrays = map(_find, (part.sources, part.outputs, part.inputs))
        return _Operation(_TAKE[part.inputs.dtype.name], len(part.sources), *arrays)
    if isinstance(part, Change):
        arrays = map(_find, (part.table, part.numbers, part.inputs))
        return _Operation(_FUNCTION[part.function], part.count, *arrays, part.address)
    if isinstance(part, EffectGroup):
        return _Operation(_CHANGE[part.inputs.dtype.name], part.count, None, None, _find(part.inputs), part.address)
    if isinstance(part, Feed):
        places, values = _find(part.places), _find(part.values)
        return _Operation(_FEED[part.values.dtype.name], len(part.places), places, None, values, part.address)
    return _Operation(_ASK_PYTHON)


def _find(array: NDArray[Any] | None) -> int | None:
    return None if array is None else array.ctypes.data
