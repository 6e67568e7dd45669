"""One communication step as data: what is copied where, and which library function gets which arguments.

The plan is made once and executed by a short loop, in Python (:mod:`.loops`) or in C (:mod:`.compiled`): the index
arrays, the addresses and the constants in here are all that either needs.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from ctypes import CFUNCTYPE, PYFUNCTYPE, c_double, c_int, c_size_t, c_void_p, cast
from dataclasses import dataclass
from functools import partial
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from .fmu_instance import FAMILY, FmuInstance
from .graph import Wiring
from .guard import End
from .rows import Rows
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
    fmi2DoStep has made, ``repeatable`` that this fmi2DoStep may be made again from a state before it.  To set or get,
    it takes the addresses of the value references and of the first of the ``values``, as many of each as there are
    names.
    """

    instance: FmuInstance
    function: str
    invoke: Callable[[], int]
    address: int
    names: tuple[str, ...] = ()
    references: NDArray[np.uint32] | None = None
    values: NDArray[Any] | None = None
    later: bool = False
    repeatable: bool = False

    def check(self, status: int, time: float, step: float) -> None:
        """Count a warning in the step from ``time`` on [s], raise :class:`SlaveError` on anything worse."""
        self.instance.check(self.function, status, time + step if self.later else time, self.names)

    def give_up(self, end: End, time: float, step: float) -> NoReturn:
        """Raise what a call means that did not return in the step from ``time`` on [s]."""
        self.instance.give_up(self.function, end, time + step if self.later else time)


@dataclass(frozen=True)
class Gather:
    """``inputs[i] = outputs[sources[i]]``: what the connections carry, for one kind of numbers."""

    outputs: NDArray[Any]
    sources: NDArray[np.intp]
    inputs: NDArray[Any]


@dataclass(frozen=True)
class Stage:
    """A part of a step: first all that is gathered, then the calls in their order."""

    gathers: tuple[Gather, ...]
    calls: tuple[Call, ...]


@dataclass(frozen=True)
class Plan:
    """The stages of a step.  ``now`` [s], where it begins, is an argument of every fmi2DoStep."""

    stages: tuple[Stage, ...]
    now: c_double
    step: float


def make_plan(
    instances: Mapping[str, FmuInstance],
    wiring: Wiring,
    rows: Rows,
    step: float,
    scheme: str,
    cut: Collection[PortName],
    repeatable: bool = False,
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
    repeatable: FMUs may be set back to a state from before the step, so they are told to keep what that needs
    """
    now = c_double()
    sources = {c.target: c.source for c in wiring.connections if c.target not in cut}
    order = wiring.stepping if scheme == "gauss-seidel" else tuple(instances)
    groups = [(name,) for name in order] if scheme == "gauss-seidel" else [order]
    members = ([instances[name] for name in group] for group in groups)
    return Plan(tuple(_make_stage(group, sources, rows, now, step, repeatable) for group in members), now, step)


def _make_stage(
    instances: Sequence[FmuInstance],
    sources: Mapping[PortName, PortName],
    rows: Rows,
    now: c_double,
    step: float,
    repeatable: bool,
) -> Stage:
    """The part of a step that some FMUs go through together."""
    gathers, sets, gets = [], [], []
    for kind in (rows.real, rows.discrete):
        # One buffer for all of them: to gather 21 numbers costs 0.25 us, twice 10 costs 0.4.
        wired = [p for instance in instances for p in _list_inputs(instance, sources) if sources[p] in kind.places]
        inputs = np.zeros(len(wired), kind.values.dtype)
        if wired:
            gathers.append(Gather(kind.values, np.array([kind.places[sources[p]] for p in wired]), inputs))
        for instance in instances:
            runs = _find_runs(instance, wired, wired.index)
            sets += [_make_access(instance, "Set", run, inputs, wired.index) for run in runs]
            outputs = list(kind.places)
            gets += [
                _make_access(instance, "Get", run, kind.values, kind.places.__getitem__)
                for run in _find_runs(instance, outputs, kind.places.__getitem__)
            ]
    rest = _double(step), _boolean(not repeatable)  # noSetFMUStatePriorToCurrentPoint
    steps = [
        Call(instance, "fmi2DoStep", *_bind(instance, instance.stepper(), now, *rest), repeatable=repeatable)
        for instance in instances
    ]
    return Stage(tuple(gathers), (*sets, *steps, *gets))


def _list_inputs(instance: FmuInstance, sources: Mapping[PortName, PortName]) -> list[PortName]:
    """An instance's connected inputs, by value reference: FMUs that store them in that order copy longer runs."""
    own = [port for port in sources if port.component == instance.name]
    return sorted(own, key=lambda port: instance.variables[port.variable].valueReference)


def _find_runs(
    instance: FmuInstance, ports: Sequence[PortName], place: Callable[[PortName], int]
) -> list[list[PortName]]:
    """An instance's own ports, cut so that one call does for each: one access function, neighbouring places."""
    runs: list[list[PortName]] = []
    for port in ports:
        if port.component != instance.name:
            continue
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
