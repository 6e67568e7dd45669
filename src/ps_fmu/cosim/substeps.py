"""A step that an FMU discards is made again in smaller ones, from the states of all FMUs (FMI 2.0.4, section 4.2.2).

States are kept where a run of steps begins, some 20 times a second, and not before each step: from there the same steps
lead to the one that was discarded.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from ctypes import c_int
from dataclasses import dataclass, replace
from time import perf_counter

import numpy as np
from fmpy.model_description import ModelDescription

from .compiled import StepLoop
from .errors import DiscardedStep, SlaveEnded
from .faults.active import ActiveFaults, Memories
from .fmu_instance import FmuInstance, release_states
from .rows import Array, Rows

log = logging.getLogger("ps_fmu.cosim")

SMALLEST = 2.0**-20
"""The smallest part of a step that is tried."""
MOST_TRIES = 1000
"""So many parts of a step may be discarded: an FMU may say each time that it came almost to the end."""
KEPT_S = 0.05
"""So long may states be kept [s of wall time].  To take those of our four FMUs costs as much as 90 steps."""

_ABILITIES = {
    "canGetAndSetFMUstate": "cannot be set back to a state",
    "canHandleVariableCommunicationStepSize": "takes steps of one size only",
}


def find_obstacle(descriptions: Mapping[str, ModelDescription]) -> str | None:
    """Why no step of a system can be repeated; None if it can."""
    for name, description in descriptions.items():
        for ability, lack in _ABILITIES.items():
            if not getattr(description.coSimulation, ability):
                return f"{name} {lack} ({ability} is false)"
    return None


@dataclass(frozen=True)
class _Kept:
    """States of all FMUs at a communication point, with the outputs there and what faults remember."""

    states: dict[FmuInstance, int]
    latest: Array
    memories: Memories


class RepeatingLoop:
    """Runs whole steps in a ``loop``, and repeats in smaller ones those that an FMU discards.

    Parameters
    ----------
    instances: all FMUs
    rows: where the outputs go
    step: communication step [s]
    make_loop: makes the loop for steps of a size [s]
    obstacle: why no step can be repeated, see :func:`find_obstacle`
    faults: what they remember is set back with the FMUs
    before: the loop whose steps go on in this one: what the scheme remembers goes on, too
    """

    def __init__(
        self,
        instances: Mapping[str, FmuInstance],
        rows: Rows,
        step: float,
        make_loop: Callable[[float], StepLoop],
        obstacle: str | None,
        faults: ActiveFaults,
        before: RepeatingLoop | None = None,
    ) -> None:
        self._instances = tuple(instances.values())
        self._rows, self._step, self._make_loop = rows, step, make_loop
        self.loop = make_loop(step)
        self._obstacle, self._faults = obstacle, faults
        self.warned: set[str] = set()
        """FMUs of which the user knows that they discard steps."""
        self.is_between_steps = True
        """Whether the FMUs are where the rows end; not after an interrupted repetition."""
        if before is not None:
            self.warned |= before.warned
            for own, other in zip(self.loop.memories, before.loop.memories, strict=True):
                own.load_state(other.save_state())
        self._kept: _Kept | None = None
        self._kept_at = 0.0
        self._since: list[Array] = []  # times of the steps since then [s]
        self._replays = False

    def count_rows(self) -> int:
        """As :meth:`.compiled.StepLoop.count_rows`: none of those that are made again."""
        return 0 if self._replays else self.loop.count_rows()

    def advance(self, times: Array, interrupted: c_int) -> None:
        """As :meth:`.compiled.StepLoop.advance`; ends behind a step that was repeated."""
        rows, first = self._rows, self._rows.filled
        self._keep_now_and_then()
        try:
            self.loop.advance(times, interrupted)
        except SlaveEnded as ended:
            done = rows.filled - first
            ended.time = float(times[done]) if done < len(times) else float(times[-1]) + self._step
            raise
        except DiscardedStep as error:
            if self._obstacle is not None:
                error.args = (f"{error}\n  The step cannot be repeated in smaller ones: {self._obstacle}.",)
                raise
            done = rows.filled - first
            self._since.append(times[:done])
            self._warn(error)
            self._replay(interrupted)
            if not interrupted:
                self._divide(float(times[done]), error, interrupted)
            self.is_between_steps = rows.filled > first + done
            self.forget()
        else:
            self._since.append(times[: rows.filled - first])

    def forget(self) -> None:
        """Free the kept states: what is set now, or a new plan, is not in the steps since."""
        kept, self._kept = self._kept, None
        self._since.clear()
        if kept is not None:
            release_states(kept.states)

    def _keep_now_and_then(self) -> None:
        """Keep states unless there are some, and not old ones."""
        if self._kept is not None and perf_counter() - self._kept_at < KEPT_S:
            return
        self.forget()
        self._kept = self._keep()
        self._kept_at = perf_counter()

    def _replay(self, interrupted: c_int) -> None:
        """From the kept states make the steps since again; the rows are there already."""
        assert self._kept is not None
        self._restore(self._kept)
        self._replays = True
        try:
            with self._rows.aside():
                for times in self._since:
                    begin = 0
                    while begin < len(times) and not interrupted:
                        self._rows.filled = 0
                        self.loop.advance(times[begin:], interrupted)
                        begin += self._rows.filled
        finally:
            self._replays = False

    def _divide(self, time: float, error: DiscardedStep, interrupted: c_int) -> None:
        """Make the step from ``time`` on in parts; its row is stored."""
        rows = self._rows
        filled, end, now = rows.filled, time + self._step, time
        size, tries = _choose(error, now, self._step), MOST_TRIES
        while now < end:
            kept = self._keep()
            last = now + size >= end
            size = end - now if last else size
            loop = self._make_loop(size)
            try:
                loop.advance(np.array([now]), interrupted)
            except SlaveEnded as ended:
                if not last:
                    rows.filled = filled
                ended.time = end if rows.filled > filled else time
                raise
            except DiscardedStep as again:
                rows.filled = filled
                tries -= 1
                if size / 2.0 < SMALLEST * self._step or tries == 0:
                    again.add_note(f"It was repeated in parts, the last of {size:.3g} s.")
                    raise
                if self._obstacle is not None:
                    again.add_note(f"It cannot be repeated in smaller parts: {self._obstacle}.")
                    raise
                self._restore(kept)
                size = _choose(again, now, size)
                continue
            finally:
                release_states(kept.states)
            if rows.filled == filled:  # interrupted
                return
            now = end if last else now + size
            if not last:
                rows.filled = filled
            size = end - now

    def _warn(self, error: DiscardedStep) -> None:
        """Once for each FMU."""
        if error.component not in self.warned:
            self.warned.add(error.component)
            log.warning(
                "%s: discarded the step at t = %.9g s; this and later ones are repeated in parts",
                error.component, error.time,
            )  # fmt: skip

    def _keep(self) -> _Kept:
        kept = _Kept({}, self._rows.latest.copy(), self._faults.keep() if self._obstacle is None else [])
        for instance in self._instances if self._obstacle is None else ():
            state = instance.try_state()
            if state is None:  # it was only a precaution: the run goes on without
                self._obstacle = f"{instance.name} has refused fmi2GetFMUstate, though canGetAndSetFMUstate is true"
                release_states(kept.states)
                return replace(kept, states={})
            kept.states[instance] = state
        return kept

    def _restore(self, kept: _Kept) -> None:
        for instance, state in kept.states.items():
            instance.set_state(state)
        self._rows.latest[:] = kept.latest
        self._faults.restore(kept.memories)


def _choose(error: DiscardedStep, now: float, size: float) -> float:
    """The next size to try [s]: up to the last successful time, or half of the ``size`` that was discarded."""
    reached = error.reached
    if reached is not None and SMALLEST * size < reached - now < size * (1.0 - SMALLEST):
        return reached - now
    return size / 2.0
