"""Units of SSP and FMI: a name, and what it means in SI base units (SSP 1.0, section 4.4; FMI 2.0.4, section 2.2.2).

A value ``v`` in a unit is ``factor * v + offset`` in SI base units.
"""

from __future__ import annotations

import math
from pathlib import Path

from fmpy.model_description import ModelDescription, ModelVariable

from .description import get_unit
from .errors import SystemFileError
from .hops import EXPONENTS, Unit
from .values import parse_real
from .xmlfile import Element


def read_units(group: Element | None, path: Path) -> dict[str, Unit]:
    """The units of an ``ssd:Units``, ``ssv:Units`` or ``ssb:Units``.

    Raises :class:`SystemFileError` with the line: no name, no base unit, a number that is none, a factor of zero.
    """
    units = {}
    for element in group.children if group is not None else ():
        name, base = element.attributes.get("name"), element.find("ssc:BaseUnit")
        if name is None or base is None:
            raise SystemFileError(path, "a unit needs a name and an ssc:BaseUnit", element.line)
        numbers = {key: _read_number(base, key, path) for key in (*EXPONENTS, "factor", "offset")}
        factor = 1.0 if numbers["factor"] is None else numbers["factor"]
        if factor == 0.0:
            raise SystemFileError(path, f"unit {name!r}: the factor must not be zero", base.line)
        units[name] = Unit(name, tuple(numbers[key] or 0.0 for key in EXPONENTS), factor, numbers["offset"] or 0.0)
    return units


def find_fmu_unit(variable: ModelVariable, description: ModelDescription) -> Unit | None:
    """The unit of a variable as its FMU defines it; None where the FMU states none."""
    name = get_unit(variable) if variable.type == "Real" else None
    if name is None:
        return None
    for unit in description.unitDefinitions:
        if unit.name == name and unit.baseUnit is not None:
            base = unit.baseUnit
            return Unit(name, tuple(float(getattr(base, key)) for key in EXPONENTS), base.factor, base.offset)
    return Unit(name)


def are_equal(one: Unit, other: Unit) -> bool:
    """Whether two units mean the same: by their definitions, and by name where one has none."""
    if one.exponents is None or other.exponents is None:
        return one.name == other.name
    return (one.exponents, one.factor, one.offset) == (other.exponents, other.factor, other.offset)


def find_conversion(start: Unit | None, end: Unit | None) -> tuple[float, float]:
    """Factor and offset that turn a value in ``start`` into one in ``end``; a unit that nobody states is the other's.

    Raises ValueError: two names of which one has no definition, other dimensions, or a factor that cannot be used.
    """
    if start is None or end is None or are_equal(start, end):
        return 1.0, 0.0
    if start.exponents is None or end.exponents is None:
        unknown = start if start.exponents is None else end
        raise ValueError(f"the units differ, {start.name!r} and {end.name!r}, and nobody defines {unknown.name!r}")
    if start.exponents != end.exponents:
        raise ValueError(f"the units differ in their dimensions, {start.name!r} and {end.name!r}")
    for unit in (start, end):  # an FMU may state any
        if unit.factor == 0.0 or not (math.isfinite(unit.factor) and math.isfinite(unit.offset)):
            raise ValueError(f"the unit {unit.name!r} has factor {unit.factor!r} and offset {unit.offset!r}")
    return start.factor / end.factor, (start.offset - end.offset) / end.factor


def _read_number(element: Element, name: str, path: Path) -> float | None:
    text = element.attributes.get(name)
    value = None if text is None else parse_real(text)
    if text is not None and (value is None or not math.isfinite(value)):
        raise SystemFileError(path, f"{name}: expected a finite number, got {text!r}", element.line)
    return value
