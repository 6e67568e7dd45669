"""Rules for the root of a model description, its units, types, log categories and default experiment."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator
from datetime import datetime

from ..cosim.xmlfile import Element
from .reading import Description, number

Found = Iterator[tuple[int, str]]
_DATE = "%Y-%m-%dT%H:%M:%SZ"
_DATE_FORM = re.compile(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\dZ", re.ASCII)
_C_IDENTIFIER = re.compile(r"[A-Za-z_]\w*", re.ASCII)


def version(description: Description) -> Found:
    """fmiVersion of every 2.0.x is "2.0"."""
    given = description.root.attributes.get("fmiVersion")
    if given != "2.0":
        yield description.root.line, f'fmiVersion is {given!r}, expected "2.0"'


def guid(description: Description) -> Found:
    """There is a GUID to compare with that in the library."""
    if not description.root.attributes.get("guid", "").strip():
        yield description.root.line, "guid is empty: the library cannot be matched with this file"


def date(description: Description) -> Found:
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


def interface(description: Description) -> Found:
    """The FMU offers model exchange or co-simulation."""
    if not _interfaces(description):
        yield description.root.line, "there is neither a ModelExchange nor a CoSimulation element"


def identifier(description: Description) -> Found:
    """modelIdentifier begins the names of C functions."""
    for element in _interfaces(description):
        name = element.attributes.get("modelIdentifier", "")
        if not _C_IDENTIFIER.fullmatch(name):
            yield element.line, f"modelIdentifier {name!r} is not a C identifier"


def unit_names(description: Description) -> Found:
    """Each unit is defined once."""
    yield from _repeated(description.units, "unit")


def display_unit_names(description: Description) -> Found:
    """Each display unit is defined once within its unit, with a factor that can be divided by."""
    for unit in description.units:
        displays = unit.all("DisplayUnit")
        yield from _repeated(displays, f"display unit of {unit.attributes.get('name')!r}:")
        for display in displays:
            factor = number(display.attributes.get("factor", "1"), "Real")
            if not math.isfinite(factor) or factor == 0.0:
                name, text = display.attributes.get("name"), display.attributes.get("factor")
                yield display.line, f"display unit {name!r} has the factor {text!r}"


def type_names(description: Description) -> Found:
    """Each type is defined once, and no variable has its name."""
    yield from _repeated(description.types, "type")
    variables = {variable.name for variable in description.variables}
    for element in description.types:
        if element.attributes.get("name") in variables:
            yield element.line, f"type {element.attributes['name']!r} has the name of a variable"


def enumerations(description: Description) -> Found:
    """The items of an enumeration have names of their own and values of their own."""
    for element in description.types:
        for kind in element.all("Enumeration"):
            items = kind.all("Item")
            what = f"of enumeration {element.attributes.get('name')!r}:"
            yield from _repeated(items, f"item {what}")
            yield from _repeated(items, f"value {what}", "value")


def log_categories(description: Description) -> Found:
    """Each log category is defined once."""
    yield from _repeated(description.categories, "log category")


def experiment(description: Description) -> Found:
    """The default experiment ends after its start; step and tolerance are positive."""
    element = description.root.find("DefaultExperiment")
    if element is None:
        return
    names = ("startTime", "stopTime", "stepSize", "tolerance")
    given = {name: number(element.attributes[name], "Real") for name in names if name in element.attributes}
    for name, value in given.items():
        if not math.isfinite(value) or (name in ("stepSize", "tolerance") and value <= 0.0):
            yield element.line, f"{name} of the default experiment is {element.attributes[name]!r}"
    if given.get("stopTime", math.inf) <= given.get("startTime", 0.0):
        yield element.line, "the default experiment does not end after its start"


def _interfaces(description: Description) -> list[Element]:
    return [child for child in description.root.children if child.tag in ("ModelExchange", "CoSimulation")]


def _repeated(elements: Iterable[Element], what: str, attribute: str = "name") -> Found:
    seen: dict[str | None, int] = {}
    for element in elements:
        name = element.attributes.get(attribute)
        if name in seen:
            yield element.line, f"{what} {name!r} is also in line {seen[name]}"
        else:
            seen[name] = element.line
