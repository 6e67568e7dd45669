"""What an SSD or SSV file may contain here: SSP 1.0 without the parts that tools disagree on.

One rule per element.  What the standard allows and this package cannot honour is refused with a way out,
never skipped; geometry, enumerations and unit definitions change nothing in a simulation and are passed
over.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from .errors import SystemFileError
from .xmlfile import Element


@dataclass(frozen=True)
class ElementRule:
    """Children, attributes that must be there and attributes that may be there."""

    children: frozenset[str] = frozenset()
    required: frozenset[str] = frozenset()
    optional: frozenset[str] = frozenset()


def _make_rule(children: str = "", required: str = "", optional: str = "") -> ElementRule:
    return ElementRule(frozenset(children.split()), frozenset(required.split()), frozenset(optional.split()))


_META = _make_rule(
    optional="id description author fileversion copyright license generationTool generationDateAndTime"
).optional

RULES = {
    "ssd:SystemStructureDescription": _make_rule(
        "ssd:System ssd:Enumerations ssd:Units ssd:DefaultExperiment ssd:Annotations", "version name"
    ),
    "ssd:System": _make_rule(
        "ssd:Connectors ssd:ElementGeometry ssd:ParameterBindings ssd:Elements ssd:Connections "
        "ssd:SystemGeometry ssd:GraphicalElements ssd:Annotations",
        "name",
    ),
    "ssd:Elements": _make_rule("ssd:Component"),
    "ssd:Component": _make_rule(
        "ssd:Connectors ssd:ElementGeometry ssd:ParameterBindings ssd:Annotations",
        "name source",
        "type implementation",
    ),
    "ssd:Connectors": _make_rule("ssd:Connector"),
    "ssd:Connector": _make_rule(
        "ssc:Real ssc:Integer ssc:Boolean ssc:String ssd:ConnectorGeometry ssd:Annotations", "name kind"
    ),
    "ssc:Real": _make_rule(optional="unit"),
    "ssc:Integer": _make_rule(),
    "ssc:Boolean": _make_rule(),
    "ssc:String": _make_rule(),
    "ssd:Connections": _make_rule("ssd:Connection"),
    "ssd:Connection": _make_rule(
        "ssd:ConnectionGeometry ssd:Annotations",
        "startElement startConnector endElement endConnector",
        "suppressUnitConversion",
    ),
    "ssd:ParameterBindings": _make_rule("ssd:ParameterBinding"),
    "ssd:ParameterBinding": _make_rule("ssd:ParameterValues ssd:Annotations", "", "type source sourceBase prefix"),
    "ssd:ParameterValues": _make_rule("ssv:ParameterSet"),
    "ssd:Annotations": _make_rule("ssc:Annotation"),
    "ssd:DefaultExperiment": _make_rule("ssd:Annotations", "", "startTime stopTime"),
    "ssv:ParameterSet": _make_rule("ssv:Parameters ssv:Enumerations ssv:Units ssv:Annotations", "version name"),
    "ssv:Parameters": _make_rule("ssv:Parameter"),
    "ssv:Parameter": _make_rule("ssv:Real ssv:Integer ssv:Boolean ssv:String ssv:Annotations", "name"),
    "ssv:Real": _make_rule("", "value", "unit"),
    "ssv:Integer": _make_rule("", "value"),
    "ssv:Boolean": _make_rule("", "value"),
    "ssv:String": _make_rule("", "value"),
}

REFUSED = {
    "ssd:System": "a system inside a system is not supported: list its components in the one system",
    "ssd:SignalDictionaryReference": "signal dictionaries are not supported: connect the components directly",
    "ssd:SignalDictionaries": "signal dictionaries are not supported: connect the components directly",
    "ssd:ParameterMapping": "parameter mappings are not supported: name the parameters as the FMU does",
    "ssc:LinearTransformation": "transformations are not supported: connect variables of the same unit",
    "ssc:BooleanMappingTransformation": "transformations are not supported: convert inside an FMU",
    "ssc:IntegerMappingTransformation": "transformations are not supported: convert inside an FMU",
    "ssc:EnumerationMappingTransformation": "transformations are not supported: convert inside an FMU",
    "ssc:Enumeration": "enumerations are not supported: use an Integer",
    "ssv:Enumeration": "enumerations are not supported: use an Integer",
    "ssc:Binary": "binary variables are not supported",
    "ssv:Binary": "binary parameters are not supported",
}

_SYSTEM_CONNECTOR = (
    "a connection to a connector of the system itself is not supported: name startElement and endElement"
)


def check_element(element: Element, path: Path) -> None:
    """Check the attributes and the children of one element against its rule.

    Raises :class:`SystemFileError` with the line for anything that is missing, unknown or not supported.
    """
    rule = RULES[element.tag]
    if missing := sorted(rule.required - element.attributes.keys()):
        advice = f" ({_SYSTEM_CONNECTOR})" if element.tag == "ssd:Connection" else ""
        text = f"{element.tag} has no attribute {', '.join(missing)}{advice}"
        raise SystemFileError(path, text, element.line)
    for name in element.attributes:
        if ":" not in name and name not in rule.required | rule.optional | _META:
            known = ", ".join(sorted(rule.required | rule.optional)) or "none"
            raise SystemFileError(
                path, f"{element.tag} has an unknown attribute {name!r}; known are: {known}", element.line
            )
    for child in element.children:
        if child.tag in rule.children:
            continue
        reason = REFUSED.get(child.tag, f"is not expected here; expected: {', '.join(sorted(rule.children))}")
        raise SystemFileError(path, f"{child.tag} in {element.tag}: {reason}", child.line)


def get_only_child(element: Element, tag: str, path: Path) -> Element | None:
    """The child of this tag, checked, or None.  Raises :class:`SystemFileError` if there are several."""
    found = element.all(tag)
    if len(found) > 1:
        raise SystemFileError(path, f"{element.tag} has more than one {tag}", found[1].line)
    if found:
        check_element(found[0], path)
    return found[0] if found else None
