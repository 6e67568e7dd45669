"""Terminals of FMUs (FMI 2.0.4, ``terminalsAndIcons.xml``): the variables that are meant to be connected together."""

from __future__ import annotations

from pathlib import Path

from .archive import read_member
from .errors import SystemFileError
from .xmlfile import MAXIMUM_BYTES, Element, parse_xml

_PLACE = "terminalsAndIcons/terminalsAndIcons.xml"


def read_terminal_variables(fmu: Path) -> frozenset[str] | None:
    """Names of the variables in the terminals of an FMU whose archive has been checked; None: it has no terminals.

    A file that cannot be read counts as none: nothing of a simulation depends on it.
    """
    try:
        root = parse_xml(read_member(fmu, _PLACE, MAXIMUM_BYTES), fmu / _PLACE)
    except SystemFileError:
        return None
    found = frozenset(_list_variables(root))
    return found or None


def _list_variables(element: Element) -> list[str]:
    own = [element.attributes.get("variableName", "")] if element.tag == "TerminalMemberVariable" else []
    return [name for name in own if name] + [name for child in element.children for name in _list_variables(child)]
