"""The steps of a plan, one after the other: each stores one row of outputs.

:class:`PythonLoop` says what happens; :class:`.compiled.CompiledLoop` does the same in C, from the same plan.
"""

from __future__ import annotations

from ctypes import c_int
from operator import call, length_hint
from typing import Protocol

from .compiled import CompiledLoop, is_available
from .plan import Plan
from .rows import Array, Rows


class StepLoop(Protocol):
    """Runs steps of a plan."""

    def advance(self, times: Array, interrupted: c_int) -> None:
        """Run one step from each of the ``times`` [s]; ends early, after a step, once ``interrupted`` is not zero.

        ``rows.filled`` counts the complete rows also when a :class:`SlaveError` ends the loop.
        """


def make_loop(plan: Plan, rows: Rows, compiled: bool) -> StepLoop:
    """The loop for a plan: in C if that is wanted, it can do all of it, and there is a library for this platform."""
    return (
        CompiledLoop(plan, rows)
        if compiled and not plan.needs_python and is_available()
        else PythonLoop(plan, rows)
    )


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
                [gather.convert for gather in stage.gathers if gather.convert is not None],
                stage.moves,
                tuple(c.invoke for c in stage.calls),
                stage.calls,
            )
            for stage in plan.stages
        ]

    def advance(self, times: Array, interrupted: c_int) -> None:
        """See :class:`StepLoop`."""
        plan, rows, stages = self._plan, self._rows, self._stages
        fed = [(*rows.find_place(s.port), s.sample(times + plan.step, plan.step)) for s in plan.signals]
        now, latest, done = plan.now, rows.latest_row, rows.filled
        try:
            for index, (time, row) in enumerate(
                zip(times.tolist(), rows.rows[done : done + len(times)], strict=True)
            ):
                if interrupted:
                    return
                now.value = time
                for gathers, converts, moves, functions, calls in stages:
                    for take, sources, inputs in gathers:
                        take(sources, None, inputs, "clip")  # any mode but "raise" spares a copy
                    for convert in converts:
                        convert()
                    for move in moves:
                        move.carry(time)
                    remaining = iter(functions)
                    for status in filter(None, map(call, remaining)):
                        calls[-1 - length_hint(remaining)].check(status, time, plan.step)
                for values, place, samples in fed:
                    values[place] = samples[index]
                row[:] = latest
                done += 1
        finally:
            rows.filled = done
