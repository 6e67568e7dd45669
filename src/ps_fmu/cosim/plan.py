"""One communication step as data: what is copied where, and which library function gets which addresses.

The plan is made once and executed by a short loop (:mod:`.loops`), which may be replaced by a compiled one:
all it needs are the index arrays and the addresses in here.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from ctypes import c_size_t, c_void_p
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .graph import Wiring
from .rows import Array, Layout
from .slaves import FAMILY, Slave
from .structure import Port

ITEM_BYTES = {"Real": 8, "Integer": 4, "Boolean": 4}


@dataclass(frozen=True)
class Access:
    """One fmi2Set... or fmi2Get... call: function, instance, references, and where the values are.

    ``place`` is an address (inputs) or the number of bytes from the start of a row (outputs).
    """

    slave: Slave
    function_name: str
    function: Any
    instance: c_void_p
    references: NDArray[np.uint32]
    place: int
    names: tuple[str, ...]

    def arguments(self) -> tuple[Any, c_void_p, c_void_p, c_size_t]:
        """Function and its arguments up to the place of the values."""
        references = c_void_p(self.references.ctypes.data)
        return self.function, self.instance, references, c_size_t(len(self.names))

    def check(self, status: int, time: float) -> None:
        """Count a warning, raise :class:`SlaveError` on anything worse."""
        self.slave.check(self.function_name, status, time, self.names)


@dataclass(frozen=True)
class Stage:
    """One FMU in the step: its part of the input buffers, the calls before and after fmi2DoStep."""

    slave: Slave
    step: Any
    instance: c_void_p
    real: slice
    discrete: slice
    sets: tuple[Access, ...]
    real_gets: tuple[Access, ...]
    discrete_gets: tuple[Access, ...]


@dataclass(frozen=True)
class Plan:
    """Stages in stepping order; inputs[i] comes from column sources[i], for reals and for discretes."""

    stages: tuple[Stage, ...]
    real_sources: NDArray[np.intp]
    real_inputs: Array
    discrete_sources: NDArray[np.intp]
    discrete_inputs: NDArray[np.int32]


def make_plan(
    slaves: Mapping[str, Slave], wiring: Wiring, layout: Layout, order: Sequence[str], cut: Collection[Port]
) -> Plan:
    """Plan of one step.

    Parameters
    ----------
    slaves: loaded FMUs by component
    wiring, layout: connections and places of the outputs
    order: components in the order of stepping
    cut: connected inputs that the user has set: they keep that value
    """
    sources = {c.target: c.source for c in wiring.connections if c.target not in cut}
    wired = {name: _by_family(slaves[name], [p for p in sources if p.component == name]) for name in order}
    n_real = sum(len(w.get("Real", ())) for w in wired.values())
    n_discrete = sum(len(ports) for w in wired.values() for family, ports in w.items() if family != "Real")
    real_inputs = np.zeros(n_real)
    discrete_inputs = np.zeros(n_discrete, dtype=np.int32)
    real_sources: list[int] = []
    discrete_sources: list[int] = []
    stages = []
    for name in order:
        slave = slaves[name]
        starts = len(real_sources), len(discrete_sources)
        sets = []
        for family, ports in wired[name].items():
            buffer, taken = (
                (real_inputs, real_sources) if family == "Real" else (discrete_inputs, discrete_sources)
            )
            places = layout.real if family == "Real" else layout.discrete
            address = buffer.ctypes.data + len(taken) * ITEM_BYTES[family]
            sets.append(_access(slave, "Set", family, ports, address))
            taken += [places[sources[port]] for port in ports]
        outputs = _by_family(slave, [p for p in (*layout.real, *layout.discrete) if p.component == name])
        gets = {family: _gets(slave, family, ports, layout) for family, ports in outputs.items()}
        stages.append(
            Stage(
                slave,
                slave.stepper(),
                c_void_p(slave.address),
                slice(starts[0], len(real_sources)),
                slice(starts[1], len(discrete_sources)),
                tuple(sets),
                gets.pop("Real", ()),
                tuple(access for group in gets.values() for access in group),
            )
        )
    return Plan(
        tuple(stages),
        np.array(real_sources, dtype=np.intp),
        real_inputs,
        np.array(discrete_sources, dtype=np.intp),
        discrete_inputs,
    )


def _by_family(slave: Slave, ports: Sequence[Port]) -> dict[str, list[Port]]:
    """Ports by access function, in their given order."""
    families: dict[str, list[Port]] = {}
    for port in ports:
        families.setdefault(FAMILY[slave.variables[port.variable].type], []).append(port)
    return families


def _gets(slave: Slave, family: str, ports: Sequence[Port], layout: Layout) -> tuple[Access, ...]:
    """One call per run of neighbouring columns (Integers and Booleans may alternate)."""
    places = layout.real if family == "Real" else layout.discrete
    runs: list[list[Port]] = []
    for port in ports:
        if runs and places[port] == places[runs[-1][-1]] + 1:
            runs[-1].append(port)
        else:
            runs.append([port])
    return tuple(_access(slave, "Get", family, run, places[run[0]] * ITEM_BYTES[family]) for run in runs)


def _access(slave: Slave, verb: str, family: str, ports: Sequence[Port], place: int) -> Access:
    names = tuple(port.variable for port in ports)
    references = np.array([slave.variables[name].valueReference for name in names], dtype=np.uint32)
    function = f"fmi2{verb}{family}"
    return Access(slave, function, slave.access(function), c_void_p(slave.address), references, place, names)
