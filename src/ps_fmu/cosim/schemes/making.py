"""The loop that runs the steps of a scheme."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from ctypes import c_int
from functools import partial

import numpy as np

from ..checkpoint.state import State, Stateful, copy_into
from ..compiled import CompiledLoop, StepLoop
from ..errors import SlaveEnded
from ..fmu_instance import FmuInstance, keep_states, release_states
from ..rows import Array, Rows
from ..stopwatch import Stopwatch
from ..substeps import RepeatingLoop
from ..wires import Assembly, Wires, find_fed
from .history import InputHistory
from .loop_iteration import IteratedLoop
from .planning import make_plan
from .resolving import explain_no_repeat


class EstimatingLoop:
    """Runs steps as :class:`..compiled.StepLoop` says.

    Parameters
    ----------
    parts: of the run
    step: communication step [s]
    whole, half: loops for steps of two sizes, each with the histories of its inputs
    """

    def __init__(
        self,
        parts: Assembly,
        step: float,
        whole: tuple[StepLoop, Sequence[InputHistory]],
        half: tuple[StepLoop, Sequence[InputHistory]],
    ) -> None:
        rows, instances, order = parts.rows, parts.instances, parts.scheme.error_order
        self._whole, self._half = whole, half
        self._instances = tuple(instances.values())
        self._rows, self._step, self._faults = rows, step, parts.faults
        self._factor = 2.0**order / (2.0**order - 1.0)
        self._largest = np.abs(rows.real.values)
        self.memories: list[Stateful] = [*whole[0].memories, *half[0].memories, self]
        self._columns = [
            (rows.real.places[column.port], _list_places(instances[column.members[0]], rows))
            for column in parts.run_columns.own
            if column.kind == "error_estimate"
        ]

    def save_state(self) -> dict[str, State]:
        """The largest values so far, which errors are relative to."""
        return {"largest": self._largest.copy()}

    def load_state(self, state: Mapping[str, State]) -> None:
        """Take over the largest values of the same columns.  Raises ValueError or KeyError: no such."""
        copy_into(self._largest, state["largest"])

    def count_rows(self) -> int:
        """See :class:`..compiled.StepLoop`."""
        return self._rows.filled

    def advance(self, times: Array, interrupted: c_int) -> None:
        """See :class:`..compiled.StepLoop`."""
        for time in times.tolist():
            if not self._step_twice(time, interrupted):
                return

    def _step_twice(self, time: float, interrupted: c_int) -> bool:
        """False if it was interrupted: nothing has been done then."""
        rows = self._rows
        filled, before = rows.filled, rows.latest.copy()
        states, memories = keep_states(self._instances), self._faults.keep()
        try:
            for own, other in zip(self._half[1], self._whole[1], strict=True):
                own.copy_from(other)
            refined = self._make_halves(time, interrupted)
            for instance, state in states.items():
                instance.set_state(state)
            rows.latest[:] = before
            self._faults.restore(memories)
        finally:
            rows.filled = filled
            release_states(states)
        if refined is None:
            return False
        try:
            return _make_step(self._whole[0], rows, time, interrupted)
        finally:
            if rows.filled > filled:  # also where an FMU has ended the simulation with this step
                self._store(refined)

    def _make_halves(self, time: float, interrupted: c_int) -> Array | None:
        """The outputs behind them; None if they were interrupted."""
        rows, loop = self._rows, self._half[0]
        filled, middle = rows.filled, time + 0.5 * self._step
        for begin in (time, middle):
            rows.filled = filled
            try:
                if not _make_step(loop, rows, begin, interrupted):
                    return None
            except SlaveEnded:  # the whole step says so again
                if begin == time or rows.filled == filled:
                    raise
        return rows.real.values.copy()

    def _store(self, refined: Array) -> None:
        rows = self._rows
        found = rows.real.values
        np.fmax(self._largest, np.fmax(np.abs(found), np.abs(refined)), out=self._largest)
        scale = np.where(self._largest > 0.0, self._largest, 1.0)
        errors = self._factor * np.abs(refined - found) / scale
        for place, own in self._columns:
            found[place] = rows.block[rows.filled - 1, place] = errors[own].max(initial=0.0)


def _make_step(loop: StepLoop, rows: Rows, time: float, interrupted: c_int) -> bool:
    """One step, and its row.  False if it was interrupted."""
    filled = rows.filled
    while rows.filled == filled:  # a loop may return before its time
        if interrupted:
            return False
        loop.advance(np.array([time]), interrupted)
    return True


def _list_places(instance: FmuInstance, rows: Rows) -> np.ndarray[tuple[int], np.dtype[np.intp]]:
    """Places of the continuous outputs of a component."""
    ports = [
        port
        for port in rows.real.places
        if port.component == instance.name
        and instance.variables[port.variable].causality == "output"
        and instance.variables[port.variable].variability in (None, "continuous")
    ]
    return np.array([rows.real.places[port] for port in ports], dtype=np.intp)


def plan_steps(parts: Assembly, before: RepeatingLoop | None = None) -> None:
    """Make the loop for what is connected, set and faulty now.

    ``before``: the loop whose steps go on in this one.  Raises :class:`SlaveError`.
    """
    parts.faults.settle(parts.instances, find_fed(parts, parts.values_set.keys()))
    obstacle = explain_no_repeat(parts.scheme, parts.descriptions)
    make = partial(make_loop, parts)
    parts.loop = RepeatingLoop(parts.instances, parts.rows, parts.clock.step, make, obstacle, parts.faults, before)


def make_loop(parts: Assembly, step: float) -> StepLoop:
    """The loop for steps of a size [s]; the stopwatch, if there is one, times whole steps alone."""
    whole = _make_single(parts, step, parts.stopwatch if step == parts.clock.step else None)
    if not parts.scheme.error_estimate:
        return whole[0]
    return EstimatingLoop(parts, step, whole, _make_single(parts, 0.5 * step, None))


def _make_single(
    parts: Assembly, step: float, stopwatch: Stopwatch | None
) -> tuple[StepLoop, Sequence[InputHistory]]:
    """A loop that makes each step once, and the histories of its inputs."""
    wires = Wires(parts, step)
    if parts.scheme.is_iterated:
        loop = IteratedLoop(wires, stopwatch)
        return loop, loop.histories
    plan, histories = make_plan(wires)
    return CompiledLoop(plan, parts.rows, None if stopwatch is None else stopwatch.begin(plan)), histories
