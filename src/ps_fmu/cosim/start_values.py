"""Start values of a component as its FMU takes them: type, unit, enumeration, and whether they may be set at all."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from fmpy.model_description import ModelVariable

from .conversion import combine
from .description import convert_value, explain_unsettable
from .errors import UsageError
from .hops import End, Hop, Unit, list_items
from .structure import Component, Parameter, suggest_names
from .values import Value, parse_value


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
            text = f"{where}: {component.source.name} has no such variable{near}"
            (remarks if parameter.bound else problems).append(text + (": ignored" if parameter.bound else ""))
            continue
        variable = variables[name]
        reason = None if has_exact_start(variable) else explain_unsettable(variable, running=False)
        if reason:
            problems.append(f"{where}: {reason}")
        if parameter.bound and _is_undefined(parameter, ends[name]):
            remarks.append(f"{where}: nobody defines the unit {parameter.unit!r}: the value is taken as it is")
            parameter = replace(parameter, unit=None)
        try:
            values[name] = convert_value(variable, _convert(parameter, ends[name]))
            items = ends[name].items
            if items and values[name] not in items.values():
                problems.append(f"{where}: the enumeration has no value {values[name]}; it has {list_items(items)}")
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
    known = ", ".join(items) if items else "none that is defined"
    raise ValueError(f"the enumeration has no item {name!r}; it has {known}")
