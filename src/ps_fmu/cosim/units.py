"""Units of SSP and FMI: a name, and what it means in SI base units (SSP 1.0, section 4.4; FMI 2.0.4, section 2.2.2).

A value ``v`` in a unit is ``factor * v + offset`` in SI base units.
"""

from __future__ import annotations

import math

from fmpy.model_description import ModelDescription, ModelVariable

from .description import get_unit
from .hops import EXPONENTS, Unit


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
