"""One communication step as data: what is copied where, and which library function gets which arguments.

The plan is made once and executed by a short loop, in Python (:mod:`.loops`) or in C (:mod:`.compiled`): the index
arrays, the addresses and the constants in here are all that either needs.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from ctypes import CFUNCTYPE, PYFUNCTYPE, c_double, c_int, c_size_t, c_void_p, cast
from dataclasses import dataclass
from functools import partial
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from .errors import SlaveEnded
from .fmu_instance import FAMILY, FmuInstance
from .graph import Wiring
from .guard import End
from .hops import Conversion
from .rows import Rows
from .signals import BoundSignal
from .structure import PortName

SCHEMES = ("jacobi", "gauss-seidel")

# Arguments as ctypes passes them on, converted beforehand: 0.11 us a call, where declared types take 0.28.
_pointer, _size, _boolean, _double = c_void_p.from_param, c_size_t.from_param, c_int.from_param, c_double.from_param
_CONVERTED = CFUNCTYPE(c_int)
# An FMU that runs Python takes the interpreter's lock at once: to let go of it first costs another 0.1 us.
_CONVERTED_LOCKED = PYFUNCTYPE(c_int)


@dataclass(frozen=True)
class Call:
    """A library function with all its arguments, which are always the same objects.

    ``invoke()`` calls it and returns the fmi2Status; ``address`` is where it is.  ``later`` says that it reads what
    fmi2DoStep has made.  To set or get, it takes the addresses of the value references and of the first of the
    ``values``, as many of each as there are names.
    """

    instance: FmuInstance
    function: str
    invoke: Callable[[], int]
    address: int
    names: tuple[str, ...] = ()
    references: NDArray[np.uint32] | None = None
    values: NDArray[Any] | None = None
    later: bool = False

    def check(self, status: int, time: float, step: float) -> None:
        """Count a warning in the step from ``time`` on [s], raise :class:`SlaveError` on anything worse."""
        try:
            self.instance.check(self.function, status, time + step if self.later else time, self.names)
        except SlaveEnded as ended:
            ended.during = self
            raise

    def give_up(self, end: End, time: float, step: float) -> NoReturn:
        """Raise what a call means that did not return in the step from ``time`` on [s]."""
        self.instance.give_up(self.function, end, time + step if self.later else time)


@dataclass(frozen=True)
class Gather:
    """``inputs[i] = outputs[sources[i]]``: what the connections carry, for one kind of numbers.

    ``convert()`` then changes the inputs in place, where some have other units or transformations.
    """

    outputs: NDArray[Any]
    sources: NDArray[np.intp]
    inputs: NDArray[Any]
    convert: Callable[[], None] | None = None


@dataclass(frozen=True)
class Move:
    """A connection of Strings, which have no place in an array."""

    source: FmuInstance
    output: str
    target: FmuInstance
    input: str

    def carry(self, time: float) -> None:
        """From output to input.  Raises :class:`SlaveError`."""
        self.target.set({self.input: self.source.get([self.output], time)[self.output]}, time)


@dataclass(frozen=True)
class Stage:
    """A part of a step: first all that is gathered and moved, then the calls in their order."""

    gathers: tuple[Gather, ...]
    calls: tuple[Call, ...]
    moves: tuple[Move, ...] = ()


@dataclass(frozen=True)
class Plan:
    """The stages of a step.  ``now`` [s], where it begins, is an argument of every fmi2DoStep."""

    stages: tuple[Stage, ...]
    now: c_double
    step: float
    signals: tuple[BoundSignal, ...] = ()

    @property
    def needs_python(self) -> bool:
        """Whether it has what only the loop in Python can do: inputs over time, Strings, conversions."""
        gathers = (gather for stage in self.stages for gather in stage.gathers)
        return bool(self.signals or any(s.moves for s in self.stages) or any(g.convert for g in gathers))


def make_plan(
    instances: Mapping[str, FmuInstance],
    wiring: Wiring,
    rows: Rows,
    step: float,
    scheme: str,
    cut: Collection[PortName],
    signals: Sequence[BoundSignal] = (),
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
    """
    now = c_double()
    sources = {
        c.target: c.source
        for c in wiring.connections
        if c.target not in cut and instances[c.target.component].variables[c.target.variable].causality == "input"
    }
    conversions = {target: conversion for target, conversion in wiring.conversions.items() if target in sources}
    for signal in signals:
        for target, conversion in signal.targets:
            if target not in cut:
                sources[target] = signal.port
                conversions |= {} if conversion.changes_nothing else {target: conversion}
    order = wiring.stepping if scheme == "gauss-seidel" else tuple(instances)
    groups = [(name,) for name in order] if scheme == "gauss-seidel" else [order]
    wires = _Wires(instances, sources, conversions)
    members = ([instances[name] for name in group] for group in groups)
    stages = tuple(wires.make_stage(group, rows, now, step) for group in members)
    return Plan(stages, now, step, tuple(signals))


