"""Runs single stages of a plan, timed or not."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from time import perf_counter_ns

from ..errors import SlaveEnded
from ..faults.effects import EffectGroup
from ..last_step import is_reached, read_outputs
from ..plan import Call, Change, Gather, Plan, Stage
from ..stopwatch import Laps


def _list_calls(part: Gather | EffectGroup | Change) -> list[Callable[[], object]]:
    changes: list[Callable[[], object]] = [*part.list_changes()]
    if not isinstance(part, Gather):
        return changes
    return [partial(part.outputs.take, part.sources, None, part.inputs, "clip"), *changes]


class StageRunner:
    """The stages of a plan by their number; ``laps``: where their times go."""

    def __init__(self, plan: Plan, laps: Laps | None) -> None:
        self._plan, self._laps = plan, laps
        self._gathering = [[change for part in stage.gathers for change in _list_calls(part)] for stage in plan.stages]
        self._spans = plan.list_spans()
        self.ended: dict[str, SlaveEnded] = {}
        """By component, that it has ended the simulation at the end of this base step."""

    def begin(self, time: float) -> None:
        """The base step from ``time`` [s] on follows."""
        self.ended.clear()
        self._plan.now.value = time
        for span in self._spans:
            span.begin.value = time + span.offset

    def run(self, number: int, time: float) -> None:
        """A stage of the step from ``time`` [s] on.  Raises :class:`SlaveError`.

        An FMU that ends the simulation at the end of the step has made it, and is only read any longer.
        """
        stage = self._plan.stages[number]
        if self._laps is not None:
            self._run_timed(stage, self._laps, self._laps.firsts[number], time)
            return
        for change in self._gathering[number]:
            change()
        for move in stage.moves:
            move.carry(time)
        for part in stage.calls:
            if self.ended and self._is_over(part, time):
                continue
            if status := part.invoke():
                self._check(part, status, time)

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
            place += 1
            if self._is_over(part, time):
                continue
            before = perf_counter_ns()
            status = part.invoke()
            laps.note(place - 1, perf_counter_ns() - before, time)
            if status:
                self._check(part, status, time)

    def _check(self, part: Call, status: int, time: float) -> None:
        try:
            part.check(status, time, self._plan.step)
        except SlaveEnded as ended:
            if not is_reached(ended, time + self._plan.step, self._plan.step):
                raise
            self.ended[ended.component] = ended
            self._is_over(part, time)

    def _is_over(self, part: Call, time: float) -> bool:
        """Whether the component of a call has ended; its outputs are read then."""
        if part.instance.name not in self.ended:
            return False
        if part.later:
            read_outputs(part, time + self._plan.step)
        return True
