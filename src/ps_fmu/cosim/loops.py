"""The steps of a plan, one after the other: each stores one row of outputs.

:class:`PythonLoop` says what happens; :class:`.compiled.CompiledLoop` does the same in C, from the same plan.
"""

from __future__ import annotations

from ctypes import c_int
from operator import call, length_hint
from time import perf_counter_ns
from typing import Protocol

from .compiled import CompiledLoop, is_available
from .plan import Call, Gather, Plan
from .rows import Array, Rows
from .stopwatch import Laps, Stopwatch


class StepLoop(Protocol):
    """Runs steps of a plan."""

    def advance(self, times: Array, interrupted: c_int) -> None:
        """Run one step from each of the ``times`` [s]; ends early, after a step, once ``interrupted`` is not zero.

        ``rows.filled`` counts the complete rows also when a :class:`SlaveError` ends the loop.
        """

    def count_rows(self) -> int:
        """Complete rows of the block now, for another thread to ask while the loop runs; rather too few than more."""


def make_loop(plan: Plan, rows: Rows, compiled: bool, stopwatch: Stopwatch | None = None) -> StepLoop:
    """The loop for a plan: in C if that is wanted and there is a library for this platform."""
    laps = None if stopwatch is None else stopwatch.begin(plan)
    if compiled and is_available():
        return CompiledLoop(plan, rows, laps)
    return PythonLoop(plan, rows) if laps is None else TimedPythonLoop(plan, rows, laps)


class PythonLoop:
    """Steps of a plan, in Python.

    This loop runs ten thousand times per simulated second.  So all that can be done beforehand is in the plan, and
    the calls are made from C: ``call`` maps over them, and only a status that is not fmi2OK comes to the surface.
    """

    def __init__(self, plan: Plan, rows: Rows) -> None:
        self._plan, self._rows = plan, rows
        self._stages = [
            (
                [(gather.outputs.take, gather.sources, gather.inputs) for gather in stage.gathers],
                tuple(c.invoke for c in stage.calls),
                stage.calls,
            )
            for stage in plan.stages
        ]

    def advance(self, times: Array, interrupted: c_int) -> None:
        """See :class:`StepLoop`."""
        plan, rows, stages = self._plan, self._rows, self._stages
        now, latest, done = plan.now, rows.latest_row, rows.filled
        for time, row in zip(times.tolist(), rows.rows[done : done + len(times)], strict=True):
            if interrupted:
                return
            now.value = time
            for gathers, functions, calls in stages:
                for take, sources, inputs in gathers:
                    take(sources, None, inputs, "clip")  # any mode but "raise" spares a copy
                remaining = iter(functions)
                for status in filter(None, map(call, remaining)):
                    calls[-1 - length_hint(remaining)].check(status, time, plan.step)
            row[:] = latest
            rows.filled += 1

    def count_rows(self) -> int:
        """See :class:`StepLoop`."""
        return self._rows.filled


class TimedPythonLoop:
    """The same steps; the clock is read after each part."""

    def __init__(self, plan: Plan, rows: Rows, laps: Laps) -> None:
        self._plan, self._rows, self._laps = plan, rows, laps

    def advance(self, times: Array, interrupted: c_int) -> None:
        """See :class:`StepLoop`."""
        plan, rows, laps = self._plan, self._rows, self._laps
        for time in times.tolist():
            if interrupted:
                return
            plan.now.value = time
            began = before = perf_counter_ns()
            for place, part in enumerate(laps.parts):
                status = _carry_out(part)
                after = perf_counter_ns()
                laps.note(place, after - before, time)
                before = after
                if status:
                    assert isinstance(part, Call)
                    part.check(status, time, plan.step)
            rows.rows[rows.filled][:] = rows.latest_row
            rows.filled += 1
            laps.note(len(laps.parts), perf_counter_ns() - began, time)
            laps.timing.steps += 1

    def count_rows(self) -> int:
        """See :class:`StepLoop`."""
        return self._rows.filled


def _carry_out(part: Call | Gather) -> int:
    """Do a part of a step; returns an fmi2Status."""
    if isinstance(part, Gather):
        part.outputs.take(part.sources, None, part.inputs, "clip")
        return 0
    return part.invoke()
