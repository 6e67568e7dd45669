"""Rules for TypeDefinitions: what variables of a declared type inherit."""

from __future__ import annotations

import math
from collections.abc import Iterator

from ..cosim.xmlfile import Element
from .model_rules import find_repeated
from .reading import Description, Faults, parse_number


def check_names(description: Description) -> Faults:
    """Each type is defined once, and no variable has its name."""
    yield from find_repeated(description.types, "type")
    variables = {variable.name for variable in description.variables}
    for element in description.types:
        if element.attributes.get("name") in variables:
            yield element.line, f"type {element.attributes['name']!r} has the name of a variable"


def check_enumerations(description: Description) -> Faults:
    """The items of an enumeration have names of their own and values of their own."""
    for element in description.types:
        for kind in element.all("Enumeration"):
            items = kind.all("Item")
            what = f"of enumeration {element.attributes.get('name')!r}:"
            yield from find_repeated(items, f"item {what}")
            yield from find_repeated(items, f"value {what}", "value")


def check_units(description: Description) -> Faults:
    """The unit of a type is defined; a display unit needs a unit."""
    defined = {element.attributes.get("name") for element in description.units}
    for name, kind in _list_kinds(description):
        unit, display = kind.attributes.get("unit"), kind.attributes.get("displayUnit")
        if unit is not None and unit not in defined:
            yield kind.line, f"type {name!r}: the unit {unit!r} is not defined"
        if display is not None and unit is None:
            yield kind.line, f"type {name!r}: the display unit {display!r} has no unit"


def check_bounds(description: Description) -> Faults:
    """min, max and nominal of a type are values of its kind; min <= max."""
    for name, kind in _list_kinds(description):
        keys = [key for key in ("min", "max", "nominal") if key in kind.attributes]
        given = {key: parse_number(kind.attributes[key], kind.tag) for key in keys}
        for key, value in given.items():
            if not math.isfinite(value):
                yield kind.line, f"type {name!r}: {key} {kind.attributes[key]!r} is not possible for a {kind.tag}"
        if given.get("min", -math.inf) > given.get("max", math.inf):
            yield kind.line, f"type {name!r}: min {given['min']:g} is above max {given['max']:g}"


def _list_kinds(description: Description) -> Iterator[tuple[str | None, Element]]:
    """Name of each type with its element Real, Integer or Enumeration."""
    for element in description.types:
        for kind in element.children:
            if kind.tag in ("Real", "Integer", "Enumeration"):
                yield element.attributes.get("name"), kind
