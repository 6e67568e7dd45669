"""FMI parameters made from the parameter dataclasses: the identified value is the start value."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterable
from typing import Any, TypeVar

from ..mechanism.parameters import ParameterError
from ..mechanism.quantities import Entry
from ..slavekit.author.guard import ModelError
from ..slavekit.author.variables import Port, Type

F = TypeVar("F", bound=Callable[..., Any])

_DISPLAY = {"rad": "deg"}
_TYPES: dict[type, Type] = {bool: "Boolean", int: "Integer", str: "String"}


def parameter_ports(entries: Iterable[Entry]) -> tuple[Port, ...]:
    """One parameter port per entry of :func:`ps_fmu.mechanism.quantities.list_entries`, of the type of its value."""
    ports = []
    for entry in entries:
        kind = _TYPES.get(type(entry.value))
        if kind is not None:
            ports.append(
                Port(
                    entry.name,
                    "parameter",
                    type=kind,
                    start=entry.value,
                    description=entry.description,
                    min=entry.minimum,
                    max=entry.maximum,
                )
            )
        else:
            ports.append(
                Port(
                    entry.name,
                    "parameter",
                    entry.unit,
                    entry.description,
                    start=entry.value,
                    min=entry.minimum,
                    max=entry.maximum,
                    display_unit=entry.display or _DISPLAY.get(entry.unit),
                )
            )
    return tuple(ports)


def refuses_parameters(method: F) -> F:
    """For methods of models: their ParameterError, which names the parameter, becomes a ModelError, a refusal."""

    @functools.wraps(method)
    def wrapper(self: Any, *args: Any) -> Any:
        try:
            return method(self, *args)
        except ParameterError as error:
            raise ModelError(str(error)) from None

    return wrapper  # type: ignore[return-value]
