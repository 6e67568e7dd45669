"""Parameter sets: SSV files (SSP 1.0 and 2.0) with exact FMI types."""

from __future__ import annotations

from pathlib import Path

from ..errors import SystemFileError
from ..structure import ParameterSet
from ..values import EXPECTED, Items, Value, parse_value
from ..xmlfile import Element, read_xml
from .definitions import read_items, read_units
from .dialect import check_element, check_version, get_type


def read_parameters(path: Path) -> ParameterSet:
    """Values of an SSV file by name: a mapping to float, int, bool or str.

    For :meth:`System.with_parameters` the names read ``component.parameter``. Raises
    :class:`SystemFileError` with file and line: not an SSV file, a value that is not of its type or not
    finite, a type that FMI 2.0 has not, a name that occurs twice.
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
    items: dict[str, Items] = {}
    values: dict[str, Value] = {}
    units: dict[str, str] = {}
    origins: dict[str, str] = {}
    notes: dict[str, frozenset[str]] = {}
    for group in root.all("ssv:Parameters"):
        check_element(group, path)
        for parameter in group.children:
            check_element(parameter, path)
            name = parameter.attributes["name"]
            if name in values:
                raise SystemFileError(path, f"parameter {name!r} occurs twice", parameter.line)
            entries = [child for child in parameter.children if child.tag != "ssv:Annotations"]
            if len(entries) != 1:
                raise SystemFileError(path, f"parameter {name!r} must have exactly one value", parameter.line)
            entry = entries[0]
            check_element(entry, path)
            values[name] = _read_value(entry, name, path)
            origins[name] = f"{shown or path}, line {parameter.line}"
            annotations = [note for group in parameter.all("ssv:Annotations") for note in group.all("ssc:Annotation")]
            if annotations:
                notes[name] = frozenset(note.attributes.get("type", "") for note in annotations)
            if "unit" in entry.attributes:
                units[name] = entry.attributes["unit"]
            if entry.tag == "ssv:Enumeration":
                items[name] = enumerations.get(entry.attributes.get("name", ""), {})
    return ParameterSet(values, units, origins, notes, read_units(root.find("ssv:Units"), path), items)


def _read_value(entry: Element, name: str, path: Path) -> Value:
    kind, text = get_type(entry.tag), entry.attributes["value"]
    value = parse_value("String" if kind == "Enumeration" else kind, text)
    if value is None:
        raise SystemFileError(path, f"parameter {name!r}: expected {EXPECTED[kind]}, got {text!r}", entry.line)
    return value
