"""Time in whole steps: t_n = start + n h, never accumulated; events at communication points, and progress."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from time import perf_counter

import numpy as np

from .errors import SlaveEnded, UsageError
from .rows import Array
from .structure import PortName, System
from .values import Value

ON_GRID = 1e-6
"""A time within this fraction of a step counts as a communication point (decimal fractions are not exact)."""
RESOLUTION = 1e-3
"""Rounding of a time may be at most this fraction of a step: FMUs check that they are called on time."""


def count_steps(duration: float, step: float) -> int | None:
    """Steps of ``step`` [s] in a duration [s]; None unless it is a whole number of at least 1."""
    ratio = duration / step
    count = round(ratio) if math.isfinite(ratio) else 0
    return count if count >= 1 and abs(ratio - count) <= ON_GRID * max(1.0, count * 1e-6) else None


def ends_at(ended: SlaveEnded, time: float, step: float) -> bool:
    """Whether an FMU has ended the simulation at a time [s], and not within the ``step`` [s] before."""
    return ended.reached is not None and abs(ended.reached - time) <= ON_GRID * step


@dataclass(frozen=True)
class StepClock:
    """Start time and communication step [s].

    Raises :class:`UsageError`: not finite, a step that is not positive or too small to tell times apart.
    """

    start: float
    step: float

    def __post_init__(self) -> None:
        if not math.isfinite(self.start):
            raise UsageError(f"start time: expected a finite number of seconds, got {self.start!r}")
        if not (math.isfinite(self.step) and self.step > 0.0):
            raise UsageError(f"step: expected a positive number of seconds, got {self.step!r}")
        self._check_resolution(self.start + self.step)

    def time(self, index: int) -> float:
        """Time [s] of a communication point."""
        return self.start + index * self.step

    def times(self, first: int, count: int) -> Array:
        """Times [s] of ``count`` communication points from ``first`` on."""
        return self.start + np.arange(first, first + count, dtype=np.float64) * self.step

    def steps(self, duration: float) -> int:
        """Steps in a duration [s].  Raises :class:`UsageError` unless it is a whole number of at least 1."""
        count = count_steps(duration, self.step)
        if count is None:
            raise UsageError(
                f"duration: expected a positive whole number of steps of {self.step!r} s, got {duration!r} s"
            )
        return count

    def index(self, time: float) -> int:
        """Number of the communication point at a time [s].  Raises :class:`UsageError` if there is none."""
        ratio = (time - self.start) / self.step if math.isfinite(time) else math.nan
        index = round(ratio) if math.isfinite(ratio) else 0
        if not abs(ratio - index) <= ON_GRID * max(1.0, abs(index) * 1e-6):
            near = f": the nearest is {self.time(index)!r} s" if math.isfinite(ratio) else ""
            raise UsageError(f"time {time!r} s is not a communication point{near} (step {self.step!r} s)")
        return index

    def check_end(self, index: int) -> None:
        """Check that times up to this communication point can be told apart.  Raises :class:`UsageError`."""
        self._check_resolution(self.time(index))

    def _check_resolution(self, time: float) -> None:
        rounding = math.ulp(max(abs(time), abs(self.start)))
        if rounding > RESOLUTION * self.step:
            raise UsageError(
                f"step: {self.step!r} s is too small at t = {time!r} s, where times are rounded to {rounding:.1e} s"
            )


def make_clock(system: System, step: float | None = None, start_time: float | None = None) -> StepClock:
    """The clock of a run; what is None is that of the system's default experiment.

    Raises :class:`UsageError`: no step, or see :class:`StepClock`.
    """
    size = system.experiment.step if step is None else step
    if size is None:
        raise UsageError(f"step: not given, and {system.path} states none in its default experiment")
    return StepClock(system.experiment.start_time if start_time is None else start_time, size)


Event = tuple[float, str, Value]
"""From this time [s] on, this input or tunable parameter (component.variable) has this value."""
Progress = Callable[[float, float, float], None]
"""Called at least after each block with simulated time [s], wall time of this run [s], simulated over wall time."""
Schedule = list[tuple[int, PortName, Value]]
"""Number of the communication point, what is set there, and to what; in the order of time."""


def make_schedule(
    events: Iterable[Event],
    clock: StepClock,
    first: int,
    end: int,
    check: Callable[[str, Value], tuple[PortName, Value]],
) -> Schedule:
    """The schedule of a run from communication point ``first`` to before ``end``.

    ``check`` finds the port of a name, and makes the value one of its type.

    Raises :class:`UsageError`: a time that is not a communication point of the run, or what ``check`` raises.
    """
    schedule = []
    for time, name, value in events:
        port, checked = check(name, value)
        index = clock.index(time)
        if not first <= index < end:
            raise UsageError(
                f"event {name} at t = {time!r} s is not within this run, from t = {clock.time(first)!r} s "
                f"to before t = {clock.time(end)!r} s"
            )
        schedule.append((index, port, checked))
    return sorted(schedule, key=lambda event: event[0])


def time_progress(progress: Progress | None, begin: float) -> Callable[[float], None]:
    """What tells ``progress`` of a run that begins now, at ``begin`` [s], when it is given the simulated time [s]."""
    if progress is None:
        return lambda time: None
    began = perf_counter()

    def note(time: float) -> None:
        wall = perf_counter() - began
        progress(time, wall, (time - begin) / wall)

    return note
