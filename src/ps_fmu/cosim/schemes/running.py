"""Runs single stages of a plan, timed or not."""

from __future__ import annotations

from time import perf_counter_ns

from ..plan import Plan, Stage
from ..stopwatch import Laps


class StageRunner:
    """The stages of a plan by their number; ``laps``: where their times go."""

    def __init__(self, plan: Plan, laps: Laps | None) -> None:
        self._plan, self._laps = plan, laps
        self._spans = plan.list_spans()

    def begin(self, time: float) -> None:
        """The base step from ``time`` [s] on follows."""
        self._plan.now.value = time
        for span in self._spans:
            span.begin.value = time + span.offset

    def run(self, number: int, time: float) -> None:
        """A stage of the step from ``time`` [s] on.  Raises :class:`SlaveError`."""
        stage = self._plan.stages[number]
        if self._laps is not None:
            self._run_timed(stage, self._laps, self._laps.firsts[number], time)
            return
        for gather in stage.gathers:
            gather.apply()
        for move in stage.moves:
            move.carry(time)
        for part in stage.calls:
            if status := part.invoke():
                part.check(status, time, self._plan.step)

    def end(self, began_ns: int, time: float) -> None:
        """The base step is over, which began at ``began_ns`` of ``perf_counter_ns``."""
        if self._laps is not None:
            self._laps.note(len(self._laps.parts), perf_counter_ns() - began_ns, time)
            self._laps.timing.steps += 1

    def _run_timed(self, stage: Stage, laps: Laps, place: int, time: float) -> None:
        for gather in stage.gathers:
            before = perf_counter_ns()
            gather.apply()
            laps.note(place, perf_counter_ns() - before, time)
            place += 1
        for move in stage.moves:
            move.carry(time)
        for part in stage.calls:
            before = perf_counter_ns()
            status = part.invoke()
            laps.note(place, perf_counter_ns() - before, time)
            place += 1
            if status:
                part.check(status, time, self._plan.step)
