"""Terminals: variables of an FMU that are wired together, so that a tool connects them in one go.

FMI 2.0.4 (section 2.3, "Terminals and Icons") takes them over from FMI 3.0, section 2.4.9: the file and its schema are
those of FMI 3.0.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from xml.etree.ElementTree import Element, SubElement, indent, tostring

from .buffer import BufferLayout

_FMI_VERSION = "3.0"  # of the schema


@dataclass(frozen=True)
class Terminal:
    """Variables that are wired together, from or to a terminal of the same name.

    Parameters
    ----------
    name: unique within the FMU.
    variables: texts such as ``"base_force"``, which stand for their components, see :meth:`.BufferLayout.group`.
    description: one line.
    """

    name: str
    variables: tuple[str, ...]
    description: str

    def members(self, layout: BufferLayout) -> list[str]:
        """Names of the variables.  Raises KeyError if the slave has none of that name."""
        references = [reference for text in self.variables for reference in layout.group(text)]
        return [layout.by_reference[reference].name for reference in references]


def write_terminals(terminals: Iterable[Terminal], layout: BufferLayout) -> bytes:
    """Write the file ``terminalsAndIcons.xml``.

    The rule is ``plug``: two terminals fit if all members of each are in the other one too.
    Raises KeyError if the slave does not have a variable that is named.
    """
    root = Element("fmiTerminalsAndIcons", fmiVersion=_FMI_VERSION)
    parent = SubElement(root, "Terminals")
    for terminal in terminals:
        element = SubElement(
            parent, "Terminal", name=terminal.name, matchingRule="plug", description=terminal.description
        )
        for name in terminal.members(layout):
            SubElement(element, "TerminalMemberVariable", variableName=name, memberName=name, variableKind="signal")
    indent(root)
    return tostring(root, encoding="UTF-8", xml_declaration=True) + b"\n"
