"""Make the plan of a step: where inputs come from, and which calls that takes."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from ctypes import CFUNCTYPE, PYFUNCTYPE, c_double, c_int, c_size_t, c_void_p, cast
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .faults.active import ActiveFaults
from .faults.effects import EffectGroup
from .fmu_instance import FAMILY, FmuInstance
from .graph import Wiring
from .hops import Conversion
from .plan import Call, Gather, Move, Plan, Span, Stage
from .rows import Latest, Rows
from .signals import BoundSignal
from .structure import PortName

# Arguments as ctypes passes them on, converted beforehand: 0.11 us a call, where declared types take 0.28.
_pointer, _size, _boolean, _double = c_void_p.from_param, c_size_t.from_param, c_int.from_param, c_double.from_param
_CONVERTED = CFUNCTYPE(c_int)
# An FMU that runs Python takes the interpreter's lock at once: to let go of it first costs another 0.1 us.
_CONVERTED_LOCKED = PYFUNCTYPE(c_int)
_FEW = 12
"""So many inputs are converted one by one, which costs 0.1 us each."""


def make_plan(
    instances: Mapping[str, FmuInstance],
    wiring: Wiring,
    rows: Rows,
    step: float,
    scheme: str,
    cut: Collection[PortName],
    signals: Sequence[BoundSignal] = (),
    faults: ActiveFaults | None = None,
) -> Plan:
    """Plan of one step.

    Parameters
    ----------
    instances: loaded FMUs by component
    wiring: connections, and the order of stepping for Gauss-Seidel
    rows: where the outputs go
    step: communication step [s]
    scheme: ``"jacobi"``: all FMUs see the outputs of the last communication point, so there is one stage;
        ``"gauss-seidel"``: each sees what those stepped before it have just put out, so each is a stage
    cut: connected inputs that the user has set: they keep that value
    signals: inputs of the run, which lie in the rows
    faults: those that act now
    """
    now = c_double()
    wires = make_wires(instances, wiring, cut, signals, faults)
    order = wiring.stepping if scheme == "gauss-seidel" else tuple(instances)
    groups = [(name,) for name in order] if scheme == "gauss-seidel" else [order]
    members = ([instances[name] for name in group] for group in groups)
    stages = tuple(wires.make_stage(group, rows, now, step) for group in members)
    return Plan(stages, now, step, tuple(signals))


def find_sources(
    instances: Mapping[str, FmuInstance], wiring: Wiring, cut: Collection[PortName]
) -> dict[PortName, PortName]:
    """Where the connected inputs get their values, but those that are ``cut``.

    A parameter gets the value of its connection once, in the initialisation.
    """
    return {
        c.target: c.source
        for c in wiring.connections
        if c.target not in cut and instances[c.target.component].variables[c.target.variable].causality == "input"
    }


def find_fed(
    instances: Mapping[str, FmuInstance], wiring: Wiring, cut: Collection[PortName], signals: Sequence[BoundSignal]
) -> set[PortName]:
    """The inputs that get a value in each step, from a connection or from a signal."""
    return {*find_sources(instances, wiring, cut), *(p for s in signals for p, _ in s.targets if p not in cut)}


def make_wires(
    instances: Mapping[str, FmuInstance],
    wiring: Wiring,
    cut: Collection[PortName],
    signals: Sequence[BoundSignal] = (),
    faults: ActiveFaults | None = None,
) -> Wires:
    """Where all inputs come from; see :func:`make_plan`."""
    sources = find_sources(instances, wiring, cut)
    conversions = {target: conversion for target, conversion in wiring.conversions.items() if target in sources}
    for signal in signals:
        for target, conversion in signal.targets:
            if target not in cut:
                sources[target] = signal.port
                conversions |= {} if conversion.changes_nothing else {target: conversion}
    if faults is not None:
        sources |= faults.find_bases()
    return Wires(instances, sources, conversions, signals, faults)


class Wires:
    """Where the inputs of the instances come from, and what happens to the values."""

    def __init__(
        self,
        instances: Mapping[str, FmuInstance],
        sources: Mapping[PortName, PortName],
        conversions: Mapping[PortName, Conversion],
        signals: Sequence[BoundSignal] = (),
        faults: ActiveFaults | None = None,
    ) -> None:
        self.instances, self.sources, self.conversions = instances, sources, conversions
        self.signals, self.faults = signals, faults
        self.inputs: dict[str, list[PortName]] = {name: [] for name in instances}
        for port in sources:
            self.inputs[port.component].append(port)
        for name, ports in self.inputs.items():
            # By value reference: FMUs that store them in that order copy longer runs.
            variables = instances[name].variables
            ports.sort(key=lambda port: variables[port.variable].valueReference)

    def make_stage(
        self, stepped: Sequence[FmuInstance], rows: Rows, now: c_double, step: float
    ) -> Stage:
        """The part of a step that some FMUs go through together."""
        gathers, sets, gets = self.make_exchange(stepped, rows)
        steps = [make_step(instance, now, step) for instance in stepped]
        return Stage(tuple(gathers), (*sets, *steps, *gets), tuple(self.list_moves(stepped)))

    def make_exchange(
        self, stepped: Sequence[FmuInstance], rows: Rows
    ) -> tuple[list[Gather | EffectGroup], list[Call], list[Call]]:
        """What brings some FMUs their inputs, and takes their outputs: gathers, and the calls to set and to get."""
        gathers: list[Gather | EffectGroup] = []
        sets, gets = [], []
        for kind in (rows.real, rows.discrete, *(() if self.faults is None else self.faults.make_bases())):
            # One buffer for all of them: to gather 21 numbers costs 0.25 us, twice 10 costs 0.4.
            wired = [p for i in stepped for p in self.inputs[i.name] if self.sources[p] in kind.places]
            places = {port: place for place, port in enumerate(wired)}
            inputs = np.zeros(len(wired), kind.values.dtype)
            if wired:
                gathers += self.make_gathers(kind, wired, inputs)
            wired_of, outputs_of = _group(wired), _group(kind.places)
            for instance in stepped:
                runs = _find_runs(instance, wired_of.get(instance.name, ()), places.__getitem__)
                sets += [_make_access(instance, "Set", run, inputs, places.__getitem__) for run in runs]
                gets += [
                    _make_access(instance, "Get", run, kind.values, kind.places.__getitem__)
                    for run in _find_runs(instance, outputs_of.get(instance.name, ()), kind.places.__getitem__)
                ]
        return gathers, sets, gets

    def make_gathers(self, kind: Latest, wired: Sequence[PortName], inputs: NDArray[Any]) -> list[Gather | EffectGroup]:
        """What brings the outputs of a kind to inputs: faults of outputs act before a conversion, others after it."""
        taken = np.array([kind.places[self.sources[port]] for port in wired])
        convert = self.make_conversion(wired, inputs)
        before, after = self.make_groups(wired, inputs, convert)
        gather = Gather(kind.values, taken, inputs, None if before else convert, tuple(wired))
        return [gather, *before, *after]

    def make_groups(
        self,
        wired: Sequence[PortName],
        inputs: NDArray[Any],
        convert: Callable[[], None] | None,
        lines: tuple[NDArray[np.float64], float] | None = None,
    ) -> tuple[list[EffectGroup], list[EffectGroup]]:
        """What faults do before the inputs are converted, and that with it if there is any, and behind it."""
        if self.faults is None:
            return [], []
        before = self.faults.make_group(wired, inputs, True, convert, lines)
        after = self.faults.make_group(wired, inputs, False, None, lines)
        return [] if before is None else [before], [] if after is None else [after]

    def make_conversion(
        self, wired: Sequence[PortName], inputs: NDArray[Any], slopes: NDArray[np.float64] | None = None
    ) -> Callable[[], None] | None:
        """What changes the inputs that have conversions, and their slopes, in place; None where none has."""
        found = [(place, self.conversions[port]) for place, port in enumerate(wired) if port in self.conversions]
        if not found:
            return None
        if inputs.dtype != np.float64:
            tables = [(place, conversion.apply) for place, conversion in found]

            def look_up() -> None:
                for place, apply in tables:
                    inputs[place] = apply(int(inputs[place]))

            return look_up
        if len(found) <= _FEW:
            return _scale_few(found, inputs, slopes)
        places = np.array([place for place, _ in found])
        factors = np.array([conversion.factor for _, conversion in found])
        offsets = np.array([conversion.offset for _, conversion in found])

        def scale() -> None:
            with np.errstate(over="ignore", invalid="ignore"):  # the FMU's outputs show what is not finite
                inputs[places] = inputs[places] * factors + offsets
                if slopes is not None:
                    slopes[places] *= factors

        return scale

    def list_moves(self, stepped: Sequence[FmuInstance]) -> list[Move]:
        """The connections of Strings to some instances, but those that faults keep from their sources."""
        cut = () if self.faults is None else self.faults.find_cut()
        return [
            Move(self.instances[source.component], source.variable, instance, port.variable)
            for instance in stepped
            for port in self.inputs[instance.name]
            if (source := self.sources[port]).component and instance.variables[port.variable].type == "String"
            and port not in cut
        ]


def _scale_few(
    found: Sequence[tuple[int, Conversion]], inputs: NDArray[np.float64], slopes: NDArray[np.float64] | None
) -> Callable[[], None]:
    """What converts some inputs in place one by one, without the 2 us that numpy needs for few as for many."""
    table = [(place, conversion.factor, conversion.offset) for place, conversion in found]
    values: Any = inputs.data  # of doubles, where mypy knows bytes
    lines: Any = None if slopes is None else slopes.data

    def scale() -> None:
        for place, factor, offset in table:
            values[place] = values[place] * factor + offset
            if lines is not None:
                lines[place] *= factor

    return scale


def make_step(instance: FmuInstance, now: c_double, step: float, span: Span | None = None) -> Call:
    """fmi2DoStep over the step from ``now`` [s] on, or over a span."""
    begin, length = (now, step) if span is None else (span.begin, span.length)
    # noSetFMUStatePriorToCurrentPoint is true as in other tools, although steps may be repeated from a state: some FMUs
    # take false for "make the last step again".
    rest = _double(length), _boolean(True)
    bound = _bind(instance, instance.stepper(), begin, *rest)
    return Call(instance, "fmi2DoStep", *bound, span=span)


def make_derivatives(instance: FmuInstance, names: Sequence[str], slopes: NDArray[np.float64]) -> Call:
    """fmi2SetRealInputDerivatives of first order, from the ``slopes`` of the inputs of these names."""
    function = "fmi2SetRealInputDerivatives"
    references = np.array([instance.variables[name].valueReference for name in names], dtype=np.uint32)
    orders = np.ones(len(names), dtype=np.int32)
    arrays = _pointer(references.ctypes.data), _size(len(names)), _pointer(orders.ctypes.data)
    bound = _bind(instance, instance.access(function), *arrays, _pointer(slopes.ctypes.data))
    return Call(instance, function, *bound, tuple(names), references, slopes, orders=orders)


def _group(ports: Iterable[PortName]) -> dict[str, list[PortName]]:
    """Ports by component."""
    groups: dict[str, list[PortName]] = {}
    for port in ports:
        groups.setdefault(port.component, []).append(port)
    return groups


def _find_runs(
    instance: FmuInstance, ports: Sequence[PortName], place: Callable[[PortName], int]
) -> list[list[PortName]]:
    """An instance's own ports, cut so that one call does for each: one access function, neighbouring places."""
    runs: list[list[PortName]] = []
    for port in ports:
        last = runs[-1][-1] if runs else None
        neighbour = last is not None and place(port) == place(last) + 1
        if last is not None and neighbour and _get_family(instance, port) == _get_family(instance, last):
            runs[-1].append(port)
        else:
            runs.append([port])
    return runs


def _get_family(instance: FmuInstance, port: PortName) -> str:
    return FAMILY[instance.variables[port.variable].type]


def _make_access(
    instance: FmuInstance, verb: str, ports: Sequence[PortName], array: NDArray[Any], place: Callable[[PortName], int]
) -> Call:
    """fmi2Set... or fmi2Get... of neighbours in an array."""
    function = f"fmi2{verb}{_get_family(instance, ports[0])}"
    names = tuple(port.variable for port in ports)
    references = np.array([instance.variables[name].valueReference for name in names], dtype=np.uint32)
    values = array[place(ports[0]) :]
    arguments = _pointer(references.ctypes.data), _size(len(names)), _pointer(values.ctypes.data)
    bound = _bind(instance, instance.access(function), *arguments)
    return Call(instance, function, *bound, names, references, values, later=verb == "Get")


def _bind(instance: FmuInstance, function: Any, *arguments: Any) -> tuple[Callable[[], int], int]:
    """A function of the library, the instance and the other arguments as a function of nothing; its address."""
    prototype = _CONVERTED_LOCKED if instance.runs_python else _CONVERTED
    invoke = partial(cast(function, prototype), _pointer(instance.address), *arguments)
    return invoke, cast(function, c_void_p).value or 0
