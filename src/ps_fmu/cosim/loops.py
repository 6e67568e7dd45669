"""The steps of a plan, one after the other: each stores one row of outputs.

:class:`PythonLoop` says what happens; :class:`.compiled.CompiledLoop` does the same in C, from the same plan.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from ctypes import c_int
from itertools import accumulate, cycle, islice
from operator import call, length_hint
from time import perf_counter_ns
from typing import Protocol, TypeVar

from .checkpoint.state import Stateful
from .compiled import CompiledLoop, is_available
from .plan import Gather, Plan, Stage
from .rows import Array, Rows
from .stopwatch import Laps, Stopwatch

Phase = TypeVar("Phase")


class StepLoop(Protocol):
    """Runs steps of a plan."""

    @property
    def plan(self) -> Plan | None:
        """What is done in each step; None where that depends on what comes out.

        Such a loop also finishes the step at whose end an FMU ends the simulation, see :mod:`.last_step`.
        """

    @property
    def memories(self) -> Sequence[Stateful]:
        """What goes from step to step beside the outputs and what faults remember, in an order that the plan fixes."""

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


def _begin_at(phases: Sequence[Phase], place: int) -> Iterator[Phase]:
    """Phases in turn, for ever, from one of them on."""
    return islice(cycle(phases), place, None)


class PythonLoop:
    """Steps of a plan, in Python.

    This loop runs ten thousand times per simulated second.  So all that can be done beforehand is in the plan, and
    the calls are made from C: ``call`` maps over them, and only a status that is not fmi2OK comes to the surface.
    """

    def __init__(self, plan: Plan, rows: Rows) -> None:
        self.plan, self._rows, self._effects = plan, rows, plan.effects
        self.memories = plan.memories
        self._spans = plan.list_spans()
        self._phases = [
            [
                (
                    [(g.outputs.take, g.sources, g.inputs) for g in stage.gathers if isinstance(g, Gather)],
                    [change for part in stage.gathers for change in part.list_changes()],
                    stage.moves,
                    tuple(c.invoke for c in stage.calls),
                    stage.calls,
                )
                for stage in stages
            ]
            for stages in plan.list_phases()
        ]

    def advance(self, times: Array, interrupted: c_int) -> None:
        """See :class:`StepLoop`."""
        plan, rows, spans = self.plan, self._rows, self._spans
        for group in self._effects:
            group.prepare(times)
        fed = [(*rows.find_place(s.port), iter(s.sample(times + plan.step, plan.step))) for s in plan.signals]
        now, latest, done = plan.now, rows.latest_row, rows.filled
        phases = _begin_at(self._phases, plan.find_phase(float(times[0])) if len(times) else 0)
        for time, row, stages in zip(times.tolist(), rows.rows[done : done + len(times)], phases, strict=False):
            if interrupted:
                return
            now.value = time
            for span in spans:
                span.begin.value = time + span.offset
            for gathers, changes, moves, functions, calls in stages:
                for take, sources, inputs in gathers:
                    take(sources, None, inputs, "clip")  # any mode but "raise" spares a copy
                for change in changes:
                    change()
                for move in moves:
                    move.carry(time)
                remaining = iter(functions)
                for status in filter(None, map(call, remaining)):
                    calls[-1 - length_hint(remaining)].check(status, time, plan.step)
            for values, place, samples in fed:
                values[place] = next(samples)
            row[:] = latest
            rows.filled += 1

    def count_rows(self) -> int:
        """See :class:`StepLoop`."""
        return self._rows.filled


class TimedPythonLoop:
    """The same steps; the clock is read after each part."""

    def __init__(self, plan: Plan, rows: Rows, laps: Laps) -> None:
        self.plan, self._rows, self._laps = plan, rows, laps
        self.memories = plan.memories
        numbered = list(zip(laps.firsts, plan.stages, strict=True))
        ends = list(accumulate(map(len, plan.list_phases())))
        self._phases = [numbered[begin:end] for begin, end in zip((0, *ends[:-1]), ends, strict=True)]
        self._spans = plan.list_spans()

    def advance(self, times: Array, interrupted: c_int) -> None:
        """See :class:`StepLoop`."""
        plan, rows, laps = self.plan, self._rows, self._laps
        for group in plan.effects:
            group.prepare(times)
        fed = [(*rows.find_place(s.port), s.sample(times + plan.step, plan.step)) for s in plan.signals]
        phases = _begin_at(self._phases, plan.find_phase(float(times[0])) if len(times) else 0)
        for index, (time, stages) in enumerate(zip(times.tolist(), phases, strict=False)):
            if interrupted:
                return
            plan.now.value = time
            for span in self._spans:
                span.begin.value = time + span.offset
            began = perf_counter_ns()
            for first, stage in stages:
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
        for place, part in enumerate(stage.gathers, first):
            part.apply()
            before = self._note(place, before, time)
        for move in stage.moves:
            move.carry(time)
        before = perf_counter_ns()
        for place, called in enumerate(stage.calls, first + len(stage.gathers)):
            status = called.invoke()
            before = self._note(place, before, time)
            if status:
                called.check(status, time, self.plan.step)

    def _note(self, place: int, before: int, time: float) -> int:
        after = perf_counter_ns()
        self._laps.note(place, after - before, time)
        return after
