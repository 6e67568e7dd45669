"""One communication step as data: what is copied where, and which library function gets which arguments.

The plan is made once and executed by a short loop, in Python (:mod:`.loops`) or in C (:mod:`.compiled`): the index
arrays, the addresses and the constants in here are all that either needs.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from ctypes import CFUNCTYPE, PYFUNCTYPE, c_double, c_int, c_size_t, c_void_p, cast
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .graph import Wiring
from .rows import Rows
from .slaves import FAMILY, Slave
from .structure import Port

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

    slave: Slave
    function: str
    invoke: Callable[[], int]
    address: int
    names: tuple[str, ...] = ()
    references: NDArray[np.uint32] | None = None
    values: NDArray[Any] | None = None
    later: bool = False

    def check(self, status: int, time: float, step: float) -> None:
        """Count a warning in the step from ``time`` on [s], raise :class:`SlaveError` on anything worse."""
        self.slave.check(self.function, status, time + step if self.later else time, self.names)


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
    slaves: Mapping[str, Slave], wiring: Wiring, rows: Rows, step: float, scheme: str, cut: Collection[Port]
) -> Plan:
    """Plan of one step.

    Parameters
    ----------
    slaves: loaded FMUs by component
    wiring: connections, and the order of stepping for Gauss-Seidel
    rows: where the outputs go
    step: communication step [s]
    scheme: ``"jacobi"``: all FMUs see the outputs of the last communication point, so there is one stage;
        ``"gauss-seidel"``: each sees what those stepped before it have just put out, so each is a stage
    cut: connected inputs that the user has set: they keep that value
    """
    now = c_double()
    sources = {c.target: c.source for c in wiring.connections if c.target not in cut}
    order = wiring.stepping if scheme == "gauss-seidel" else tuple(slaves)
    groups = [(name,) for name in order] if scheme == "gauss-seidel" else [order]
    return Plan(
        tuple(_stage([slaves[name] for name in group], sources, rows, now, step) for group in groups),
        now,
        step,
    )


def _stage(slaves: Sequence[Slave], sources: Mapping[Port, Port], rows: Rows, now: c_double, step: float) -> Stage:
    """The part of a step that some FMUs go through together."""
    gathers, sets, gets = [], [], []
    for kind in (rows.real, rows.discrete):
        # One buffer for all of them: to gather 21 numbers costs 0.25 us, twice 10 costs 0.4.
        wired = [p for slave in slaves for p in _inputs(slave, sources) if sources[p] in kind.places]
        inputs = np.zeros(len(wired), kind.values.dtype)
        if wired:
            gathers.append(Gather(kind.values, np.array([kind.places[sources[p]] for p in wired]), inputs))
        for slave in slaves:
            sets += [_access(slave, "Set", run, inputs, wired.index) for run in _runs(slave, wired, wired.index)]
            outputs = list(kind.places)
            gets += [
                _access(slave, "Get", run, kind.values, kind.places.__getitem__)
                for run in _runs(slave, outputs, kind.places.__getitem__)
            ]
    # noSetFMUStatePriorToCurrentPoint is true: no step is ever repeated.
    rest = _double(step), _boolean(1)
    steps = [Call(slave, "fmi2DoStep", *_bound(slave, slave.stepper(), now, *rest)) for slave in slaves]
    return Stage(tuple(gathers), (*sets, *steps, *gets))


def _inputs(slave: Slave, sources: Mapping[Port, Port]) -> list[Port]:
    """A slave's connected inputs, by value reference: FMUs that store them in that order copy longer runs."""
    own = [port for port in sources if port.component == slave.name]
    return sorted(own, key=lambda port: slave.variables[port.variable].valueReference)


def _runs(slave: Slave, ports: Sequence[Port], place: Callable[[Port], int]) -> list[list[Port]]:
    """A slave's own ports, cut so that one call does for each: one access function, neighbouring places."""
    runs: list[list[Port]] = []
    for port in ports:
        if port.component != slave.name:
            continue
        last = runs[-1][-1] if runs else None
        if last is not None and _family(slave, port) == _family(slave, last) and place(port) == place(last) + 1:
            runs[-1].append(port)
        else:
            runs.append([port])
    return runs


def _family(slave: Slave, port: Port) -> str:
    return FAMILY[slave.variables[port.variable].type]


def _access(slave: Slave, verb: str, ports: Sequence[Port], array: NDArray[Any], place: Callable[[Port], int]) -> Call:
    """fmi2Set... or fmi2Get... of neighbours in an array."""
    function = f"fmi2{verb}{_family(slave, ports[0])}"
    names = tuple(port.variable for port in ports)
    references = np.array([slave.variables[name].valueReference for name in names], dtype=np.uint32)
    values = array[place(ports[0]) :]
    arguments = _pointer(references.ctypes.data), _size(len(names)), _pointer(values.ctypes.data)
    bound = _bound(slave, slave.access(function), *arguments)
    return Call(slave, function, *bound, names, references, values, later=verb == "Get")


def _bound(slave: Slave, function: Any, *arguments: Any) -> tuple[Callable[[], int], int]:
    """A function of the library, the instance and the other arguments as a function of nothing; its address."""
    prototype = _CONVERTED_LOCKED if slave.runs_python else _CONVERTED
    invoke = partial(cast(function, prototype), _pointer(slave.address), *arguments)
    return invoke, cast(function, c_void_p).value or 0
