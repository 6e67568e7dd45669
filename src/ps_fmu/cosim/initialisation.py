"""Bring all FMUs of a system to their first communication point, with initial values that agree."""

from __future__ import annotations

import logging
import math
from collections.abc import Collection, Mapping
from pathlib import Path

from fmpy.model_description import ModelDescription

from .graph import Wiring
from .rows import Rows
from .slaves import Slave
from .structure import Port, System, Value

log = logging.getLogger("ps_fmu.cosim")

SETTLED = 1e-9
"""A value of a loop that changes less in the last pass, absolutely or relatively, has settled."""


def load(
    system: System, descriptions: Mapping[str, ModelDescription], folder: Path, slaves: dict[str, Slave]
) -> None:
    """Unpack and instantiate each component; what is loaded is in ``slaves`` also when a later one fails.

    Raises :class:`SystemFileError` or :class:`SlaveError`.
    """
    with system.name_members():
        for component in system.components:
            slaves[component.name] = Slave(component, descriptions[component.name], folder / component.name)


def initialise(
    slaves: Mapping[str, Slave], system: System, wiring: Wiring, given: Mapping[Port, Value], start: float
) -> None:
    """Set start values, and pass the initial values along the connections.

    ``given`` are values that the user has set: they outrank those of the system, and a connected input among
    them is left alone.  Raises :class:`SlaveError`.
    """
    for component in system.components:
        values = {name: parameter.value for name, parameter in component.parameters.items()}
        values |= {port.variable: value for port, value in given.items() if port.component == component.name}
        slave = slaves[component.name]
        slave.set_up(start)
        slave.set(values, start)
        slave.enter_initialisation(start)
    _propagate(slaves, wiring, given.keys(), start)
    for slave in slaves.values():
        slave.exit_initialisation(start)


def first_row(slaves: Mapping[str, Slave], rows: Rows, start: float) -> None:
    """Read all outputs into the first row of the block.  Raises :class:`SlaveError`."""
    for kind in (rows.real, rows.discrete):
        for port, place in kind.places.items():
            kind.values[place] = slaves[port.component].get([port.variable], start)[port.variable]
    rows.store_latest()


def _propagate(slaves: Mapping[str, Slave], wiring: Wiring, cut: Collection[Port], start: float) -> None:
    """In the order that the FMUs' dependencies give; round a loop as often as there are FMUs."""
    for group in wiring.order:
        connections = [c for c in wiring.connections if c.source in group.outputs and c.target not in cut]
        values: dict[Port, Value] = {}
        before = values
        for _ in range(group.passes):
            before = values
            values = {p: slaves[p.component].get([p.variable], start)[p.variable] for p in group.outputs}
            for c in connections:
                slaves[c.target.component].set({c.target.variable: values[c.source]}, start)
        moving = [str(p) for p, value in values.items() if p in before and not _equal(value, before[p])]
        if moving:
            log.warning(
                "initial values in a loop still change after %d passes: %s", group.passes, ", ".join(moving)
            )


def _equal(value: Value, other: Value) -> bool:
    if isinstance(value, str) or isinstance(other, str):
        return value == other
    return math.isclose(value, other, rel_tol=SETTLED, abs_tol=SETTLED)
