"""Rules for the root element, interfaces, log categories, default experiment, types and units."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator
from datetime import datetime

from ..files.xmlfile import Element
from ..slavekit.author.units import BASE_UNITS, Unit, parse_unit
from .reading import Description, Faults, parse_number

_DATE = "%Y-%m-%dT%H:%M:%SZ"
_DATE_FORM = re.compile(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\dZ", re.ASCII)
_C_IDENTIFIER = re.compile(r"[A-Za-z_]\w*", re.ASCII)


def check_encoding(description: Description) -> Faults:
    """The first line states the encoding UTF-8."""
    if description.encoding is None or description.encoding.upper() != "UTF-8":
        yield 1, f'the encoding is stated as {description.encoding!r}, expected encoding="UTF-8" in the first line'


def check_version(description: Description) -> Faults:
    """fmiVersion is "2.0", also for 2.0.1 to 2.0.4."""
    given = description.root.attributes.get("fmiVersion")
    if given != "2.0":
        yield description.root.line, f'fmiVersion is {given!r}, expected "2.0"'


def check_guid(description: Description) -> Faults:
    """There is a GUID, which the library compares with its own."""
    if not description.root.attributes.get("guid", "").strip():
        yield description.root.line, "guid is empty: the library cannot be matched with this file"


def check_date(description: Description) -> Faults:
    """generationDateAndTime is YYYY-MM-DDThh:mm:ssZ, a date that exists, in UTC."""
    text = description.root.attributes.get("generationDateAndTime")
    if text is None:
        return
    try:
        datetime.strptime(text, _DATE)
        good = _DATE_FORM.fullmatch(text) is not None
    except ValueError:
        good = False
    if not good:
        yield description.root.line, f"generationDateAndTime {text!r} is not of the form YYYY-MM-DDThh:mm:ssZ"


def check_interface(description: Description) -> Faults:
    """The FMU offers model exchange or co-simulation."""
    if not _list_interfaces(description):
        yield description.root.line, "there is neither a ModelExchange nor a CoSimulation element"


def check_identifier(description: Description) -> Faults:
    """modelIdentifier is a C identifier: it is part of the names of C functions."""
    for element in _list_interfaces(description):
        name = element.attributes.get("modelIdentifier", "")
        if not _C_IDENTIFIER.fullmatch(name):
            yield element.line, f"modelIdentifier {name!r} is not a C identifier"


def check_capabilities(description: Description) -> Faults:
    """canSerializeFMUstate comes with canGetAndSetFMUstate."""
    for element in _list_interfaces(description):
        flags = {name for name, value in element.attributes.items() if value in ("true", "1")}
        if "canSerializeFMUstate" in flags and "canGetAndSetFMUstate" not in flags:
            yield element.line, f"{element.tag}: canSerializeFMUstate needs canGetAndSetFMUstate"


def check_source_files(description: Description) -> Faults:
    """Each source file is listed once."""
    for element in _list_interfaces(description):
        files = element.find("SourceFiles")
        yield from find_repeated(files.all("File") if files is not None else (), f"{element.tag}: source file")


def check_vendor_annotations(description: Description) -> Faults:
    """Each tool has its annotations in one element."""
    group = description.root.find("VendorAnnotations")
    yield from find_repeated(group.all("Tool") if group is not None else (), "vendor annotations of tool")


def check_log_categories(description: Description) -> Faults:
    """Each log category is defined once."""
    yield from find_repeated(description.categories, "log category")


def check_experiment(description: Description) -> Faults:
    """The default experiment ends after its start; step and tolerance are positive."""
    element = description.root.find("DefaultExperiment")
    if element is None:
        return
    names = ("startTime", "stopTime", "stepSize", "tolerance")
    given = {name: parse_number(element.attributes[name], "Real") for name in names if name in element.attributes}
    for name, value in given.items():
        if not math.isfinite(value) or (name in ("stepSize", "tolerance") and value <= 0.0):
            yield element.line, f"{name} of the default experiment is {element.attributes[name]!r}"
    duration = given.get("stopTime", math.inf) - given.get("startTime", 0.0)
    if duration <= 0.0:
        yield element.line, "the default experiment does not end after its start"
    elif given.get("stepSize", 0.0) > duration:
        yield element.line, "the step of the default experiment is longer than the experiment"


# --- TypeDefinitions: what variables of a declared type inherit -------------------------------------------------------


def check_types(description: Description) -> Faults:
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


def check_type_units(description: Description) -> Faults:
    """The unit of a type is defined; a display unit needs a unit."""
    defined = {element.attributes.get("name") for element in description.units}
    for name, kind in _list_kinds(description):
        unit, display = kind.attributes.get("unit"), kind.attributes.get("displayUnit")
        if unit is not None and unit not in defined:
            yield kind.line, f"type {name!r}: the unit {unit!r} is not defined"
        if display is not None and unit is None:
            yield kind.line, f"type {name!r}: the display unit {display!r} has no unit"


def check_type_bounds(description: Description) -> Faults:
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


def _list_interfaces(description: Description) -> list[Element]:
    return [child for child in description.root.children if child.tag in ("ModelExchange", "CoSimulation")]


def find_repeated(elements: Iterable[Element], what: str, attribute: str = "name") -> Faults:
    """Find elements whose attribute an element before them has, too."""
    seen: dict[str | None, int] = {}
    for element in elements:
        name = element.attributes.get(attribute)
        if name in seen:
            yield element.line, f"{what} {name!r} is also in line {seen[name]}"
        else:
            seen[name] = element.line


# --- Units ------------------------------------------------------------------------------------------------------------

_SAME = 1e-6  # relative: six digits of a factor are enough


def check_unit_names(description: Description) -> Faults:
    """Each unit is defined once."""
    yield from find_repeated(description.units, "unit")


def check_display_names(description: Description) -> Faults:
    """Each display unit is defined once within its unit."""
    for unit in description.units:
        yield from find_repeated(unit.all("DisplayUnit"), f"display unit of {unit.attributes.get('name')!r}:")


def check_unit_conversions(description: Description) -> Faults:
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
