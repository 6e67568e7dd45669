"""What the descriptions of systems may contain here: SSP 1.0, of SSP 2.0 what FMI 2.0 can express, and libcosim's.

One rule per element.  What the standard allows and this package cannot honour is refused with a way out, never skipped;
geometry and metadata change nothing in a simulation and are passed over.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from ...files.xmlfile import Element
from ..errors import SystemFileError
from ..values import EXPONENTS, parse_real


class _Rule(NamedTuple):
    """Children, attributes that must be there, and attributes that may be there."""

    children: frozenset[str]
    required: frozenset[str]
    optional: frozenset[str]


def _make_rule(children: str = "", required: str = "", optional: str = "") -> _Rule:
    return _Rule(*(frozenset(names.split()) for names in (children, required, optional)))


_META = frozenset(
    ["id", "description", "author", "fileversion", "copyright", "license", "generationTool", "generationDateAndTime"]
)

# Types of SSP 2.0, which has those of FMI 3.0, as the types of FMI 2.0 that take their values.
_TYPES = {name: name for name in ("Real", "Integer", "Boolean", "String", "Enumeration")}
_TYPES |= {"Float64": "Real", "Float32": "Real"}
_TYPES |= {f"{sign}Int{bits}": "Integer" for sign in ("", "U") for bits in (8, 16, 32, 64)}

_TRANSFORMATIONS = (
    "ssc:LinearTransformation ssc:BooleanMappingTransformation ssc:IntegerMappingTransformation "
    "ssc:EnumerationMappingTransformation"
)
_TYPE_CHOICE = " ".join(f"ssc:{name}" for name in _TYPES)
_ELEMENT = "ssd:Connectors ssd:ElementGeometry ssd:ParameterBindings ssd:Annotations"
_PASSED_OVER = frozenset({"ssc:MetaData", "ssd:MetaData", "ssc:Signature", "ssd:Signature", "ssc:Annotations"})

_RULES = {
    "ssd:SystemStructureDescription": _make_rule(
        "ssd:System ssd:Enumerations ssd:Units ssd:DefaultExperiment ssd:Annotations", "version name"
    ),
    "ssd:System": _make_rule(
        f"{_ELEMENT} ssd:Elements ssd:Connections ssd:SignalDictionaries ssd:SystemGeometry ssd:GraphicalElements",
        "name",
    ),
    "ssd:Elements": _make_rule("ssd:Component ssd:System ssd:SignalDictionaryReference"),
    "ssd:Component": _make_rule(_ELEMENT, "name source", "type implementation"),
    "ssd:SignalDictionaryReference": _make_rule(_ELEMENT, "name dictionary"),
    "ssd:SignalDictionaries": _make_rule("ssd:SignalDictionary"),
    "ssd:SignalDictionary": _make_rule("ssb:SignalDictionary ssd:Annotations", "name", "type source"),
    "ssb:SignalDictionary": _make_rule("ssb:DictionaryEntry ssb:Enumerations ssb:Units ssb:Annotations", "version"),
    "ssb:DictionaryEntry": _make_rule(f"{_TYPE_CHOICE} ssb:Annotations", "name"),
    "ssd:Connectors": _make_rule("ssd:Connector"),
    "ssd:Connector": _make_rule(f"{_TYPE_CHOICE} ssd:ConnectorGeometry ssd:Annotations", "name kind"),
    "ssd:Connections": _make_rule("ssd:Connection"),
    "ssd:Connection": _make_rule(
        f"{_TRANSFORMATIONS} ssd:ConnectionGeometry ssd:Annotations",
        "startConnector endConnector",
        "startElement endElement suppressUnitConversion",
    ),
    "ssd:ParameterBindings": _make_rule("ssd:ParameterBinding"),
    "ssd:ParameterBinding": _make_rule(
        "ssd:ParameterValues ssd:ParameterMapping ssd:Annotations", "", "type source sourceBase prefix"
    ),
    "ssd:ParameterValues": _make_rule("ssv:ParameterSet"),
    "ssd:ParameterMapping": _make_rule("ssm:ParameterMapping", "", "type source sourceBase"),
    "ssm:ParameterMapping": _make_rule("ssm:MappingEntry ssm:Annotations", "version"),
    "ssm:MappingEntry": _make_rule(
        f"{_TRANSFORMATIONS} ssm:Annotations", "source target", "suppressUnitConversion"
    ),
    "ssc:LinearTransformation": _make_rule("", "", "factor offset"),
    "ssd:Annotations": _make_rule("ssc:Annotation"),
    "ssd:DefaultExperiment": _make_rule("ssd:Annotations", "", "startTime stopTime"),
    "ssc:Unit": _make_rule("ssc:BaseUnit", "name"),
    "ssc:BaseUnit": _make_rule("", "", f"{' '.join(EXPONENTS)} factor offset"),
    "ssc:Item": _make_rule("", "name value"),
    "ssd:Enumerations": _make_rule("ssc:Enumeration"),
    "ssd:Units": _make_rule("ssc:Unit"),
    "ssv:ParameterSet": _make_rule("ssv:Parameters ssv:Enumerations ssv:Units ssv:Annotations", "version name"),
    "ssv:Parameters": _make_rule("ssv:Parameter"),
    "ssv:Parameter": _make_rule(" ".join(f"ssv:{name}" for name in _TYPES) + " ssv:Annotations", "name"),
}
for _name, _kind in _TYPES.items():
    _own = {"Real": "unit", "Enumeration": "name"}.get(_kind, "")
    _RULES[f"ssc:{_name}"] = _make_rule(optional=_own)
    _RULES[f"ssv:{_name}"] = _make_rule("", "value", _own or "name")
for _name in _TRANSFORMATIONS.split()[1:]:
    _RULES[_name] = _make_rule("ssc:MapEntry")
_RULES["ssc:Enumeration"] = _make_rule("ssc:Item", "", "name")  # a type, which names one, or the enumeration itself
_RULES["ssc:MapEntry"] = _make_rule("", "source target")


OSP_VALUES = ("Real", "Integer", "Boolean", "String", "Enumeration")
"""Kinds of start values in libcosim's description."""


