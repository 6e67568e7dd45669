"""Parameter dataclasses as flat lists of named scalars, and back.

The names are those of the FMI parameters: dotted, without brackets.  A tuple ``fine_legs`` becomes ``fine_leg_1``,
``fine_leg_2`` ..., a vector ``com_P`` becomes ``com.x``, ``com.y``, ``com.z`` (the frame is in the description),
a symmetric matrix its upper triangle ``inertia.xx``, ``inertia.xy`` ...
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, is_dataclass, replace
from typing import Any, TypeVar

import numpy as np

from .parameters import ParameterError

T = TypeVar("T")

AXES = ("x", "y", "z")
WRENCH_AXES = ("fx", "fy", "fz", "tx", "ty", "tz")
TWIST_AXES = ("tx", "ty", "tz", "rx", "ry", "rz")


@dataclass(frozen=True)
class Entry:
    """One scalar of a parameter set."""

    name: str
    value: float | bool | int | str
    unit: str
    description: str
    minimum: float | None = None
    """Smallest value, or a bound that the value must be above."""
    maximum: float | None = None
    display: str | None = None
    """Unit to display it in."""


def entries(obj: Any, prefix: str = "", keep: Callable[[str], bool] | None = None) -> list[Entry]:
    """All scalars of a parameter dataclass, in the order of its fields.

    Parameters
    ----------
    obj: one of the dataclasses of :mod:`.parameters` (any nesting).
    prefix: put before every name, for example ``"payload"``.
    keep: only the names for which it is true.
    """
    found: list[Entry] = []
    for f in fields(obj):
        value, name = getattr(obj, f.name), _join(prefix, _public(f.name))
        unit, text = f.metadata.get("unit", ""), f.metadata.get("description", "")
        if is_dataclass(value):
            found += entries(value, name)
        elif isinstance(value, tuple):
            for i, item in enumerate(value, 1):
                found += entries(item, f"{_singular(name)}_{i}")
        elif isinstance(value, np.ndarray):
            found += [
                Entry(
                    f"{name}.{suffix}",
                    float(value[index]),
                    _unit(unit, index, value.ndim),
                    f"{text} ({suffix})",
                )
                for suffix, index in _components(f.name, value)
            ]
        else:
            bounds, display = f.metadata["bounds"], f.metadata["display"]
            minimum = bounds["above"] if bounds["at_least"] is None else bounds["at_least"]
            found.append(Entry(name, value, unit, text, minimum, bounds["at_most"], display))
    return found if keep is None else [e for e in found if keep(e.name)]


def with_values(obj: T, values: Mapping[str, Any], prefix: str = "") -> T:
    """A copy of ``obj`` with some scalars replaced; the copy checks itself as any other.

    Raises
    ------
    ParameterError: a name does not exist, or a value is impossible; the text starts with the full name.
    """
    known = {e.name for e in entries(obj, prefix)}
    for name in values:
        if name not in known:
            raise ParameterError(name, "no such parameter")
    return _replaced(obj, values, prefix)


def taken_from(obj: T, values: Mapping[str, Any], prefix: str = "") -> T:
    """As :func:`with_values`, but for a mapping that also holds other things' values: they are passed over."""
    known = [e.name for e in entries(obj, prefix)]
    return with_values(obj, {name: values[name] for name in known if name in values}, prefix)


def _replaced(obj: Any, values: Mapping[str, Any], prefix: str) -> Any:
    changes: dict[str, Any] = {}
    for f in fields(obj):
        value, name = getattr(obj, f.name), _join(prefix, _public(f.name))
        if is_dataclass(value):
            changes[f.name] = _replaced(value, values, name)
        elif isinstance(value, tuple):
            changes[f.name] = tuple(
                _replaced(item, values, f"{_singular(name)}_{i}") for i, item in enumerate(value, 1)
            )
        elif isinstance(value, np.ndarray):
            array = value.copy()
            for suffix, index in _components(f.name, value):
                array[index] = values.get(f"{name}.{suffix}", array[index])
                array[index[::-1]] = array[index]
            changes[f.name] = array
        else:
            changes[f.name] = values.get(name, value)
    try:
        return replace(obj, **changes)
    except ParameterError as error:
        raise ParameterError(_join(prefix, error.name), error.problem) from None


def _components(field_name: str, value: Any) -> list[tuple[str, tuple[int, ...]]]:
    """(suffix, index) of each independent component of an array field."""
    if value.ndim == 2:
        axes = AXES if value.shape[0] == 3 else WRENCH_AXES
        separator = "" if value.shape[0] == 3 else "_"
        n = value.shape[0]
        return [(f"{axes[i]}{separator}{axes[j]}", (i, j)) for i in range(n) for j in range(i, n)]
    names = {2: ("min", "max"), 3: AXES, 6: TWIST_AXES}[value.shape[0]]
    return [(suffix, (i,)) for i, suffix in enumerate(names)]


def _unit(unit: str, index: tuple[int, ...], ndim: int) -> str:
    """Mixed arrays list their units as ``translation|rotation`` (or ``force2|force.torque|torque2``)."""
    choices = unit.split("|")
    return choices[0] if len(choices) == 1 else choices[sum(i >= 3 for i in index)]


def _public(name: str) -> str:
    return name[:-2] if name.endswith(("_B", "_P")) else name


def _singular(name: str) -> str:
    return name.removesuffix("s")


def _join(prefix: str, name: str) -> str:
    return f"{prefix}.{name}" if prefix else name
