"""What ``OspSystemStructure.xml`` may contain here: one rule per element.

What changes results and cannot be honoured is refused with a way out, never skipped.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ..errors import SystemFileError
from ..xmlfile import Element

NAMESPACE = "http://opensimulationplatform.com/MSMI/OSPSystemStructure"
PREFIX = "oss:"
ROOT_NAME = "OspSystemStructure"
ROOT = f"{PREFIX}{ROOT_NAME}"
VALUES = ("Real", "Integer", "Boolean", "String", "Enumeration")


@dataclass(frozen=True)
class _Rule:
    children: frozenset[str]
    required: frozenset[str]
    optional: frozenset[str]


def _make_rule(children: str = "", required: str = "", optional: str = "") -> _Rule:
    return _Rule(frozenset(children.split()), frozenset(required.split()), frozenset(optional.split()))


_RULES = {
    ROOT_NAME: _make_rule(
        "Description StartTime EndTime BaseStepSize Algorithm Simulators Functions Connections EccoConfiguration",
        "",
        "version",
    ),
    **{name: _make_rule() for name in ("Description", "StartTime", "EndTime", "BaseStepSize", "Algorithm")},
    "Simulators": _make_rule("Simulator"),
    "Simulator": _make_rule("InitialValues", "name source", "stepSize"),
    "InitialValues": _make_rule("InitialValue"),
    "InitialValue": _make_rule(" ".join(VALUES), "variable"),
    "Functions": _make_rule("LinearTransformation"),
    "LinearTransformation": _make_rule("", "name", "factor offset"),
    "Connections": _make_rule("VariableConnection SignalConnection"),
    "VariableConnection": _make_rule("Variable", "", "powerBond"),
    "SignalConnection": _make_rule("Variable Signal"),
    "Variable": _make_rule("", "simulator name", "causality"),
    "Signal": _make_rule("", "function name"),
    **{name: _make_rule("", "value") for name in VALUES},
}

_SUM = "is not supported: let an FMU add"
_GROUP = "is not supported: write a VariableConnection for each variable of the groups"
_REFUSED = {
    "Sum": _SUM,
    "VectorSum": _SUM,
    "VariableGroupConnection": _GROUP,
    "SignalGroupConnection": _GROUP,
}


def check_element(element: Element, path: Path) -> None:
    """Check the attributes and the children of one element against its rule.

    Raises :class:`SystemFileError` with the line for anything that is missing, unknown or not supported.
    """
    name = get_name(element)
    rule = _RULES[name]
    if missing := sorted(rule.required - element.attributes.keys()):
        raise SystemFileError(path, f"{name} has no attribute {', '.join(missing)}", element.line)
    known = rule.required | rule.optional
    for attribute in element.attributes:
        if ":" not in attribute and attribute not in known:
            text = f"{name} has an unknown attribute {attribute!r}; known are: {', '.join(sorted(known)) or 'none'}"
            raise SystemFileError(path, text, element.line)
    for child in element.children:
        if get_name(child) not in rule.children or not child.tag.startswith(PREFIX):
            expected = f"is not expected here; expected: {', '.join(sorted(rule.children)) or 'nothing'}"
            text = f"{get_name(child)} in {name}: {_REFUSED.get(get_name(child), expected)}"
            raise SystemFileError(path, text, child.line)


def get_name(element: Element) -> str:
    """The tag without its namespace."""
    return element.tag.rpartition(":")[2]


def find_only(element: Element, name: str, path: Path) -> Element | None:
    """The child of this name, or None.  Raises :class:`SystemFileError` if there are several."""
    found = element.all(PREFIX + name)
    if len(found) > 1:
        raise SystemFileError(path, f"{get_name(element)} has more than one {name}", found[1].line)
    return found[0] if found else None


def find_text(root: Element, name: str, path: Path) -> Element | None:
    """The only child of this name, which has a text alone, or None.  Raises :class:`SystemFileError`."""
    element = find_only(root, name, path)
    if element is not None:
        check_element(element, path)
    return element


def list_checked(parent: Element | None, name: str, path: Path) -> list[Element]:
    """The children of the only child ``name``, each checked.  Raises :class:`SystemFileError`."""
    group = None if parent is None else find_only(parent, name, path)
    if group is None:
        return []
    check_element(group, path)
    for child in group.children:
        check_element(child, path)
    return group.children
