"""FMI parameters made from the parameter dataclasses: the identified value is the start value."""

from __future__ import annotations

from collections.abc import Iterable

from ..manipulator.flat import Entry
from .variables import Port

_DISPLAY = {"rad": "deg"}


def parameter_ports(entries: Iterable[Entry]) -> tuple[Port, ...]:
    """One parameter port per entry of :func:`ps_fmu.manipulator.flat.entries`; whole numbers become Integers."""
    ports = []
    for entry in entries:
        if isinstance(entry.value, int):
            ports.append(Port(entry.name, "parameter", type="Integer", start=entry.value, description=entry.description))
        else:
            ports.append(
                Port(
                    entry.name, "parameter", entry.unit, entry.description, start=entry.value,
                    display_unit=_DISPLAY.get(entry.unit),
                )
            )
    return tuple(ports)
