"""What happens to a value on its way: units, as in section 4.4 of SSP 1.0, transformations; and start values.

A path is a sequence of hops, from connector to connector or through a parameter mapping.  :func:`combine` turns it into
one :class:`.values.Conversion`, which is all that a simulation needs.  A value ``v`` in a unit is
``factor * v + offset`` in SI base units.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

from fmpy.model_description import ModelDescription, ModelVariable

from .description import convert_value, explain_unsettable, get_unit
from .errors import UsageError
from .structure import Component, Parameter, suggest_names
from .values import (
    EXPECTED,
    EXPONENTS,
    Conversion,
    End,
    Hop,
    Transformation,
    Unit,
    Value,
    fits_int32,
    list_items,
    parse_value,
)


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
        raise ValueError(f"the units differ, {start.name!r} and {end.name!r}, and no file defines {unknown.name!r}")
    if start.exponents != end.exponents:
        raise ValueError(f"the units differ in their dimensions, {start.name!r} and {end.name!r}")
    for unit in (start, end):  # an FMU may state any
        if unit.factor == 0.0 or not (math.isfinite(unit.factor) and math.isfinite(unit.offset)):
            raise ValueError(f"the unit {unit.name!r} has factor {unit.factor!r} and offset {unit.offset!r}")
    return start.factor / end.factor, (start.offset - end.offset) / end.factor


INTEGERS = ("Integer", "Enumeration")
_VALID_FOR = {"Linear": ("Real",), "Boolean": ("Boolean",), "Integer": INTEGERS, "Enumeration": ("Enumeration",)}


def find_end(variable: ModelVariable, description: ModelDescription) -> End:
    """What an FMU says of a variable."""
    declared = variable.declaredType
    items = {item.name: int(item.value) for item in declared.items} if declared is not None and declared.items else None
    return End(variable.type, find_fmu_unit(variable, description), items)


def combine(start: End, hops: Sequence[Hop], end: End) -> Conversion:
    """The conversion of a path from ``start`` over some hops; the last of them ends at ``end``.

    A connector that states no unit has that of the next one on the way that does.  Raises ValueError with the reason,
    which begins with the place: units that cannot be converted, a transformation of another type, an unknown item,
    factors whose product is no finite number.
    """
    factor, offset = 1.0, 0.0
    tables: list[Mapping[int, int]] = []
    here = start
    for place, hop in enumerate(hops):
        there = end if place == len(hops) - 1 else _look_ahead([*(h.end for h in hops[place:-1]), end])
        try:
            scale, shift = find_conversion(here.unit, there.unit) if hop.converts else (1.0, 0.0)
            factor, offset = scale * factor, scale * offset + shift
            if hop.transformation is not None:
                kind = there.type or here.type or end.type
                if kind not in _VALID_FOR[hop.transformation.kind]:
                    raise ValueError(f"a transformation for {hop.transformation.kind} values cannot act on {kind}")
                if hop.transformation.kind == "Linear":
                    factor = hop.transformation.factor * factor
                    offset = hop.transformation.factor * offset + hop.transformation.offset
                else:
                    tables.append(_make_table(hop.transformation, here, there))
            if not (math.isfinite(factor) and math.isfinite(offset)):
                raise ValueError(f"all factors and offsets up to here come to {factor!r} and {offset!r}")
        except ValueError as error:
            raise ValueError(f"{hop.where}: {error}") from None
        here = End(there.type or here.type, there.unit or here.unit, there.items or here.items)
    return Conversion(factor, offset, tuple(tables))


def _look_ahead(ends: Sequence[End]) -> End:
    """The next connector, with the unit of the first that states one."""
    unit = next((end.unit for end in ends if end.unit is not None), None)
    return End(ends[0].type, unit, ends[0].items)


def _make_table(transformation: Transformation, here: End, there: End) -> dict[int, int]:
    table: dict[int, int] = {}
    for entry in transformation.entries:
        sides = []
        for text, end in zip(entry, (here, there), strict=True):
            if transformation.kind == "Enumeration":
                if end.items is None:
                    raise ValueError(f"no file defines the enumeration with the item {text!r}")
                if text not in end.items:
                    known = ", ".join(end.items)
                    raise ValueError(f"there is no item {text!r} in the enumeration; expected one of {known}")
                sides.append(end.items[text])
            else:
                value = parse_value(transformation.kind, text)
                if value is None:
                    raise ValueError(f"expected {EXPECTED[transformation.kind]}, got {text!r}")
                if not fits_int32(int(value)):
                    raise ValueError(f"the map entry {text} does not fit a 32-bit integer")
                sides.append(int(value))
        if sides[0] in table:
            raise ValueError(f"the source value {entry[0]!r} occurs twice")
        table[sides[0]] = sides[1]
    return table


# ---- start values ---------------------------------------------------------------------------------------------------


def resolve_start_values(
    component: Component, variables: Mapping[str, ModelVariable], ends: Mapping[str, End]
) -> tuple[dict[str, Value], list[str], list[str]]:
    """The values to set before the initialisation; what is wrong; and what is ignored, as SSP asks for.

    A binding of the system may name parameters that an FMU has not.
    """
    values: dict[str, Value] = {}
    problems: list[str] = []
    remarks: list[str] = []
    for name, parameter in component.parameters.items():
        where = f"parameter {component.name}.{name} ({parameter.origin})"
        if name not in variables:
            near = suggest_names(name, [*variables, *(f"{component.name}.{known}" for known in variables)])
            text = f"{where}: there is no such variable in {component.source.name}{near}"
            (remarks if parameter.bound else problems).append(text + (": ignored" if parameter.bound else ""))
            continue
        variable = variables[name]
        reason = None if has_exact_start(variable) else explain_unsettable(variable, running=False)
        if reason:
            problems.append(f"{where}: {reason}")
        if parameter.bound and _is_undefined(parameter, ends[name]):
            remarks.append(f"{where}: no file defines the unit {parameter.unit!r}: the value is not converted")
            parameter = replace(parameter, unit=None)
        try:
            values[name] = convert_value(variable, _convert(parameter, ends[name]))
            items = ends[name].items
            if items and values[name] not in items.values():
                known = list_items(items)
                problems.append(f"{where}: expected an item of the enumeration, {known}, got {values[name]}")
        except (UsageError, ValueError) as error:
            problems.append(f"{where}: {error}")
    return values, problems, remarks


def has_exact_start(variable: ModelVariable) -> bool:
    """Whether a variable may be set before the initialisation, as those with a start value (FMI 2.0.4, table 2.2.7)."""
    return variable.initial in ("exact", "approx") and variable.variability != "constant"


def _is_undefined(parameter: Parameter, end: End) -> bool:
    """Whether the unit of a value is only a name, and not that of the variable."""
    own = end.unit.name if end.unit is not None else parameter.unit
    return parameter.unit not in (None, own) and parameter.defined is None


def _convert(parameter: Parameter, end: End) -> Value:
    """The value of a parameter behind its mappings and connections.  Raises ValueError."""
    value = parameter.value
    items = end.items
    if parameter.items is not None:
        # An item of the file's own enumeration where it has one: a mapping may turn it into one of the FMU's.
        items = parameter.items or end.items
        value = _find_item(str(value), items)
    unit = None if parameter.unit is None else parameter.defined or Unit(parameter.unit)
    if not parameter.hops and unit is not None and end.unit is not None and unit.exponents is None:
        if unit.name != end.unit.name:
            raise ValueError(f"is given in {unit.name!r}, its unit is {end.unit.name!r}")
        return value
    conversion = combine(End(end.type, unit, items), parameter.hops or (Hop("its unit"),), end)
    if end.type == "Real" and isinstance(value, int) and not isinstance(value, bool):
        value = float(value)
    return conversion.apply(value)


def _find_item(name: str, items: Mapping[str, int] | None) -> int:
    if items is not None and name in items:
        return items[name]
    number = parse_value("Integer", name)
    if isinstance(number, int):
        return number
    known = ", ".join(items) if items else "none, for no file defines it"
    raise ValueError(f"there is no item {name!r} in the enumeration; expected one of {known}")
