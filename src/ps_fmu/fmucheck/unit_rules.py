"""Rules for units and display units: names, usable numbers, and conversions that agree with the names."""

from __future__ import annotations

import math

from ..files.xmlfile import Element
from ..slavekit.author.units import BASE_UNITS, Unit, parse_unit
from .model_rules import find_repeated
from .reading import Description, Faults, parse_number

_SAME = 1e-6  # relative: six digits of a factor are enough


def check_names(description: Description) -> Faults:
    """Each unit is defined once."""
    yield from find_repeated(description.units, "unit")


def check_display_names(description: Description) -> Faults:
    """Each display unit is defined once within its unit."""
    for unit in description.units:
        yield from find_repeated(unit.all("DisplayUnit"), f"display unit of {unit.attributes.get('name')!r}:")


def check_conversions(description: Description) -> Faults:
    """Factors can be divided by, offsets are numbers, exponents are whole numbers."""
    for unit in description.units:
        for element in (*unit.all("BaseUnit"), *unit.all("DisplayUnit")):
            which = f"{element.tag} {element.attributes.get('name', '')}".rstrip()
            what = f"unit {unit.attributes.get('name')!r}, {which}"
            if not _is_usable(_read_conversion(element)):
                factor, offset = element.attributes.get("factor", "1"), element.attributes.get("offset", "0")
                yield element.line, f"{what}: factor {factor!r} and offset {offset!r} convert nothing"
            for base in BASE_UNITS:
                text = element.attributes.get(base)
                if element.tag == "BaseUnit" and text is not None and math.isnan(parse_number(text, "Integer")):
                    yield element.line, f"{what}: the exponent of {base} is {text!r}, expected a whole number"


def check_base_units(description: Description) -> Faults:
    """The conversion to SI base units agrees with the unit's name, where that has one meaning."""
    for unit in description.units:
        name = unit.attributes.get("name", "")
        base, named = unit.find("BaseUnit"), parse_unit(name)
        given = _read_base_unit(base) if base is not None else None
        if base is None or given is None or named is None:
            continue
        if not _has_same_dimension(given, named):
            yield base.line, f"unit {name!r} is {_format(given)}, expected {_format(named)}"
        elif _find_power_of_rad(given) == _find_power_of_rad(named):
            yield from _compare(base, f"unit {name!r}", (given.scale, given.offset), (named.scale, named.offset))


def check_display_units(description: Description) -> Faults:
    """The conversion to a display unit agrees with both names, where these have one meaning."""
    for unit in description.units:
        name = unit.attributes.get("name", "")
        base = unit.find("BaseUnit")
        own = parse_unit(name) or (_read_base_unit(base) if base is not None else None)
        for display in unit.all("DisplayUnit"):
            shown = display.attributes.get("name", "")
            named = parse_unit(shown)
            if own is None or named is None or not _is_usable(_read_conversion(display)):
                continue
            if not _has_same_dimension(own, named):
                yield display.line, f"unit {name!r} is {_format(own)}, its display unit {shown!r} is {_format(named)}"
            elif _find_power_of_rad(own) == _find_power_of_rad(named):
                expected = (own.scale / named.scale, (own.offset - named.offset) / named.scale)
                what = f"unit {name!r}, display unit {shown!r}"
                yield from _compare(display, what, _read_conversion(display), expected)


def _read_conversion(element: Element) -> tuple[float, float]:
    """Factor and offset."""
    given = element.attributes
    return parse_number(given.get("factor", "1"), "Real"), parse_number(given.get("offset", "0"), "Real")


def _is_usable(conversion: tuple[float, float]) -> bool:
    return all(map(math.isfinite, conversion)) and conversion[0] != 0.0


def _read_base_unit(element: Element) -> Unit | None:
    """The unit that a BaseUnit defines; None if a number of it cannot be used."""
    factor, offset = _read_conversion(element)
    exponents = [parse_number(element.attributes.get(base, "0"), "Integer") for base in BASE_UNITS]
    if not _is_usable((factor, offset)) or not all(map(math.isfinite, exponents)):
        return None
    return Unit(factor, tuple(map(int, exponents)), offset)


def _find_power_of_rad(unit: Unit) -> int:
    return unit.exponents[BASE_UNITS.index("rad")]


def _has_same_dimension(one: Unit, other: Unit) -> bool:
    """Whether all exponents but that of rad agree.  The standard leaves it to the tools whether they use rad."""
    return all(a == b for base, a, b in zip(BASE_UNITS, one.exponents, other.exponents, strict=True) if base != "rad")


def _compare(element: Element, what: str, given: tuple[float, float], expected: tuple[float, float]) -> Faults:
    for quality, value, want in zip(("factor", "offset"), given, expected, strict=True):
        if not math.isclose(value, want, rel_tol=_SAME, abs_tol=0.0 if quality == "factor" else _SAME):
            yield element.line, f"{what}: the {quality} is {value:.10g}, expected {want:.10g}"


def _format(unit: Unit) -> str:
    powers = {base: power for base, power in zip(BASE_UNITS, unit.exponents, strict=True) if power}
    return ".".join(f"{base}{power if power != 1 else ''}" for base, power in powers.items()) or "1"
