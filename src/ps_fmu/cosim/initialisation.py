"""Bring all FMUs of a system to their first communication point, with initial values that agree."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Collection, Mapping

from fmpy.model_description import ModelDescription

from .fmu_instance import FmuInstance
from .graph import Wiring
from .rows import Rows
from .structure import Component, PortName, System, Value

log = logging.getLogger("ps_fmu.cosim")

SETTLED = 1e-9
"""A value of a loop that changes less in the last pass, absolutely or relatively, has settled."""


def load(
    system: System,
    descriptions: Mapping[str, ModelDescription],
    instances: dict[str, FmuInstance],
    make: Callable[[Component, ModelDescription], FmuInstance] = FmuInstance,
) -> None:
    """Unpack and instantiate each component; what is loaded is in ``instances`` also when a later one fails.

    ``make`` loads one.

    Raises :class:`SystemFileError` or :class:`SlaveError`.
    """
    with system.name_members():
        for component in system.components:
            instances[component.name] = make(component, descriptions[component.name])


def initialise(
    instances: Mapping[str, FmuInstance], system: System, wiring: Wiring, given: Mapping[PortName, Value], start: float
) -> None:
    """Set start values, and pass the initial values along the connections.

    ``given`` are values that the user has set: they outrank those of the system, and a connected input among
    them is left alone.  Raises :class:`SlaveError`.
    """
    for component in system.components:
        values = {name: parameter.value for name, parameter in component.parameters.items()}
        values |= {port.variable: value for port, value in given.items() if port.component == component.name}
        instance = instances[component.name]
        instance.set_up(start)
        instance.set(values, start)
        instance.enter_initialisation(start)
    _propagate(instances, wiring, given.keys(), start)
    for instance in instances.values():
        instance.exit_initialisation(start)


def read_first_row(instances: Mapping[str, FmuInstance], rows: Rows, start: float) -> None:
    """Read all outputs into the first row of the block.  Raises :class:`SlaveError`."""
    for kind in (rows.real, rows.discrete):
        for port, place in kind.places.items():
            kind.values[place] = instances[port.component].get([port.variable], start)[port.variable]
    rows.store_latest()


def _propagate(instances: Mapping[str, FmuInstance], wiring: Wiring, cut: Collection[PortName], start: float) -> None:
    """In the order that the FMUs' dependencies give; round a loop as often as there are FMUs."""
    for group in wiring.order:
        connections = [c for c in wiring.connections if c.source in group.outputs and c.target not in cut]
        values: dict[PortName, Value] = {}
        before = values
        for _ in range(group.passes):
            before = values
            values = {p: instances[p.component].get([p.variable], start)[p.variable] for p in group.outputs}
            for c in connections:
                instances[c.target.component].set({c.target.variable: values[c.source]}, start)
        moving = [str(p) for p, value in values.items() if p in before and not _is_settled(value, before[p])]
        if moving:
            log.warning("initial values in a loop still change after %d passes: %s", group.passes, ", ".join(moving))


def _is_settled(value: Value, other: Value) -> bool:
    if isinstance(value, str) or isinstance(other, str):
        return value == other
    return math.isclose(value, other, rel_tol=SETTLED, abs_tol=SETTLED)
