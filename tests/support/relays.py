"""Systems of relays (tests/cosim/toys/toy_relay.py) as SSP, and relays with units and enumerations of their own."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from xml.etree import ElementTree

from support.archives import DESCRIPTION, rewrite
from support.cosim import HEAD

NAMES = ("real", "level", "whole", "flag", "text")
KINDS = dict(zip(NAMES, ("Real", "Real", "Integer", "Boolean", "String"), strict=True))
BASES = {
    "m": {"m": "1"}, "mm": {"m": "1", "factor": "0.001"}, "s": {"s": "1"},
    "K": {"K": "1"}, "degC": {"K": "1", "offset": "273.15"},
}  # fmt: skip
UNITS = "".join(
    f'<ssc:Unit name="{name}"><ssc:BaseUnit {" ".join(f"{k}={v!r}" for k, v in base.items())}/></ssc:Unit>'
    for name, base in BASES.items()
)
PORTS = "".join(
    f'<ssd:Connector name="{name}_{way}" kind="{way}put"><ssc:{KINDS[name]}/></ssd:Connector>\n'
    for name in NAMES
    for way in ("in", "out")
)

LINEAR = '<ssc:LinearTransformation factor="2" offset="3"/>'
TABLE = (
    '<ssc:IntegerMappingTransformation><ssc:MapEntry source="1" target="2"/><ssc:MapEntry source="2" target="9"/>'
    "</ssc:IntegerMappingTransformation>"
)


def relay(name: str, bindings: str = "", source: str = "ToyRelay.fmu", ports: str = PORTS) -> str:
    """A component."""
    inside = f"<ssd:ParameterBindings>{bindings}</ssd:ParameterBindings>" if bindings else ""
    return (
        f'<ssd:Component name="{name}" source="resources/{source}"><ssd:Connectors>{ports}</ssd:Connectors>{inside}'
        "</ssd:Component>\n"
    )


def wire(start: str, end: str, inside: str = "", **attributes: str) -> str:
    """A connection ``element/connector``; without an element a connector of the system."""
    text = ""
    for side, port in (("start", start), ("end", end)):
        element, _, connector = port.rpartition("/")
        text += f' {side}Element="{element}"' if element else ""
        text += f' {side}Connector="{connector}"'
    text += "".join(f' {name}="{value}"' for name, value in attributes.items())
    return f"<ssd:Connection{text}>{inside}</ssd:Connection>\n"


def port(name: str, kind: str, type_: str = "<ssc:Real/>") -> str:
    """A connector of a system."""
    return f'<ssd:Connector name="{name}" kind="{kind}">{type_}</ssd:Connector>\n'


def system(elements: str, wires: str = "", ports: str = "", bindings: str = "", more: str = "") -> str:
    """What is inside of a system."""
    text = f"<ssd:Connectors>{ports}</ssd:Connectors>" if ports else ""
    text += f"<ssd:ParameterBindings>{bindings}</ssd:ParameterBindings>" if bindings else ""
    return f"{text}<ssd:Elements>\n{elements}</ssd:Elements><ssd:Connections>\n{wires}</ssd:Connections>{more}\n"


def description(inside: str, after: str = "") -> str:
    """A whole description, with units."""
    head = HEAD.replace(
        "    version=",
        '    xmlns:ssm="http://ssp-standard.org/SSP1/SystemStructureParameterMapping"\n'
        '    xmlns:ssb="http://ssp-standard.org/SSP1/SystemStructureSignalDictionary"\n    version=',
    )
    return (
        f"{head}{inside}</ssd:System>{after}<ssd:Units>{UNITS}</ssd:Units></ssd:SystemStructureDescription>"
    )


def make_chain(
    inside: str, name: str = "real", first: str = "ToyRelay.fmu", second: str = "ToyRelay.fmu", **attributes: str
) -> str:
    """The description of two relays and one connection between them."""
    both = relay("a", source=first) + relay("b", source=second)
    return description(system(both, wire(f"a/{name}_out", f"b/{name}_in", inside, **attributes)))


def binding(values: str, attributes: str = "", more: str = "", units: str = "") -> str:
    """A parameter binding with values inline, ``name=Real:1.5 name=Integer:3``, perhaps ``Real:1.5:mm``."""
    entries = ""
    for item in values.split():
        name, _, value = item.partition("=")
        kind, text, unit = [*value.split(":"), ""][:3]
        stated = f' unit="{unit}"' if unit else ""
        entries += f'<ssv:Parameter name="{name}"><ssv:{kind} value="{text}"{stated}/></ssv:Parameter>\n'
    return (
        f'<ssd:ParameterBinding {attributes}><ssd:ParameterValues><ssv:ParameterSet version="1.0" name="set">'
        f"<ssv:Parameters>{entries}</ssv:Parameters>{units}</ssv:ParameterSet></ssd:ParameterValues>{more}"
        "</ssd:ParameterBinding>\n"
    )


def mapping(*entries: str) -> str:
    """A parameter mapping inline, ``source>target`` and perhaps ``>XML``."""
    text = ""
    for entry in entries:
        source, target, inside = [*entry.split(">", 2), ""][:3]
        text += f'<ssm:MappingEntry source="{source}" target="{target}">{inside}</ssm:MappingEntry>'
    inside = f'<ssm:ParameterMapping version="1.0">{text}</ssm:ParameterMapping>'
    return f"<ssd:ParameterMapping>{inside}</ssd:ParameterMapping>"


def make_relay(
    plain: Path, target: Path, units: Mapping[str, str] | None = None, items: Sequence[tuple[str, int]] = ()
) -> Path:
    """A relay whose Reals have units, by variable, and whose Integers are an enumeration."""

    def change(files: dict[str, bytes]) -> None:
        files[DESCRIPTION] = _change(files[DESCRIPTION], units or {}, items)

    return rewrite(plain, target, change)


def _change(data: bytes, units: Mapping[str, str], items: Sequence[tuple[str, int]]) -> bytes:
    root = ElementTree.fromstring(data)
    place = next(i for i, child in enumerate(root) if child.tag == "CoSimulation") + 1
    if items:
        types = ElementTree.Element("TypeDefinitions")
        kind = ElementTree.SubElement(ElementTree.SubElement(types, "SimpleType", name="Choice"), "Enumeration")
        for name, value in items:
            ElementTree.SubElement(kind, "Item", name=name, value=str(value))
        root.insert(place, types)
    if units:
        group = ElementTree.Element("UnitDefinitions")
        for name in sorted(set(units.values())):
            ElementTree.SubElement(ElementTree.SubElement(group, "Unit", name=name), "BaseUnit", BASES[name])
        root.insert(place, group)
    for variable in root.iter("ScalarVariable"):
        value = variable[0]
        if variable.get("name") in units:
            value.set("unit", units[variable.get("name", "")])
        if value.tag == "Integer" and items:
            value.tag = "Enumeration"
            value.set("declaredType", "Choice")
            if "start" in value.attrib:
                value.set("start", str(items[0][1]))
    return ElementTree.tostring(root)
