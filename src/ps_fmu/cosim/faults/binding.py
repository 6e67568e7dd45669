"""Faults checked against the system: which inputs see them, and from which communication point to which."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field

from fmpy.model_description import ModelDescription, ModelVariable

from ..clock import StepClock, count_steps
from ..conversion import find_end
from ..description import convert_value, explain_unsettable, find_variable, get_unit
from ..errors import SystemFileError, UsageError
from ..structure import PortName, System, suggest_names
from ..values import list_items
from .reading import (
    BIAS,
    DELAY,
    DROPOUT,
    FREEZE,
    NOISE,
    OVERRIDE,
    RESET,
    SCALE,
    FaultEvent,
    FaultFile,
)

LONGEST_DELAY = 10_000_000
"""Steps: each input that sees it keeps so many numbers."""

_TYPES = {
    OVERRIDE: ("Real", "Integer", "Enumeration", "Boolean", "String"),
    FREEZE: ("Real", "Integer", "Enumeration", "Boolean", "String"),
    DROPOUT: ("Real", "Integer", "Enumeration", "Boolean"),
    DELAY: ("Real", "Integer", "Enumeration", "Boolean"),
    BIAS: ("Real", "Integer"),
    SCALE: ("Real",),
    NOISE: ("Real",),
}
"""Types of variables that an action is for."""


@dataclass(frozen=True, eq=False)
class Fault:
    """A fault with the communication points where it acts, from ``first`` to before ``last`` (None: to the end).

    ``inputs``: those that see it, ``on_output`` whether it is in the values of an output, before they are converted
    for the inputs; ``value``: as the type of the ``signal``; ``kind`` and ``unit``: of the signal.
    """

    event: FaultEvent
    signal: PortName
    inputs: tuple[PortName, ...]
    on_output: bool
    kind: str
    unit: str
    first: int
    last: int | None = None
    value: float | int | bool | str | None = None
    delay_steps: int = 0

    def acts_at(self, index: int) -> bool:
        """Whether it acts in the step from this communication point on."""
        return self.first <= index and (self.last is None or index < self.last)


@dataclass(frozen=True, eq=False)
class BoundFaults:
    """The faults of a system in the order in which they begin, those that begin together in the order of the file."""

    file: FaultFile
    faults: tuple[Fault, ...]
    remarks: tuple[str, ...]
    """Of what acts on nothing."""
    types: Mapping[PortName, str] = field(default_factory=dict)
    """Types of the inputs and parameters that see a fault."""

    def check_end(self, clock: StepClock, end: int) -> None:
        """Raises :class:`SystemFileError` for a fault that begins after the end of a run, a communication point."""
        for fault in self.faults:
            if fault.first >= end:
                raise self.file.error(
                    fault.event,
                    f"time: expected a time before the end of the run, {clock.time(end) - clock.start:g} s after its "
                    f"start, got {fault.event.time_s:g} s",
                )


def bind_faults(
    file: FaultFile, system: System, descriptions: Mapping[str, ModelDescription], clock: StepClock
) -> BoundFaults:
    """Check the faults of a file against a system whose wiring is right.

    Raises :class:`SystemFileError` with the line: no such component, variable or connection, a variable that no fault
    can act on, a value or an action that is not for its type, a delay that is not a whole number of steps.
    """
    binder = _Binder(file, system, descriptions, clock)
    order = sorted(range(len(file.events)), key=lambda k: (binder.find_point(file.events[k].time_s), k))
    for place in order:
        event = file.events[place]
        try:
            binder.add(event)
        except (UsageError, ValueError) as error:
            if isinstance(error, SystemFileError):
                raise
            raise file.error(event, str(error)) from error
    return binder.conclude()


class _Binder:
    """Adds events in the order of their times, and ends the faults that they end."""

    def __init__(
        self, file: FaultFile, system: System, descriptions: Mapping[str, ModelDescription], clock: StepClock
    ) -> None:
        self._file, self._system, self._descriptions, self._clock = file, system, descriptions, clock
        self._targets: dict[PortName, list[PortName]] = {}
        for connection in system.connections:
            variable = find_variable(descriptions[connection.target.component], connection.target.variable)
            if variable.causality == "input":  # what is connected to a parameter is passed on once, at the start
                self._targets.setdefault(connection.source, []).append(connection.target)
        self._end = None if file.end_s is None else self.find_point(file.end_s)
        self._found: list[Fault] = []
        self._lasts: list[int | None] = []
        self._remarks: list[str] = []
        self._types: dict[PortName, str] = {}

    def find_point(self, time: float) -> int:
        """The first communication point that is not before a time [s] from the start of the run."""
        ratio = min(time / self._clock.step, sys.float_info.max)  # a point there may be none of: check_end says so
        near = round(ratio)
        return near if abs(ratio - near) <= 1e-6 * max(1.0, near * 1e-6) else math.ceil(ratio)

    def add(self, event: FaultEvent) -> None:
        """Add an event; those before it have been added."""
        signal = event.signal
        names = [component.name for component in self._system.components]
        if signal.component not in names:
            hint = suggest_names(signal.component, names) or f"; there are {', '.join(names[:20])}"
            raise UsageError(f"model: there is no component {signal.component!r} in the system{hint}")
        variable = find_variable(self._descriptions[signal.component], signal.variable)
        inputs, on_output = self._find_inputs(event, variable)
        first = self.find_point(event.time_s)
        self._end_others(event, first)
        if event.action == RESET:
            return
        if variable.type not in _TYPES[event.action]:
            fit = ", ".join(action for action, types in _TYPES.items() if variable.type in types)
            raise UsageError(f"action {event.action}: cannot act on {signal} ({variable.type}): expected one of {fit}")
        last = self._end
        if event.duration_s is not None:
            own = self.find_point(event.time_s + event.duration_s)
            if own == first:
                step = self._clock.step
                raise UsageError(f"duration: no step of {step:g} s ends within {event.duration_s:g} s: expected more")
            last = own if last is None else min(own, last)
        unit = get_unit(variable) or ""
        fault = Fault(
            event, signal, inputs, on_output, variable.type, unit, first,
            value=self._check_value(event, variable), delay_steps=self._count_delay(event),
        )  # fmt: skip
        self._found.append(fault)
        self._lasts.append(last)
        for port in inputs:
            kind = find_variable(self._descriptions[port.component], port.variable).type
            self._types[port] = kind
        if not inputs:
            self._remarks.append(
                f"{self._file.path}: {event.key}: no connection leads from the output {signal}: "
                f"the fault changes nothing"
            )

    def conclude(self) -> BoundFaults:
        """All faults, with their ends."""
        faults = tuple(
            Fault(**{**vars(fault), "last": last})
            for fault, last in zip(self._found, self._lasts, strict=True)
            if last is None or last > fault.first
        )
        return BoundFaults(self._file, faults, tuple(self._remarks), self._types)

    def _find_inputs(self, event: FaultEvent, variable: ModelVariable) -> tuple[tuple[PortName, ...], bool]:
        """The inputs or parameters that see an event, and whether it is one of an output."""
        signal = event.signal
        if variable.causality in ("input", "parameter"):
            if event.target is not None:
                raise UsageError(f"target: expected none, as {signal} is not an output but {variable.causality}")
            if reason := explain_unsettable(variable, running=True):
                raise UsageError(f"variable: {signal} {reason}: set it by --parameters")
            return (signal,), False
        targets = self._targets.get(signal, [])
        if variable.causality != "output" and not targets:
            raise UsageError(
                f"variable: expected an output, an input or a tunable parameter; the causality of {signal} is "
                f"{variable.causality}"
            )
        if event.target is None:
            return tuple(targets), True
        target = self._system.find_port(event.target)
        if target not in targets:
            known = ", ".join(map(str, targets)) or "nothing"
            raise UsageError(f"target: {signal} is not connected to {target}; it is connected to {known}")
        return (target,), True

    def _end_others(self, event: FaultEvent, first: int) -> None:
        """End the faults on the same signal that an event replaces or resets."""
        if event.joins:
            return
        for place, other in enumerate(self._found):
            last = self._lasts[place]
            if other.signal != event.signal or (last is not None and last <= first):
                continue
            if other.event.target == event.target or (event.action == RESET and event.target is None):
                self._lasts[place] = first

    def _check_value(self, event: FaultEvent, variable: ModelVariable) -> float | int | bool | str | None:
        value = event.value
        if event.action == DELAY or value is None:
            return value
        if event.action in (OVERRIDE, DROPOUT):
            checked = convert_value(variable, value)
            items = find_end(variable, self._descriptions[event.signal.component]).items
            if items and checked not in items.values():
                raise UsageError(f"value: expected an item of the enumeration, {list_items(items)}, got {value}")
            return checked
        number = isinstance(value, int | float) and not isinstance(value, bool)
        if not number or not math.isfinite(float(value)):
            raise UsageError(f"value: expected a finite number, got {value!r}")
        if variable.type == "Integer" and (not isinstance(value, int) or abs(value) >= 2**31):
            raise UsageError(f"value: expected a whole number within 32 bits for the Integer {event.signal}")
        return value

    def _count_delay(self, event: FaultEvent) -> int:
        if event.action != DELAY or not event.value:
            return 0
        steps = count_steps(float(event.value), self._clock.step)
        if steps is None or steps > LONGEST_DELAY:
            raise UsageError(
                f"value: expected a delay of whole steps of {self._clock.step:g} s, {LONGEST_DELAY} at most, "
                f"got {event.value!r} s{self._name_neighbours(float(event.value))}"
            )
        return steps

    def _name_neighbours(self, delay_s: float) -> str:
        """The nearest delays of whole steps, as the end of a message; empty where there is none."""
        count = math.floor(delay_s / self._clock.step) if math.isfinite(delay_s) else -1
        if not 0 <= count < LONGEST_DELAY:
            return ""
        return f": the nearest are {count * self._clock.step:.9g} s and {(count + 1) * self._clock.step:.9g} s"


# ---- what summaries and figures say ---------------------------------------------------------------------------------


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
