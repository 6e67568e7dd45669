"""Rules for the root element, interfaces, log categories, default experiment and type definitions."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator
from datetime import datetime

from ..files.xmlfile import Element
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
