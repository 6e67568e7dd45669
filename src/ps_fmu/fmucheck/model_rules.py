"""Rules for the root of a model description, what it says of the interface, log categories and default experiment."""

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


def encoding(description: Description) -> Found:
    """The first line says that the file is in UTF-8."""
    if description.encoding is None or description.encoding.upper() != "UTF-8":
        yield 1, f'the encoding is stated as {description.encoding!r}, expected encoding="UTF-8" in the first line'


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


def capabilities(description: Description) -> Found:
    """A state that can be serialised can be had at all."""
    for element in _interfaces(description):
        flags = {name for name, value in element.attributes.items() if value in ("true", "1")}
        if "canSerializeFMUstate" in flags and "canGetAndSetFMUstate" not in flags:
            yield element.line, f"{element.tag}: canSerializeFMUstate needs canGetAndSetFMUstate"


def source_files(description: Description) -> Found:
    """Each source file is listed once."""
    for element in _interfaces(description):
        files = element.find("SourceFiles")
        yield from repeated(files.all("File") if files is not None else (), f"{element.tag}: source file")


def vendor_annotations(description: Description) -> Found:
    """Each tool has its annotations in one element."""
    group = description.root.find("VendorAnnotations")
    yield from repeated(group.all("Tool") if group is not None else (), "vendor annotations of tool")


def log_categories(description: Description) -> Found:
    """Each log category is defined once."""
    yield from repeated(description.categories, "log category")


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
    duration = given.get("stopTime", math.inf) - given.get("startTime", 0.0)
    if duration <= 0.0:
        yield element.line, "the default experiment does not end after its start"
    elif given.get("stepSize", 0.0) > duration:
        yield element.line, "the step of the default experiment is longer than the experiment"


def _interfaces(description: Description) -> list[Element]:
    return [child for child in description.root.children if child.tag in ("ModelExchange", "CoSimulation")]


def repeated(elements: Iterable[Element], what: str, attribute: str = "name") -> Found:
    """Elements whose attribute has been there before."""
    seen: dict[str | None, int] = {}
    for element in elements:
        name = element.attributes.get(attribute)
        if name in seen:
            yield element.line, f"{what} {name!r} is also in line {seen[name]}"
        else:
            seen[name] = element.line