def _prefix(names: str) -> str:
    return " ".join(f"oss:{name}" for name in names.split())


_OSP = {
    "OspSystemStructure": (
        "Description StartTime EndTime BaseStepSize Algorithm Simulators Functions Connections EccoConfiguration",
        "", "version",
    ),
    **dict.fromkeys(("Description", "StartTime", "EndTime", "BaseStepSize", "Algorithm"), ("", "", "")),
    "Simulators": ("Simulator", "", ""),
    "Simulator": ("InitialValues", "name source", "stepSize"),
    "InitialValues": ("InitialValue", "", ""),
    "InitialValue": (" ".join(OSP_VALUES), "variable", ""),
    "Functions": ("LinearTransformation", "", ""),
    "LinearTransformation": ("", "name", "factor offset"),
    "Connections": ("VariableConnection SignalConnection", "", ""),
    "VariableConnection": ("Variable", "", "powerBond"),
    "SignalConnection": ("Variable Signal", "", ""),
    "Variable": ("", "simulator name", "causality"),
    "Signal": ("", "function name", ""),
    **dict.fromkeys(OSP_VALUES, ("", "value", "")),
}  # fmt: skip
_RULES |= {f"oss:{name}": _make_rule(_prefix(children), *others) for name, (children, *others) in _OSP.items()}

_GROUP = "is not supported: write a VariableConnection for each variable of the groups"
_REFUSED = {
    "ssc:Binary": "binary variables are not supported: FMI 2.0 has none",
    "ssv:Binary": "binary parameters are not supported: FMI 2.0 has none",
    "ssc:Clock": "clocks are not supported: FMI 2.0 has none",
    "ssd:Clock": "clocks are not supported: FMI 2.0 has none",
    "ssc:Dimension": "arrays are not supported: FMI 2.0 has scalar variables only",
    "ssd:Dimension": "arrays are not supported: FMI 2.0 has scalar variables only",
    "oss:Sum": "is not supported: let an FMU add",
    "oss:VectorSum": "is not supported: let an FMU add",
    "oss:VariableGroupConnection": _GROUP,
    "oss:SignalGroupConnection": _GROUP,
}


def check_element(element: Element, path: Path) -> None:
    """Check the attributes and the children of one element against its rule.

    Raises :class:`SystemFileError` with the line for anything that is missing, unknown or not supported.
    """
    rule, tag = _RULES[element.tag], show_tag(element.tag)
    free = frozenset() if element.tag.startswith("oss:") else _META
    if missing := sorted(rule.required - element.attributes.keys()):
        raise SystemFileError(path, f"{tag} has no attribute {', '.join(missing)}", element.line)
    known = rule.required | rule.optional
    for name in element.attributes:
        if ":" not in name and name not in known | free:
            text = f"{tag} has an unknown attribute {name!r}; known are: {', '.join(sorted(known)) or 'none'}"
            raise SystemFileError(path, text, element.line)
    for child in element.children:
        if child.tag in rule.children or (free and child.tag in _PASSED_OVER):
            continue
        expected = ", ".join(sorted(map(show_tag, rule.children))) or "nothing"
        reason = _REFUSED.get(child.tag, f"is not expected here; expected: {expected}")
        raise SystemFileError(path, f"{show_tag(child.tag)} in {tag}: {reason}", child.line)


def show_tag(tag: str) -> str:
    """A tag for messages: those of libcosim without prefix."""
    return tag.removeprefix("oss:")


def get_only_child(element: Element, tag: str, path: Path) -> Element | None:
    """The child of this tag, checked, or None.  Raises :class:`SystemFileError` if there are several."""
    found = element.all(tag)
    if len(found) > 1:
        text = f"{show_tag(element.tag)} has more than one {show_tag(tag)}"
        raise SystemFileError(path, text, found[1].line)
    if found:
        check_element(found[0], path)
    return found[0] if found else None


def list_checked(element: Element | None, tag: str, path: Path) -> list[Element]:
    """The children of the only child of this tag, each checked.  Raises :class:`SystemFileError`."""
    group = None if element is None else get_only_child(element, tag, path)
    children = [] if group is None else group.children
    for child in children:
        check_element(child, path)
    return children


def read_number(element: Element, name: str, path: Path) -> float | None:
    """A finite number in an attribute, None where it is not there.  Raises :class:`SystemFileError`."""
    text = element.attributes.get(name)
    value = None if text is None else parse_real(text)
    if text is not None and value is None:
        raise SystemFileError(path, f"{name}: expected a finite number, got {text!r}", element.line)
    return value


def check_version(root: Element, path: Path) -> None:
    """Raises :class:`SystemFileError` for the root element of a file that is of another version than 1.0 and 2.0."""
    version = root.attributes["version"]
    if version not in ("1.0", "2.0"):
        raise SystemFileError(path, f'version {version!r} is not read: write version "1.0" or "2.0"', root.line)


def get_type(tag: str) -> str:
    """Type of FMI 2.0 that an element such as ``ssc:Float64`` states."""
    return _TYPES[tag.partition(":")[2]]


def is_type(tag: str) -> bool:
    """Whether an element such as ``ssc:Real`` states a type."""
    return tag.partition(":")[2] in _TYPES
