"""Rules for units and display units: names, numbers that can be used, and conversions that are what the names say."""

from __future__ import annotations

import math
from collections.abc import Iterator

from ..cosim.xmlfile import Element
from .model_rules import repeated
from .reading import Description, number
from .unit_names import BASE_UNITS, Meaning, meaning

Found = Iterator[tuple[int, str]]
_SAME = 1e-6  # relative: six digits of a factor are enough


def names(description: Description) -> Found:
    """Each unit is defined once."""
    yield from repeated(description.units, "unit")


def display_names(description: Description) -> Found:
    """Each display unit is defined once within its unit."""
    for unit in description.units:
        yield from repeated(unit.all("DisplayUnit"), f"display unit of {unit.attributes.get('name')!r}:")


def conversions(description: Description) -> Found:
    """Factors can be divided by, offsets are numbers, exponents are whole numbers."""
    for unit in description.units:
        for element in (*unit.all("BaseUnit"), *unit.all("DisplayUnit")):
            which = f"{element.tag} {element.attributes.get('name', '')}".rstrip()
            what = f"unit {unit.attributes.get('name')!r}, {which}"
            if not _usable(_conversion(element)):
                factor, offset = element.attributes.get("factor", "1"), element.attributes.get("offset", "0")
                yield element.line, f"{what}: nothing can be converted with factor {factor!r} and offset {offset!r}"
            for base in BASE_UNITS:
                text = element.attributes.get(base)
                if element.tag == "BaseUnit" and text is not None and math.isnan(number(text, "Integer")):
                    yield element.line, f"{what}: the exponent of {base} is {text!r}, expected a whole number"


def base_units(description: Description) -> Found:
    """The conversion to SI base units is what the unit's name says, where that is beyond doubt."""
    for unit in description.units:
        name = unit.attributes.get("name", "")
        base, said = unit.find("BaseUnit"), meaning(name)
        given = _to_base(base) if base is not None else None
        if base is None or given is None or said is None:
            continue
        if not _same_dimension(given, said):
            yield base.line, f"unit {name!r} is {_text(given)}, expected {_text(said)}"
        elif _angle(given) == _angle(said):
            yield from _differs(base, f"unit {name!r}", (given.scale, given.offset), (said.scale, said.offset))


def display_units(description: Description) -> Found:
    """The conversion to a display unit is what the names say, where that is beyond doubt."""
    for unit in description.units:
        name = unit.attributes.get("name", "")
        base = unit.find("BaseUnit")
        own = meaning(name) or (_to_base(base) if base is not None else None)
        for display in unit.all("DisplayUnit"):
            shown = display.attributes.get("name", "")
            said = meaning(shown)
            if own is None or said is None or not _usable(_conversion(display)):
                continue
            if not _same_dimension(own, said):
                yield display.line, f"unit {name!r} is {_text(own)}, its display unit {shown!r} is {_text(said)}"
            elif _angle(own) == _angle(said):
                expected = (own.scale / said.scale, (own.offset - said.offset) / said.scale)
                yield from _differs(display, f"unit {name!r}, display unit {shown!r}", _conversion(display), expected)


def _conversion(element: Element) -> tuple[float, float]:
    """Factor and offset."""
    given = element.attributes
    return number(given.get("factor", "1"), "Real"), number(given.get("offset", "0"), "Real")


def _usable(conversion: tuple[float, float]) -> bool:
    return all(map(math.isfinite, conversion)) and conversion[0] != 0.0


def _to_base(element: Element) -> Meaning | None:
    """What a BaseUnit says; None if it has a number that makes no sense."""
    factor, offset = _conversion(element)
    exponents = [number(element.attributes.get(base, "0"), "Integer") for base in BASE_UNITS]
    if not _usable((factor, offset)) or not all(map(math.isfinite, exponents)):
        return None
    return Meaning(factor, tuple(map(int, exponents)), offset)


def _angle(unit: Meaning) -> int:
    return unit.exponents[BASE_UNITS.index("rad")]


def _same_dimension(one: Meaning, other: Meaning) -> bool:
    """The same exponents, but for that of rad: tools use it or not, as the standard leaves them to."""
    return all(a == b for base, a, b in zip(BASE_UNITS, one.exponents, other.exponents, strict=True) if base != "rad")


def _differs(element: Element, what: str, given: tuple[float, float], expected: tuple[float, float]) -> Found:
    for quality, value, want in zip(("factor", "offset"), given, expected, strict=True):
        if not math.isclose(value, want, rel_tol=_SAME, abs_tol=0.0 if quality == "factor" else _SAME):
            yield element.line, f"{what}: the {quality} is {value:.10g}, expected {want:.10g}"


def _text(unit: Meaning) -> str:
    powers = {base: power for base, power in zip(BASE_UNITS, unit.exponents, strict=True) if power}
    return ".".join(f"{base}{power if power != 1 else ''}" for base, power in powers.items()) or "1"
