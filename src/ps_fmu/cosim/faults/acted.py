"""What summaries and figures say of faults: which acted, when, and on what."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict, dataclass

from ..clock import StepClock
from .binding import Fault
from .reading import BIAS, DELAY, DROPOUT, FREEZE, NOISE, OVERRIDE, SCALE


@dataclass(frozen=True)
class ActedFault:
    """A fault that acted from a time of the simulation [s] to another, None: to the end; in words as ``text``.

    ``inputs`` are those that saw the fault of the ``signal``.
    """

    from_s: float
    until_s: float | None
    signal: str
    action: str
    inputs: tuple[str, ...]
    text: str

    def as_dict(self) -> dict[str, object]:
        """The entry in summary.json."""
        return asdict(self)


def list_acted(faults: Iterable[Fault], clock: StepClock, time: float) -> tuple[ActedFault, ...]:
    """The faults that act in a step before a time [s]."""
    return tuple(
        ActedFault(
            clock.time(fault.first),
            None if fault.last is None else clock.time(fault.last),
            str(fault.signal),
            fault.event.action,
            tuple(map(str, fault.inputs)),
            describe(fault, clock),
        )
        for fault in faults
        if clock.time(fault.first) < time - 1e-6 * clock.step
    )


def describe(fault: Fault, clock: StepClock) -> str:
    """What a fault does and when, as ``12.000 s: sensors.reading_1 frozen until 15.000 s``."""
    target = f" to {fault.event.target}" if fault.event.target is not None else ""
    until = "" if fault.last is None else f" until {format_time(clock.time(fault.last))}"
    return f"{format_time(clock.time(fault.first))}: {fault.signal}{target} {_describe_action(fault)}{until}"


def identify(fault: Fault, clock: StepClock) -> str:
    """All that decides on what a fault does, in a line."""
    event, inputs = fault.event, ", ".join(map(str, fault.inputs))
    exact = fault.first, fault.last, fault.value, fault.delay_steps, event.probability, event.rms, event.density
    return f"{describe(fault, clock)}; seen by {inputs or 'nothing'}; {exact}; seed {event.seed}"


def format_time(time: float) -> str:
    """A time [s] to the millisecond, or with as many digits as it needs."""
    return f"{time:.3f} s" if abs(time - round(time, 3)) <= 1e-9 * max(1.0, abs(time)) else f"{time:.9g} s"


def _describe_action(fault: Fault) -> str:
    event = fault.event
    unit = "" if fault.unit in ("", "1") else f" {fault.unit}"
    value = f"{fault.value:g}" if isinstance(fault.value, float) else fault.value
    words = {
        OVERRIDE: f"replaced by {value}{unit}",
        BIAS: f"biased by {value}{unit}",
        SCALE: f"scaled by {value}",
        FREEZE: "frozen",
        DELAY: f"delayed by {value} s",
    }
    if event.action == NOISE and event.rms is not None:
        return f"with noise of {event.rms:g}{unit} RMS"
    if event.action == NOISE:
        return f"with noise of {event.density:g} " + (f"({fault.unit})^2/Hz" if unit else "/Hz")
    if event.action == DROPOUT:
        share = "" if event.probability == 1.0 else f", in {100.0 * event.probability:g} % of the steps"
        return ("lost, the last value held" if fault.value is None else f"lost, {value}{unit} in its place") + share
    return words[event.action]
