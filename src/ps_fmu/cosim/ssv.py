"""Parameter sets: SSV files (SSP 1.0) with exact FMI types."""

from __future__ import annotations

import math
import re
from pathlib import Path

from .dialect import check_element
from .errors import SystemFileError
from .structure import ParameterSet, Value
from .xmlfile import Element, read_xml

_REAL = re.compile(r"[+-]?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d+)?")
_INTEGER = re.compile(r"[+-]?\d+")
_BOOLEAN = {"true": True, "1": True, "false": False, "0": False}


def read_parameters(path: Path) -> ParameterSet:
    """Values of an SSV file by name: a mapping to float, int, bool or str.

    For :meth:`System.with_parameters` the names read ``component.parameter``. Raises
    :class:`SystemFileError` with file and line: not an SSV 1.0 file, a value that is not of its type or not
    finite, a type other than Real, Integer, Boolean and String, a name that occurs twice.
    """
    path = Path(path)
    return read_parameter_set(read_xml(path), path)


def read_parameter_set(root: Element, path: Path) -> ParameterSet:
    """Values of an ``ssv:ParameterSet`` element; errors as in :func:`read_parameters`."""
    if root.tag != "ssv:ParameterSet":
        raise SystemFileError(
            path, f"is not a parameter set of SSP 1.0: expected ssv:ParameterSet, got {root.tag}", root.line
        )
    check_element(root, path)
    if root.attributes["version"] != "1.0":
        raise SystemFileError(path, f'is of version {root.attributes["version"]!r}; version "1.0" is read', root.line)
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
            origins[name] = f"{path}, line {parameter.line}"
            annotations = [note for group in parameter.all("ssv:Annotations") for note in group.all("ssc:Annotation")]
            if annotations:
                notes[name] = frozenset(note.attributes.get("type", "") for note in annotations)
            if "unit" in entry.attributes:
                units[name] = entry.attributes["unit"]
    return ParameterSet(values, units, origins, notes)


def parse_real(text: str) -> float | None:
    """A finite decimal number as XML writes it, or None."""
    stripped = text.strip()
    value = float(stripped) if _REAL.fullmatch(stripped) else math.nan
    return value if math.isfinite(value) else None


def _read_value(entry: Element, name: str, path: Path) -> Value:
    text = entry.attributes["value"]
    stripped = text.strip()
    if entry.tag == "ssv:String":
        return text
    if entry.tag == "ssv:Boolean" and stripped in _BOOLEAN:
        return _BOOLEAN[stripped]
    if entry.tag == "ssv:Integer" and _INTEGER.fullmatch(stripped) and len(stripped) < 20:
        return int(stripped)
    if entry.tag == "ssv:Real" and (number := parse_real(text)) is not None:
        return number
    kinds = {"ssv:Real": "a finite number", "ssv:Integer": "a whole number", "ssv:Boolean": "true or false"}
    raise SystemFileError(path, f"parameter {name!r}: expected {kinds[entry.tag]}, got {text!r}", entry.line)
