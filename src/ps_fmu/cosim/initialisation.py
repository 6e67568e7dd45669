"""Bring all FMUs of a system to their first communication point, with initial values that agree."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Collection, Mapping, Sequence

import numpy as np
from fmpy.model_description import ModelDescription

from .fmu_instance import FmuInstance
from .graph import Wiring
from .rows import InputSignal, Rows
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
        values = dict(wiring.starts[component.name])
        values |= {port.variable: value for port, value in given.items() if port.component == component.name}
        instance = instances[component.name]
        instance.set_up(start)
        instance.set(values, start)
        instance.enter_initialisation(start)
    _propagate(instances, wiring, given.keys(), start)
    for instance in instances.values():
        instance.exit_initialisation(start)


def read_first_row(
    instances: Mapping[str, FmuInstance],
    rows: Rows,
    start: float,
    signals: Sequence[InputSignal] = (),
    step: float = 0.0,
) -> None:
    """Read all outputs into the first row of the block, and the inputs of the run.  Raises :class:`SlaveError`."""
    for kind in (rows.real, rows.discrete):
        for port, place in kind.places.items():
            if port.component:
                kind.values[place] = instances[port.component].get([port.variable], start)[port.variable]
    for signal in signals:
        values, place = rows.find_place(signal.port)
        values[place] = signal.sample(np.array([start]), step)[0]
    rows.store_latest()


def _propagate(instances: Mapping[str, FmuInstance], wiring: Wiring, cut: Collection[PortName], start: float) -> None:
    """In the order that the FMUs' dependencies give; round a loop as often as there are FMUs."""
    carried: dict[PortName, list[PortName]] = {}
    for connection in wiring.connections:
        if connection.target not in cut:
            carried.setdefault(connection.source, []).append(connection.target)
    for group in wiring.order:
        values: dict[PortName, Value] = {}
        before = values
        for _ in range(group.passes):
            before = values
            values = _read_outputs(instances, group.outputs, start)
            if values == before:  # to the last bit: another pass would set what the inputs have already
                break
            passed: dict[str, dict[str, Value]] = {}
            for source, value in values.items():
                for target in carried.get(source, ()):
                    conversion = wiring.conversions.get(target)
                    value_there = value if conversion is None else conversion.apply(value)
                    passed.setdefault(target.component, {})[target.variable] = value_there
            for name, inputs in passed.items():
                instances[name].set(inputs, start)
        moving = [str(p) for p, value in values.items() if p in before and not _is_settled(value, before[p])]
        if moving:
            log.warning("initial values in a loop still change after %d passes: %s", group.passes, ", ".join(moving))


def _read_outputs(
    instances: Mapping[str, FmuInstance], ports: Collection[PortName], start: float
) -> dict[PortName, Value]:
    """Outputs of some components, in as few calls as there are components: a ring of 64 FMUs is passed 64 times."""
    names: dict[str, list[str]] = {}
    for port in ports:
        names.setdefault(port.component, []).append(port.variable)
    found = {component: instances[component].get(own, start) for component, own in names.items()}
    return {port: found[port.component][port.variable] for port in ports}


def _is_settled(value: Value, other: Value) -> bool:
    if isinstance(value, str) or isinstance(other, str):
        return value == other
    return math.isclose(value, other, rel_tol=SETTLED, abs_tol=SETTLED)