class _Wires:
    """Where the inputs of the instances come from, and what happens to the values."""

    def __init__(
        self,
        instances: Mapping[str, FmuInstance],
        sources: Mapping[PortName, PortName],
        conversions: Mapping[PortName, Conversion],
    ) -> None:
        self.instances, self.sources, self.conversions = instances, sources, conversions
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
        gathers, sets, gets = [], [], []
        for kind in (rows.real, rows.discrete):
            # One buffer for all of them: to gather 21 numbers costs 0.25 us, twice 10 costs 0.4.
            wired = [p for i in stepped for p in self.inputs[i.name] if self.sources[p] in kind.places]
            places = {port: place for place, port in enumerate(wired)}
            inputs = np.zeros(len(wired), kind.values.dtype)
            if wired:
                taken = np.array([kind.places[self.sources[p]] for p in wired])
                gathers.append(Gather(kind.values, taken, inputs, self.make_conversion(wired, inputs)))
            wired_of, outputs_of = _group(wired), _group(kind.places)
            for instance in stepped:
                runs = _find_runs(instance, wired_of.get(instance.name, ()), places.__getitem__)
                sets += [_make_access(instance, "Set", run, inputs, places.__getitem__) for run in runs]
                gets += [
                    _make_access(instance, "Get", run, kind.values, kind.places.__getitem__)
                    for run in _find_runs(instance, outputs_of.get(instance.name, ()), kind.places.__getitem__)
                ]
        # noSetFMUStatePriorToCurrentPoint is true as in other tools, although steps may be repeated from a state: some
        # FMUs take false for "make the last step again".
        rest = _double(step), _boolean(True)
        steps = [Call(i, "fmi2DoStep", *_bind(i, i.stepper(), now, *rest)) for i in stepped]
        return Stage(tuple(gathers), (*sets, *steps, *gets), tuple(self.list_moves(stepped)))

    def make_conversion(self, wired: Sequence[PortName], inputs: NDArray[Any]) -> Callable[[], None] | None:
        """What changes the inputs that have conversions, in place; None where none has."""
        found = [(place, self.conversions[port]) for place, port in enumerate(wired) if port in self.conversions]
        if not found:
            return None
        if inputs.dtype != np.float64:
            tables = [(place, conversion.apply) for place, conversion in found]

            def look_up() -> None:
                for place, apply in tables:
                    inputs[place] = apply(int(inputs[place]))

            return look_up
        places = np.array([place for place, _ in found])
        factors = np.array([conversion.factor for _, conversion in found])
        offsets = np.array([conversion.offset for _, conversion in found])

        def scale() -> None:
            inputs[places] = inputs[places] * factors + offsets

        return scale

    def list_moves(self, stepped: Sequence[FmuInstance]) -> list[Move]:
        """The connections of Strings to some instances."""
        return [
            Move(self.instances[source.component], source.variable, instance, port.variable)
            for instance in stepped
            for port in self.inputs[instance.name]
            if (source := self.sources[port]).component and instance.variables[port.variable].type == "String"
        ]


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
