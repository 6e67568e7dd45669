"""The steps of a plan, one after the other: each stores one row of outputs.

:class:`PythonLoop` says what happens; :class:`.compiled.CompiledLoop` does the same in C, from the same plan.
"""

from __future__ import annotations

from ctypes import c_int
from operator import call, length_hint
from time import perf_counter_ns
from typing import Protocol

from .compiled import CompiledLoop, is_available
from .plan import Plan, Stage
from .rows import Array, Rows
from .stopwatch import Laps, Stopwatch


class StepLoop(Protocol):
    """Runs steps of a plan."""

    plan: Plan

    def advance(self, times: Array, interrupted: c_int) -> None:
        """Run one step from each of the ``times`` [s]; ends early, after a step, once ``interrupted`` is not zero.

        ``rows.filled`` counts the complete rows also when a :class:`SlaveError` ends the loop.
        """

    def count_rows(self) -> int:
        """Complete rows of the block now, for another thread to ask while the loop runs; rather too few than more."""


def make_loop(plan: Plan, rows: Rows, compiled: bool, stopwatch: Stopwatch | None = None) -> StepLoop:
    """The loop for a plan: in C if that is wanted, it can do all of it, and there is a library for this platform."""
    laps = None if stopwatch is None else stopwatch.begin(plan)
    if compiled and not plan.needs_python and is_available():
        return CompiledLoop(plan, rows, laps)
    return PythonLoop(plan, rows) if laps is None else TimedPythonLoop(plan, rows, laps)


class PythonLoop:
    """Steps of a plan, in Python.

    This loop runs ten thousand times per simulated second.  So all that can be done beforehand is in the plan, and
    the calls are made from C: ``call`` maps over them, and only a status that is not fmi2OK comes to the surface.
    """

    def __init__(self, plan: Plan, rows: Rows) -> None:
        self.plan, self._rows = plan, rows
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
        plan, rows, stages = self.plan, self._rows, self._stages
        fed = [(*rows.find_place(s.port), s.sample(times + plan.step, plan.step)) for s in plan.signals]
        now, latest, done = plan.now, rows.latest_row, rows.filled
        for index, (time, row) in enumerate(zip(times.tolist(), rows.rows[done : done + len(times)], strict=True)):
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
            rows.filled += 1

    def count_rows(self) -> int:
        """See :class:`StepLoop`."""
        return self._rows.filled


class TimedPythonLoop:
    """The same steps; the clock is read after each part."""

    def __init__(self, plan: Plan, rows: Rows, laps: Laps) -> None:
        self.plan, self._rows, self._laps = plan, rows, laps

    def advance(self, times: Array, interrupted: c_int) -> None:
        """See :class:`StepLoop`."""
        plan, rows, laps = self.plan, self._rows, self._laps
        fed = [(*rows.find_place(s.port), s.sample(times + plan.step, plan.step)) for s in plan.signals]
        for index, time in enumerate(times.tolist()):
            if interrupted:
                return
            plan.now.value = time
            began = perf_counter_ns()
            for first, stage in zip(laps.firsts, plan.stages, strict=True):
                self._run_stage(stage, first, time)
            for values, place, samples in fed:
                values[place] = samples[index]
            rows.rows[rows.filled][:] = rows.latest_row
            rows.filled += 1
            laps.note(len(laps.parts), perf_counter_ns() - began, time)
            laps.timing.steps += 1

    def count_rows(self) -> int:
        """See :class:`StepLoop`."""
        return self._rows.filled

    def _run_stage(self, stage: Stage, first: int, time: float) -> None:
        """A stage of the step from ``time`` [s] on, whose parts begin at place ``first``."""
        before = perf_counter_ns()
        for place, gather in enumerate(stage.gathers, first):
            gather.outputs.take(gather.sources, None, gather.inputs, "clip")
            if gather.convert is not None:
                gather.convert()
            before = self._note(place, before, time)
        for move in stage.moves:
            move.carry(time)
        before = perf_counter_ns()
        for place, part in enumerate(stage.calls, first + len(stage.gathers)):
            status = part.invoke()
            before = self._note(place, before, time)
            if status:
                part.check(status, time, self.plan.step)

    def _note(self, place: int, before: int, time: float) -> int:
        after = perf_counter_ns()
        self._laps.note(place, after - before, time)
        return after
