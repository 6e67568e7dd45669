"""What happens during a run: inputs and tunable parameters that are set, and who is told how far it is."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from time import perf_counter

from .clock import StepClock
from .errors import UsageError
from .structure import PortName
from .values import Value

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
