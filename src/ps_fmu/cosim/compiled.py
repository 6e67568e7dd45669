"""The same steps as in :mod:`.loops`, in C: a library in the package that executes the same plan.

It lets go of the interpreter's lock, so that two systems can run at the same time in two threads.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from ctypes import POINTER, Structure, c_double, c_int, c_int64, c_void_p
from functools import partial

import numpy as np

from .faults.effects import EffectGroup
from .guard import End, load_library
from .plan import Call, Change, Gather, InputExtension, Plan
from .rows import Array, Rows
from .stopwatch import Laps, Timing, list_parts

log = logging.getLogger("ps_fmu.cosim")

BUDGET_S = 0.05
"""So long may C go on before Python looks for signals and reports progress [s]."""

# Kind of an operation, as in loop.c.
_TAKE = {"float64": 0, "int32": 1}
_DO_SPAN, _TAKE_LINES = 7, 8
_CHANGE = {"float64": 10, "int32": 11}
_LINES = {"start_lines": 12, "change_lines": 13, "end_lines": 14}
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
    )


class CompiledLoop:
    """Steps of a plan, in C, timed if there are ``laps``.

    Raises OSError if there is no library for this platform, or none that can be loaded.
    """

    def __init__(self, plan: Plan, rows: Rows, laps: Laps | None = None) -> None:
        self._run_steps = load_library().run_guarded
        types = POINTER(_Loop), c_void_p, c_void_p, c_int64, c_double, POINTER(c_int), POINTER(Timing), POINTER(End)
        self._run_steps.argtypes, self._run_steps.restype = types, c_int
        self._timing, self._end = None if laps is None else laps.timing, End()
        self.plan, self._rows, self._effects = plan, rows, plan.effects
        self.memories = plan.memories
        self._parts = list(list_parts(plan))
        operations = (_Operation * len(self._parts))(*map(_make_operation, self._parts))
        sizes = [sum(len(s.gathers) + len(s.calls) for s in stages) for stages in plan.list_phases()]
        self._ends = np.cumsum(sizes, dtype=np.int64)
        row = rows.latest.ctypes.data, rows.latest.size
        ends = self._ends.ctypes.data, len(self._ends)
        self._loop = _Loop(operations, len(operations), *row, plan.step, *ends)

    def advance(self, times: Array, interrupted: c_int) -> None:
        """As :meth:`.loops.PythonLoop.advance`; ends early after :data:`BUDGET_S`, too."""
        loop, first = self._loop, self._rows.filled
        for group in self._effects:
            group.prepare(times)
        loop.rows_done = 0
        loop.phase = phase = self.plan.find_phase(float(times[0])) if len(times) else 0
        loop.next_operation = self._ends[phase - 1] if phase else 0
        goal = self._rows.block[first:].ctypes.data, times.ctypes.data, len(times)
        end = self._end
        try:
            while status := self._run_steps(loop, *goal, BUDGET_S, interrupted, self._timing, end):
                call, time = self._parts[loop.next_operation - 1], float(times[loop.rows_done])
                assert isinstance(call, Call)
                if end.ending:
                    call.give_up(end, time, self.plan.step)
                call.check(status, time, self.plan.step)
        finally:
            done, loop.rows_done = loop.rows_done, 0  # whoever counts rows meanwhile counts too few
            self._rows.filled = first + done

    def count_rows(self) -> int:
        """As :meth:`.loops.StepLoop.count_rows`."""
        return int(self._rows.filled + self._loop.rows_done)


class CompiledExtension:
    """What an extension of inputs does, in C, for steps that Python leads: 0.6 us instead of 16.

    Parameters
    ----------
    extension: the same in Python, which keeps the data
    now: where the base step begins [s]
    """

    def __init__(self, extension: InputExtension, now: c_double) -> None:
        self._extension = extension
        function = load_library().extend_inputs
        function.argtypes, function.restype = (c_void_p, c_double), None
        self.address = extension.address
        self.apply: Callable[[], None] = partial(function, self.address, now)


def is_available() -> bool:
    """Whether the loop can be run here."""
    try:
        load_library()
    except OSError as error:
        log.info("steps are run in Python: %s", error)
        return False
    return True


def _make_operation(part: Gather | EffectGroup | Change | Call) -> _Operation:
    """The addresses in a gather, in what faults do or in a call, whose objects the plan keeps."""
    if isinstance(part, Change):
        return _Operation(_LINES[part.function], 0, None, None, None, part.address)
    if isinstance(part, EffectGroup):
        kind = _LINES["change_lines"] if part.has_lines else _CHANGE[part.inputs.dtype.name]
        return _Operation(kind, part.count, None, None, part.inputs.ctypes.data, part.address)
    if isinstance(part, Gather):
        arrays = part.sources.ctypes.data, part.outputs.ctypes.data, part.inputs.ctypes.data
        if part.extension is not None:
            return _Operation(_TAKE_LINES, len(part.sources), *arrays, part.extension.address)
        return _Operation(_TAKE[part.inputs.dtype.name], len(part.sources), *arrays)
    arrays_of = part.references, part.orders, part.values
    references, orders, values = (None if array is None else array.ctypes.data for array in arrays_of)
    if part.span is not None:
        span = part.span.numbers.ctypes.data
        return _Operation(_DO_SPAN, 0, span, None, None, part.instance.address, part.address)
    kind = _CALL[part.function]
    return _Operation(kind, len(part.names), references, orders, values, part.instance.address, part.address)
