"""A step that an FMU discards is made again in smaller ones, from the states of all FMUs (FMI 2.0.4, section 4.2.2).

States are kept where a run of steps begins, some 20 times a second, and not before each step: from there the same steps
lead to the one that was discarded.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from ctypes import c_int
from dataclasses import dataclass, replace

import numpy as np
from fmpy.model_description import ModelDescription

from .errors import DiscardedStep, SlaveEnded, SlaveError
from .fmu_instance import FmuInstance
from .loops import StepLoop
from .rows import Array, Rows

log = logging.getLogger("ps_fmu.cosim")

SMALLEST = 2.0**-20
"""The smallest part of a step that is tried."""

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
    """States of all FMUs at a communication point, with the outputs there."""

    states: dict[FmuInstance, int]
    latest: Array


class RepeatingLoop:
    """Runs whole steps in a ``loop``, and repeats in smaller ones those that an FMU discards.

    Parameters
    ----------
    instances: all FMUs
    rows: where the outputs go
    step: communication step [s]
    make_loop: makes the loop for steps of a size [s]
    obstacle: why no step can be repeated, see :func:`find_obstacle`
    """

    def __init__(
        self,
        instances: Mapping[str, FmuInstance],
        rows: Rows,
        step: float,
        make_loop: Callable[[float], StepLoop],
        obstacle: str | None,
    ) -> None:
        self._instances = tuple(instances.values())
        self._rows, self._step, self._make_loop = rows, step, make_loop
        self.loop = make_loop(step)
        self._obstacle = obstacle
        self._warned: set[str] = set()
        self._whole: int | None = None  # rows before a step that is made in parts

    def count_rows(self) -> int:
        """As :meth:`.loops.StepLoop.count_rows`: without those of parts of a step."""
        return self.loop.count_rows() if self._whole is None else self._whole

    def advance(self, times: Array, interrupted: c_int) -> None:
        """As :meth:`.loops.StepLoop.advance`; ends behind a step that was repeated."""
        rows, loop = self._rows, self.loop
        first, kept = rows.filled, self._keep()
        try:
            loop.advance(times, interrupted)
        except SlaveEnded:
            raise
        except DiscardedStep as error:
            if self._obstacle is not None:
                error.args = (f"{error}\n  The step cannot be repeated in smaller ones: {self._obstacle}.",)
                raise
            done = rows.filled - first
            self._warn(error)
            self._restore(kept)
            rows.go_back(first)
            while rows.filled < first + done and not interrupted:
                loop.advance(times[rows.filled - first : done], interrupted)
            if not interrupted:
                self._show_only(rows.filled)
                try:
                    self._divide(float(times[done]), error, interrupted)
                finally:
                    self._show_only(None)
        finally:
            self._release(kept)

    def _divide(self, time: float, error: DiscardedStep, interrupted: c_int) -> None:
        """Make the step from ``time`` on in parts; its row is stored."""
        rows = self._rows
        filled, end, now = rows.filled, time + self._step, time
        size = _choose(error, now, self._step)
        while now < end:
            kept = self._keep()
            last = now + size >= end
            size = end - now if last else size
            try:
                self._make_loop(size).advance(np.array([now]), interrupted)
            except SlaveEnded:
                rows.go_back(filled)
                raise
            except DiscardedStep as again:
                rows.go_back(filled)
                if size / 2.0 < SMALLEST * self._step:
                    again.add_note(f"It was repeated in parts, the last of {size:.3g} s.")
                    raise
                self._restore(kept)
                size = _choose(again, now, size)
                continue
            finally:
                self._release(kept)
            if rows.filled == filled:  # interrupted
                return
            now = end if last else now + size
            if not last:
                rows.go_back(filled)
            size = end - now

    def _show_only(self, count: int | None) -> None:
        """What another thread counts from now on; None: all complete rows."""
        with self._rows.lock:
            self._whole = count

    def _warn(self, error: DiscardedStep) -> None:
        """Once for each FMU."""
        if error.component not in self._warned:
            self._warned.add(error.component)
            log.warning(
                "%s: discarded the step at t = %.9g s; this and later ones are repeated in parts",
                error.component, error.time,
            )  # fmt: skip

    def _keep(self) -> _Kept:
        kept = _Kept({}, self._rows.latest.copy())
        for instance in self._instances if self._obstacle is None else ():
            state = instance.try_state()
            if state is None:  # it was only a precaution: the run goes on without
                self._obstacle = f"{instance.name} has refused fmi2GetFMUstate, though canGetAndSetFMUstate is true"
                self._release(kept)
                return replace(kept, states={})
            kept.states[instance] = state
        return kept

    def _restore(self, kept: _Kept) -> None:
        for instance, state in kept.states.items():
            instance.set_state(state)
        self._rows.latest[:] = kept.latest

    @staticmethod
    def _release(kept: _Kept) -> None:
        for instance, state in kept.states.items():
            try:
                instance.free_state(state)
            except SlaveError as error:  # after another failure, which says more
                log.warning("%s", error)


def _choose(error: DiscardedStep, now: float, size: float) -> float:
    """The next size to try [s]: up to the last successful time, or half of the ``size`` that was discarded."""
    reached = error.reached
    if reached is not None and SMALLEST * size < reached - now < size * (1.0 - SMALLEST):
        return reached - now
    return size / 2.0
