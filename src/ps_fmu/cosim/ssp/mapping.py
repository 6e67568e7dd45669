"""Transformations and parameter mappings (``.ssm``) of SSP 1.0."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from ..errors import SystemFileError
from ..structure import Parameter
from ..values import Hop, Transformation, parse_real, parse_value
from ..xmlfile import Element
from .dialect import check_element, check_version


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


def _read_transformation(element: Element, path: Path) -> Transformation:
    check_element(element, path)
    kind = element.tag.removeprefix("ssc:").removesuffix("Transformation").removesuffix("Mapping")
    if kind == "Linear":
        numbers = []
        for name, default in (("factor", "1"), ("offset", "0")):
            text = element.attributes.get(name, default)
            number = parse_real(text)
            if number is None:
                raise SystemFileError(path, f"{name}: expected a finite number, got {text!r}", element.line)
            numbers.append(number)
        return Transformation(kind, factor=numbers[0], offset=numbers[1])
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
