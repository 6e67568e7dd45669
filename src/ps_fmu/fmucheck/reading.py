"""A ``modelDescription.xml`` (FMI 2.0) as the rules look at it: every attribute with the default of the standard.

Nothing is corrected or refused here: what is wrong is for the rules to say.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from ..files.xmlfile import Element, parse_xml

Faults = Iterator[tuple[int, str]]
"""Lines of the file, each with what is wrong there."""
TYPES = ("Real", "Integer", "Boolean", "String", "Enumeration")
_INHERITED = ("unit", "displayUnit", "min", "max", "nominal", "quantity", "relativeQuantity", "unbounded")
_REAL = re.compile(r"[+-]?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d+)?|[+-]?INF|NaN", re.ASCII)
_ENCODING = re.compile(rb"""(?:\xef\xbb\xbf)?<\?xml[^>]*\sencoding\s*=\s*["']([\w.-]+)["']""", re.ASCII)
_INTEGER = re.compile(r"[+-]?[0-9]{1,18}")
_INDEX = re.compile(r"[0-9]{1,18}")


@dataclass(frozen=True)
class Variable:
    """A ScalarVariable.

    ``index`` counts from 1 as ModelStructure does; ``attributes`` are those of Real, Integer, ... with what a declared
    type adds; ``own`` are those of the ScalarVariable itself; ``stated_initial`` is None where the file is silent.
    """

    index: int
    name: str
    reference: str
    type: str
    causality: str
    variability: str
    stated_initial: str | None
    attributes: Mapping[str, str]
    own: Mapping[str, str]
    line: int

    @property
    def start(self) -> str | None:
        """The start value as text."""
        return self.attributes.get("start")

    def number(self, attribute: str) -> float | None:
        """A numeric attribute; None if it is not there, NaN if it is no number of the variable's type."""
        text = self.attributes.get(attribute)
        return None if text is None else parse_number(text, self.type)


@dataclass(frozen=True)
class Unknown:
    """An entry of ModelStructure; ``dependencies`` and ``kinds`` are None where the file is silent."""

    index: int
    dependencies: tuple[int, ...] | None
    kinds: tuple[str, ...] | None
    line: int


@dataclass(frozen=True)
class Description:
    """A model description.

    ``root`` is the element ``fmiModelDescription``, ``encoding`` what the XML declaration states, if there is one.
    """

    root: Element
    encoding: str | None

    @cached_property
    def types(self) -> list[Element]:
        """The SimpleType elements."""
        return self._list_group("TypeDefinitions", "SimpleType")

    @cached_property
    def units(self) -> list[Element]:
        """The Unit elements."""
        return self._list_group("UnitDefinitions", "Unit")

    @cached_property
    def categories(self) -> list[Element]:
        """The Category elements of LogCategories."""
        return self._list_group("LogCategories", "Category")

    @cached_property
    def variables(self) -> list[Variable]:
        """The variables, in the order of the file."""
        types = {element.attributes.get("name"): element for element in self.types}
        found = self._list_group("ModelVariables", "ScalarVariable")
        return [_read_variable(index, element, types) for index, element in enumerate(found, 1)]

    def variable(self, index: int) -> Variable | None:
        """The variable with an index of ModelStructure, or None."""
        return self.variables[index - 1] if 1 <= index <= len(self.variables) else None

    def unknowns(self, part: str) -> list[Unknown]:
        """The entries of Outputs, Derivatives or InitialUnknowns."""
        return self._structure.get(part, [])

    @cached_property
    def _structure(self) -> dict[str, list[Unknown]]:
        structure = self.root.find("ModelStructure")
        groups = reversed(structure.children) if structure is not None else ()  # of two with one name the first counts
        return {group.tag: [_read_unknown(element) for element in group.all("Unknown")] for group in groups}

    def _list_group(self, part: str, tag: str) -> list[Element]:
        group = self.root.find(part)
        return group.all(tag) if group is not None else []


def read_description(data: bytes, path: Path) -> Description:
    """Parse a model description; ``path`` is named in errors.

    Raises :class:`ps_fmu.cosim.SystemFileError` if it is not XML, or has a document type declaration.
    """
    stated = _ENCODING.match(data)
    return Description(parse_xml(data, path), stated[1].decode("ascii") if stated else None)


def parse_number(text: str, kind: str) -> float:
    """A number as XML Schema writes it, NaN if it is none of this FMI type."""
    text = text.strip()
    if kind == "Real" and _REAL.fullmatch(text):
        return float(text)
    if kind in ("Integer", "Enumeration") and _INTEGER.fullmatch(text):
        value = int(text)
        return value if -(2**31) <= value < 2**31 else math.nan
    return math.nan


def parse_index(text: str | None) -> int:
    """An index of ModelStructure; 0, which no variable has, for anything else."""
    return int(text) if text is not None and _INDEX.fullmatch(text) else 0


def _read_variable(index: int, element: Element, types: Mapping[str | None, Element]) -> Variable:
    given = element.attributes
    kind = next((child for child in element.children if child.tag in TYPES), None)
    own = kind.attributes if kind is not None else {}
    declared = types.get(own["declaredType"]) if "declaredType" in own else None
    inner = next((child for child in declared.children if child.tag in TYPES), None) if declared is not None else None
    inherited = {k: v for k, v in inner.attributes.items() if k in _INHERITED} if inner is not None else {}
    return Variable(
        index,
        given.get("name", ""),
        given.get("valueReference", ""),
        kind.tag if kind is not None else "",
        given.get("causality", "local"),
        given.get("variability", "continuous"),
        given.get("initial"),
        {**inherited, **own},
        given,
        element.line,
    )


def _read_unknown(element: Element) -> Unknown:
    given = element.attributes
    dependencies, kinds = given.get("dependencies"), given.get("dependenciesKind")
    return Unknown(
        parse_index(given.get("index")),
        None if dependencies is None else tuple(map(parse_index, dependencies.split())),
        None if kinds is None else tuple(kinds.split()),
        element.line,
    )
