"""Parameter sets of SSP 1.0 and 2.0 (SSV files, with exact FMI types), their mappings, units and enumerations."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from ...files.xmlfile import Element, read_xml
from ..errors import SystemFileError
from ..structure import Parameter, ParameterSet
from ..values import EXPECTED, EXPONENTS, Hop, Items, Transformation, Unit, Value, fits_int32, parse_value
from .rules import check_element, check_version, get_only_child, get_type, read_number


def read_parameters(path: Path) -> ParameterSet:
    """Read the values of an SSV file: a mapping from name to float, int, bool or str.

    For :meth:`System.with_parameters` the names are ``component.parameter``.  Raises :class:`SystemFileError`, with
    file and line, if the file is not SSV, if a value is not finite or not of its type, if FMI 2.0 does not define the
    type, if a name occurs twice.
    """
    path = Path(path)
    return read_parameter_set(read_xml(path), path)


def read_parameter_set(root: Element, path: Path, shown: Path | None = None) -> ParameterSet:
    """Values of an ``ssv:ParameterSet`` element of a file that its user knows as ``shown``; errors as there."""
    if root.tag != "ssv:ParameterSet":
        raise SystemFileError(
            path, f"is not a parameter set of SSP: expected ssv:ParameterSet, got {root.tag}", root.line
        )
    check_element(root, path)
    check_version(root, path)
    enumerations = read_items(root.find("ssv:Enumerations"), path)
    units = read_units(root.find("ssv:Units"), path)
    found: dict[str, Parameter] = {}
    for group in root.all("ssv:Parameters"):
        check_element(group, path)
        for parameter in group.children:
            check_element(parameter, path)
            name = parameter.attributes["name"]
            if name in found:
                raise SystemFileError(path, f"parameter {name!r} occurs twice", parameter.line)
            entries = [child for child in parameter.children if child.tag != "ssv:Annotations"]
            if len(entries) != 1:
                raise SystemFileError(path, f"parameter {name!r} must have exactly one value", parameter.line)
            entry = entries[0]
            check_element(entry, path)
            notes = [note for group in parameter.all("ssv:Annotations") for note in group.all("ssc:Annotation")]
            unit, items = entry.attributes.get("unit"), enumerations.get(entry.attributes.get("name", ""), {})
            found[name] = Parameter(
                _read_value(entry, name, path), unit, f"{shown or path}, line {parameter.line}",
                frozenset(note.attributes.get("type", "") for note in notes),
                units.get(unit or ""), items if entry.tag == "ssv:Enumeration" else None,
            )  # fmt: skip
    return ParameterSet(found)


def _read_value(entry: Element, name: str, path: Path) -> Value:
    kind, text = get_type(entry.tag), entry.attributes["value"]
    value = parse_value("String" if kind == "Enumeration" else kind, text)
    if value is None:
        raise SystemFileError(path, f"parameter {name!r}: expected {EXPECTED[kind]}, got {text!r}", entry.line)
    return value


# ---- mappings -------------------------------------------------------------------------------------------------------


def read_hop(element: Element, path: Path, where: str) -> Hop:
    """What an ``ssd:Connection`` or ``ssm:MappingEntry`` does to a value.  Raises :class:`SystemFileError`."""
    found = [child for child in element.children if child.tag.endswith("Transformation")]
    if len(found) > 1:
        raise SystemFileError(path, f"{element.tag} has more than one transformation", found[1].line)
    text = element.attributes.get("suppressUnitConversion", "false")
    suppressed = parse_value("Boolean", text)
    if suppressed is None:
        raise SystemFileError(path, f"suppressUnitConversion: expected true or false, got {text!r}", element.line)
    return Hop(where, transformation=_read_transformation(found[0], path) if found else None, converts=not suppressed)


def read_linear(element: Element, path: Path) -> Transformation:
    """The factor, 1 where none is stated, and offset of an element.  Raises :class:`SystemFileError`."""
    factor, offset = (read_number(element, name, path) for name in ("factor", "offset"))
    return Transformation("Linear", 1.0 if factor is None else factor, offset or 0.0)


def _read_transformation(element: Element, path: Path) -> Transformation:
    check_element(element, path)
    kind = element.tag.removeprefix("ssc:").removesuffix("Transformation").removesuffix("Mapping")
    if kind == "Linear":
        return read_linear(element, path)
    entries = []
    for entry in element.children:
        check_element(entry, path)
        entries.append((entry.attributes["source"], entry.attributes["target"]))
    return Transformation(kind, entries=tuple(entries))


def apply_mapping(root: Element, path: Path, shown: Path, given: Mapping[str, Parameter]) -> dict[str, Parameter]:
    """Parameters under the names that an ``ssm:ParameterMapping`` gives them; those that it does not name are dropped.

    A value that the source has not is no error, as in SSP.  Raises :class:`SystemFileError` with the line: not a
    mapping, a target that occurs twice.
    """
    if root.tag != "ssm:ParameterMapping":
        raise SystemFileError(path, f"is not a parameter mapping of SSP: got {root.tag}", root.line)
    check_element(root, path)
    check_version(root, path)
    mapped: dict[str, Parameter] = {}
    seen: dict[str, int] = {}
    for entry in root.all("ssm:MappingEntry"):
        check_element(entry, path)
        source, target = entry.attributes["source"], entry.attributes["target"]
        if target in seen:
            raise SystemFileError(path, f"target {target!r} is also in line {seen[target]}", entry.line)
        seen[target] = entry.line
        if source in given:
            hop = read_hop(entry, path, f"{shown}, line {entry.line}")
            mapped[target] = replace(given[source], hops=(*given[source].hops, hop))
    return mapped


# ---- units and enumerations -----------------------------------------------------------------------------------------


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
        numbers = {key: read_number(base, key, path) for key in (*EXPONENTS, "factor", "offset")}
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
