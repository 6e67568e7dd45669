"""The record of a slew with the line-of-sight loop: the true error over time, and what it is in each phase."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..cosim import Column
from ..results.observers.sampler import SampleObserver
from ..runs.scenario import list_needs
from ..sensors.line_of_sight import line_of_sight_error

Array = NDArray[np.float64]
Span = tuple[float, float]

SAMPLE_S = 1e-3  # between the rows that are kept: jitter of the default system ends far below 500 Hz
MOST_ROWS = 200_000  # 50 MB; a longer run keeps fewer rows a second
SETTLE_S = 5.0  # from lock to where the error is judged: the slowest pole of the loop is near 0.5 1/s

ATTITUDE = tuple(f"plant.payload_attitude.{k}" for k in "wxyz")
TURNED = ("plant.line_of_sight.x", "plant.line_of_sight.y", "plant.payload_rotation.x", "plant.payload_rotation.y")
MEASURED = tuple(f"tracker.line_of_sight_error.{k}" for k in "xyz")
LOCKED, MOVING, REACHABLE = "tracker.locked", "commander.moving", "commander.reachable"
FORCE = tuple(f"pointing.fine_force_{leg}" for leg in (1, 2, 3))
TOTAL = tuple(f"isolator.fine_force_{leg}" for leg in (1, 2, 3))
FINE = tuple(f"plant.fine_displacement_{leg}" for leg in (1, 2, 3))
FLAGS = (LOCKED, MOVING, REACHABLE)
NAMES = (*ATTITUDE, *TURNED, *MEASURED, *FLAGS, *FORCE, *TOTAL, *FINE)
NEEDS = (
    *list_needs("output", *(name for name in NAMES if name not in FLAGS)),
    *list_needs("output", *FLAGS, type="Boolean"),
)


@dataclass(frozen=True)
class Plan:
    """When what happens in a run, s, and where it leads."""

    start_s: float
    """The target changes."""
    hidden: Span | None
    """The target is hidden; None: never."""
    end_s: float
    target: tuple[float, float, float, float]
    """Attitude of the target, scalar first."""


@dataclass(frozen=True, eq=False)
class PointingRecord:
    """One run."""

    plan: Plan
    time: Array
    """(n,), s."""
    values: Array
    """(n, NAMES)."""

    def of(self, *names: str) -> Array:
        """Columns by name, (n, names)."""
        return self.values[:, [NAMES.index(name) for name in names]]

    @cached_property
    def error(self) -> Array:
        """True rotation that takes the line of sight to the target, after the target has changed, (n, 3), rad, P."""
        error = line_of_sight_error(self.of(*ATTITUDE), np.array(self.plan.target))
        turned = self.of(*TURNED)
        error[:, :2] -= turned[:, :2] - turned[:, 2:]
        return error

    @property
    def distance(self) -> Array:
        """Angle from the line of sight to the target, (n,), rad."""
        return np.asarray(np.hypot(self.error[:, 0], self.error[:, 1]))

    @property
    def reachable(self) -> bool:
        """The commander took the target."""
        return bool(self.of(REACHABLE)[-1, 0] > 0.5)

    @cached_property
    def arrival_s(self) -> float | None:
        """End of the commanded motion; None: it goes on."""
        moving = np.flatnonzero(self.of(MOVING)[:, 0] > 0.5)
        if not moving.size or moving[-1] + 1 >= len(self.time):
            return None
        return float(self.time[moving[-1] + 1])

    @cached_property
    def locks(self) -> list[float]:
        """When lock was won after the target had changed, s."""
        locked = (self.of(LOCKED)[:, 0] > 0.5) & (self.time > self.plan.start_s + 0.5)
        won = np.flatnonzero(locked[1:] & ~locked[:-1]) + 1
        return [float(self.time[k]) for k in won]

    def span(self, first_s: float, last_s: float) -> NDArray[np.bool_]:
        """(n,): rows of a time."""
        return (self.time >= first_s) & (self.time < last_s)

    def phases(self) -> dict[str, Span]:
        """Phases of the run, by what the report calls them; those that the run does not reach are left out."""
        plan, found = self.plan, {}
        first = self.locks[0] if self.locks else plan.end_s
        hidden = plan.hidden or (plan.end_s, plan.end_s)
        if self.arrival_s is not None:
            found["arrived, before lock"] = (self.arrival_s, first)
            settled = max(first, self.arrival_s) + SETTLE_S
            if self.locks:
                found["locked"] = (settled, hidden[0])
                found["target hidden"] = hidden
                again = [lock for lock in self.locks if lock >= hidden[1]]
                if again:
                    found["locked again"] = (again[0] + SETTLE_S, plan.end_s)
            else:
                found["arrived"] = (settled, plan.end_s)
        return {name: span for name, span in found.items() if span[1] > span[0] and self.span(*span).any()}

    def rms(self, span: Span) -> Array:
        """RMS of the error in a time, (3,), rad."""
        return np.asarray(np.sqrt(np.mean(self.error[self.span(*span)] ** 2, axis=0)))

    def mean(self, span: Span) -> Array:
        """Mean of the error in a time, (3,), rad."""
        return np.asarray(self.error[self.span(*span)].mean(axis=0))

    def peak(self, span: Span) -> float:
        """Largest distance from the target in a time, rad."""
        return float(self.distance[self.span(*span)].max())


class RecordMaker:
    """Makes the :class:`PointingRecord` of a run; ``observers`` goes to the master."""

    def __init__(self, plan: Plan, step_s: float) -> None:
        steps = round(plan.end_s / step_s)
        stride = max(1, round(SAMPLE_S / step_s), -(-steps // MOST_ROWS))
        self._plan = plan
        self._rows = list(range(0, steps + 1, stride))
        self._time = np.array(self._rows) * step_s
        self.observers: list[SampleObserver] = []

    def __call__(self, columns: Sequence[Column]) -> RecordMaker:
        """Make the observer for a run with these columns."""
        self.observers = [SampleObserver(columns, NAMES, self._rows)]
        return self

    def result(self) -> PointingRecord:
        """The record so far."""
        values = self.observers[0].values(*NAMES)
        done = ~np.isnan(values[:, 0])
        return PointingRecord(self._plan, self._time[done], values[done])
