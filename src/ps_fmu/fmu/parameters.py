"""FMI parameters made from the parameter dataclasses: the identified value is the start value."""

from __future__ import annotations

from collections.abc import Iterable

from ..manipulator.flat import Entry
from .variables import Port, Type

_DISPLAY = {"rad": "deg"}
_TYPES: dict[type, Type] = {bool: "Boolean", int: "Integer", str: "String"}


def parameter_ports(entries: Iterable[Entry]) -> tuple[Port, ...]:
    """One parameter port per entry of :func:`ps_fmu.manipulator.flat.entries`, of the type of its value."""
    ports = []
    for entry in entries:
        kind = _TYPES.get(type(entry.value))
        if kind is not None:
            ports.append(Port(entry.name, "parameter", type=kind, start=entry.value, description=entry.description))
        else:
            ports.append(
                Port(
                    entry.name,
                    "parameter",
                    entry.unit,
                    entry.description,
                    start=entry.value,
                    display_unit=_DISPLAY.get(entry.unit),
                )
            )
    return tuple(ports)
