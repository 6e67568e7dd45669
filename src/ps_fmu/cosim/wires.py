"""Where inputs come from, and which calls that takes."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from fmpy.model_description import ModelDescription
from numpy.typing import NDArray

from .clock import StepClock
from .columns import RunColumns
from .faults.active import ActiveFaults
from .fmu_instance import FAMILY, FmuInstance
from .graph import Wiring
from .plan import Call, Change, Feed, Gather, Gathered, Move
from .rows import Array, Latest, Rows
from .schemes.scheme import Scheme
from .signals import BoundSignal
from .stopwatch import Stopwatch
from .structure import PortName, System, Value
from .substeps import RepeatingLoop


class Assembly:
    """The parts of a :class:`.Master`, which sets them."""

    system: System
    clock: StepClock
    descriptions: Mapping[str, ModelDescription]
    """Of the FMUs, by component."""
    scheme: Scheme
    """As resolved for the system."""
    wiring: Wiring
    signals: Sequence[BoundSignal]
    """Inputs of the run over time, which lie in the rows."""
    faults: ActiveFaults
    run_columns: RunColumns
    rows: Rows
    """Where the outputs go."""
    stopwatch: Stopwatch | None
    """Times whole steps."""
    instances: dict[str, FmuInstance]
    """The loaded FMUs, by component."""
    values_set: dict[PortName, Value]
    """What the user, or an event, has set; a connected input in it has left its connection."""
    loop: RepeatingLoop | None
    """Runs the steps; None before the initialisation."""


def find_fed(parts: Assembly, cut: Collection[PortName]) -> set[PortName]:
    """The inputs that get a value in each step, from a connection or from a signal, but those that are ``cut``."""
    return {*_find_sources(parts, cut), *(port for s in parts.signals for port, _ in s.targets if port not in cut)}


def _find_sources(parts: Assembly, cut: Collection[PortName]) -> dict[PortName, PortName]:
    """Where the connected inputs get their values.

    A parameter gets the value of its connection once, in the initialisation.
    """
    variables = {name: instance.variables for name, instance in parts.instances.items()}
    return {
        c.target: c.source
        for c in parts.wiring.connections
        if c.target not in cut and variables[c.target.component][c.target.variable].causality == "input"
    }


class Wires:
    """Where the inputs of FMUs come from in steps of ``step`` [s], and what happens to the values.

    Inputs that the user has set keep that value.
    """

    def __init__(self, parts: Assembly, step: float) -> None:
        self.parts, self.step = parts, step
        self.instances, self.signals, self.faults = parts.instances, parts.signals, parts.faults
        cut = parts.values_set.keys()
        self.sources = _find_sources(parts, cut)
        self.conversions = {p: conversion for p, conversion in parts.wiring.conversions.items() if p in self.sources}
        for signal in parts.signals:
            for target, conversion in signal.targets:
                if target not in cut:
                    self.sources[target] = signal.port
                    self.conversions |= {} if conversion.changes_nothing else {target: conversion}
        self.sources |= parts.faults.find_bases()
        self.inputs: dict[str, list[PortName]] = {name: [] for name in self.instances}
        for port in self.sources:
            self.inputs[port.component].append(port)
        for name, ports in self.inputs.items():
            # By value reference: FMUs that store them in that order copy longer runs.
            variables = self.instances[name].variables
            ports.sort(key=lambda port: variables[port.variable].valueReference)
        self._outputs = [(kind, _group(kind.places)) for kind in (parts.rows.real, parts.rows.discrete)]

    def make_exchange(self, instance: FmuInstance) -> tuple[list[Gathered], list[Call], list[Call]]:
        """What brings an FMU its inputs, and takes its outputs: gathers, and the calls to set and to get."""
        gathers: list[Gathered] = []
        sets, gets = [], []
        bases: list[tuple[Latest, Mapping[str, Sequence[PortName]]]] = [(base, {}) for base in self.faults.make_bases()]
        for kind, outputs in (*self._outputs, *bases):
            wired = [port for port in self.inputs[instance.name] if self.sources[port] in kind.places]
            if wired:
                inputs = np.zeros(len(wired), kind.values.dtype)
                gathers += self.make_gathers(kind, wired, inputs)
                sets += _make_accesses(instance, "Set", wired, inputs, {p: place for place, p in enumerate(wired)})
            gets += _make_accesses(instance, "Get", outputs.get(instance.name, ()), kind.values, kind.places)
        return gathers, sets, gets

    def make_gathers(self, kind: Latest, wired: Sequence[PortName], inputs: NDArray[Any]) -> list[Gathered]:
        """What brings the outputs of a kind to inputs: faults of outputs act before a conversion, others after it."""
        taken = np.array([kind.places[self.sources[port]] for port in wired])
        before, after = (self.faults.make_group(wired, inputs, on_output) for on_output in (True, False))
        gather = Gather(kind.values, taken, inputs, tuple(wired))
        every = gather, before, *self.make_conversion(wired, inputs), after
        return [part for part in every if part is not None]

    def make_conversion(
        self, wired: Sequence[PortName], inputs: NDArray[Any], only: Collection[int] | None = None
    ) -> list[Change]:
        """What changes the inputs that have conversions in place, or ``only`` those at some places."""
        found = [
            (place, self.conversions[port])
            for place, port in enumerate(wired)
            if port in self.conversions and (only is None or place in only)
        ]
        if inputs.dtype == np.float64:
            scales = [(place, conversion.factor, conversion.offset) for place, conversion in found]
            return [make_scale(inputs, scales)] if scales else []
        lines = [
            (place, value, int(conversion.apply(value)))
            for place, conversion in found
            for value in sorted({value for table in conversion.tables for value in table})
        ]
        return [Change("look_up", inputs, np.array(lines, dtype=np.int32))] if lines else []

    def make_feeds(self) -> list[Feed]:
        """What puts the inputs of the run at the end of a step into the rows."""
        feeds, rows = [], self.parts.rows
        for kind in (rows.real, rows.discrete):
            own = [signal for signal in self.signals if signal.port in kind.places]
            if own:
                feeds.append(Feed(kind.values, [kind.places[signal.port] for signal in own], own, self.step))
        return feeds

    def list_moves(self, instance: FmuInstance) -> list[Move]:
        """The connections of Strings to an FMU, but those that faults keep from their sources."""
        cut = self.faults.find_cut()
        return [
            Move(self.instances[source.component], source.variable, instance, port.variable)
            for port in self.inputs[instance.name]
            if (source := self.sources[port]).component and instance.variables[port.variable].type == "String"
            and port not in cut
        ]


def make_scale(inputs: NDArray[np.float64], scales: Sequence[tuple[int, float, float]]) -> Change:
    """What changes inputs in place, by their places with factors and offsets."""
    table = np.array([place for place, *_ in scales], dtype=np.int64)
    numbers = np.array([own for _, *own in scales])
    return Change("scale", inputs, table, numbers)


def make_step(instance: FmuInstance, span: Array | None = None) -> Call:
    """fmi2DoStep over the step, or over a span."""
    return Call(instance, "fmi2DoStep", instance.find_address("fmi2DoStep"), span=span)


def make_derivatives(instance: FmuInstance, names: Sequence[str], slopes: NDArray[np.float64]) -> Call:
    """fmi2SetRealInputDerivatives of first order, from the ``slopes`` of the inputs of these names."""
    function = "fmi2SetRealInputDerivatives"
    references = np.array([instance.variables[name].valueReference for name in names], dtype=np.uint32)
    orders = np.ones(len(names), dtype=np.int32)
    return Call(instance, function, instance.find_address(function), tuple(names), references, slopes, orders=orders)


def _group(ports: Iterable[PortName]) -> dict[str, list[PortName]]:
    """Ports by component."""
    groups: dict[str, list[PortName]] = {}
    for port in ports:
        groups.setdefault(port.component, []).append(port)
    return groups


def _make_accesses(
    instance: FmuInstance, verb: str, ports: Sequence[PortName], array: NDArray[Any], places: Mapping[PortName, int]
) -> list[Call]:
    """fmi2Set... or fmi2Get... of an FMU's own ports, a call for neighbours in an array of one access function."""
    runs: list[list[PortName]] = []
    for port in ports:
        last = runs[-1][-1] if runs else None
        neighbour = last is not None and places[port] == places[last] + 1
        if last is not None and neighbour and _get_family(instance, port) == _get_family(instance, last):
            runs[-1].append(port)
        else:
            runs.append([port])
    functions = (f"fmi2{verb}{_get_family(instance, run[0])}" for run in runs)
    return [_make_access(instance, f, run, array[places[run[0]] :]) for f, run in zip(functions, runs, strict=True)]


def _get_family(instance: FmuInstance, port: PortName) -> str:
    return FAMILY[instance.variables[port.variable].type]


def _make_access(instance: FmuInstance, function: str, ports: Sequence[PortName], values: NDArray[Any]) -> Call:
    names = tuple(port.variable for port in ports)
    references = np.array([instance.variables[name].valueReference for name in names], dtype=np.uint32)
    later = function.startswith("fmi2Get")
    return Call(instance, function, instance.find_address(function), names, references, values, later)
