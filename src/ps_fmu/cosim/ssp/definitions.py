"""Units and enumerations that the files of SSP define (SSP 1.0, section 4.4)."""

from __future__ import annotations

import math
from pathlib import Path

from ..errors import SystemFileError
from ..values import EXPONENTS, Items, Unit, fits_int32, parse_real, parse_value
from ..xmlfile import Element
from .dialect import check_element, get_only_child


def read_units(group: Element | None, path: Path) -> dict[str, Unit]:
    """The units of an ``ssd:Units``, ``ssv:Units`` or ``ssb:Units``.

    Raises :class:`SystemFileError` with the line: no name, no base unit, a number that is none, a factor of zero.
    """
    units = {}
    for element in group.children if group is not None else ():
        check_element(element, path)
        name, base = element.attributes["name"], get_only_child(element, "ssc:BaseUnit", path)
        if base is None:
            raise SystemFileError(path, "a unit needs a name and an ssc:BaseUnit", element.line)
        numbers = {key: _read_number(base, key, path) for key in (*EXPONENTS, "factor", "offset")}
        factor = 1.0 if numbers["factor"] is None else numbers["factor"]
        if factor == 0.0:
            raise SystemFileError(path, f"unit {name!r}: the factor must not be zero", base.line)
        units[name] = Unit(name, tuple(numbers[key] or 0.0 for key in EXPONENTS), factor, numbers["offset"] or 0.0)
    return units


def read_items(group: Element | None, path: Path) -> dict[str, Items]:
    """The enumerations of an ``ssd:Enumerations`` or ``ssv:Enumerations`` by name.

    Raises :class:`SystemFileError` with the line: no name, an item without name and value.
    """
    found: dict[str, Items] = {}
    for element in group.children if group is not None else ():
        check_element(element, path)
        if "name" not in element.attributes:
            raise SystemFileError(path, "an enumeration needs a name", element.line)
        items = {}
        for item in element.all("ssc:Item"):
            check_element(item, path)
            name, value = item.attributes["name"], parse_value("Integer", item.attributes["value"])
            if not isinstance(value, int) or not fits_int32(value):
                text = "an item of an enumeration needs a name and a whole number of 32 bits"
                raise SystemFileError(path, text, item.line)
            items[name] = value
        found[element.attributes["name"]] = items
    return found


def _read_number(element: Element, name: str, path: Path) -> float | None:
    text = element.attributes.get(name)
    value = None if text is None else parse_real(text)
    if text is not None and (value is None or not math.isfinite(value)):
        raise SystemFileError(path, f"{name}: expected a finite number, got {text!r}", element.line)
    return value
