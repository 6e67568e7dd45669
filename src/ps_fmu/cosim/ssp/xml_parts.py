"""The XML files of an SSP archive (SSP 1.0), in the one form that FMPy, libcosim, Ecos and OMSimulator all load.

The prefixes ``ssd:``, ``ssc:``, ``ssv:`` are written out: some tools compare them as text.  The annotations carry the
communication step to libcosim (``com.opensimulationplatform``) and OMSimulator (``org.openmodelica``).
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Mapping
from xml.etree.ElementTree import Element, SubElement, indent, tostring

from fmpy.model_description import ModelDescription, ModelVariable, Unit

from ..description import get_unit, index_variables
from ..structure import Component, Parameter, System
from .reading import FMU_TYPE, PARAMETER_TYPE

PARAMETER_SET = "initialValues"
"""Name of every parameter set: libcosim takes the set of this name, Ecos the one it is told."""

_SSP = "http://ssp-standard.org/SSP1/SystemStructure"
_STRUCTURE_SPACES = {
    "xmlns:ssd": f"{_SSP}Description",
    "xmlns:ssc": f"{_SSP}Common",
    "xmlns:ssv": f"{_SSP}ParameterValues",
    "xmlns:osp": "http://opensimulationplatform.com/SSP/OSPAnnotations",
    "xmlns:oms": "https://raw.githubusercontent.com/OpenModelica/OMSimulator/master/schema/oms.xsd",
}
_SET_SPACES = {name: _STRUCTURE_SPACES[name] for name in ("xmlns:ssv", "xmlns:ssc")}
_TYPES = {name: name for name in ("Real", "Integer", "Boolean", "String")} | {"Enumeration": "Integer"}
_EXPONENTS = ("kg", "m", "s", "A", "K", "mol", "cd", "rad")


def get_fmu_path(component: Component) -> str:
    """Place of a component's FMU in the archive."""
    return f"resources/{component.source.name}"


def parameters_place(component: Component) -> str:
    """Place of a component's parameter set in the archive."""
    return f"resources/{component.name}.ssv"


def structure_xml(
    system: System,
    descriptions: Mapping[str, ModelDescription],
    names: Mapping[str, str],
    step: float,
    stop_time: float,
) -> bytes:
    """``SystemStructure.ssd`` of a system whose wiring has been checked.

    Parameters
    ----------
    system, descriptions: the system, and the model description of each of its components
    names: ``name`` of the system, perhaps ``description``
    step, stop_time: communication step and end of the default experiment [s]
    """
    root = Element("ssd:SystemStructureDescription", {**_STRUCTURE_SPACES, "version": "1.0", "name": names["name"]})
    top = SubElement(root, "ssd:System", dict(names))
    elements = SubElement(top, "ssd:Elements")
    ends = {end for c in system.connections for end in (c.source, c.target)}
    units: dict[str, Unit] = {}
    for component in system.components:
        connected = {end.variable for end in ends if end.component == component.name}
        _add_component(elements, component, descriptions[component.name], connected, units)
    connections = SubElement(top, "ssd:Connections")
    for c in system.connections:
        SubElement(
            connections,
            "ssd:Connection",
            startElement=c.source.component,
            startConnector=c.source.variable,
            endElement=c.target.component,
            endConnector=c.target.variable,
        )
    _add_master(top, step)
    _add_units(root, "ssd:Units", units.values())
    start = repr(system.experiment.start_time)
    experiment = SubElement(root, "ssd:DefaultExperiment", startTime=start, stopTime=repr(stop_time))
    algorithm = SubElement(_annotation(experiment, "com.opensimulationplatform"), "osp:Algorithm")
    SubElement(algorithm, "osp:FixedStepAlgorithm", baseStepSize=repr(step))
    return _text(root)


def _add_component(
    elements: Element,
    component: Component,
    description: ModelDescription,
    connected: Collection[str],
    units: dict[str, Unit],
) -> None:
    """A component with its connected ports; adds the units of these to ``units``.

    It has an annotation only for a step of its own: OMSimulator refuses a system in which a component has any.
    """
    variables = index_variables(description)
    element = SubElement(
        elements,
        "ssd:Component",
        name=component.name,
        type=FMU_TYPE,
        implementation="CoSimulation",
        source=get_fmu_path(component),
    )
    connectors = SubElement(element, "ssd:Connectors")
    for port in component.connectors:
        if port.name in connected:
            variable = variables[port.name]
            connector = SubElement(connectors, "ssd:Connector", name=port.name, kind=variable.causality)
            SubElement(connector, f"ssc:{_TYPES[variable.type]}", _unit(variable, description, units))
    bindings = SubElement(element, "ssd:ParameterBindings")
    SubElement(bindings, "ssd:ParameterBinding", type=PARAMETER_TYPE, source=parameters_place(component))
    if component.step is not None:
        SubElement(_annotation(element, "com.opensimulationplatform"), "osp:StepSizeHint", value=repr(component.step))


def _add_master(top: Element, step: float) -> None:
    """OMSimulator's master algorithm; its tolerances have no effect at a fixed step, but its schema asks for them."""
    annotations = SubElement(_annotation(top, "org.openmodelica"), "oms:Annotations")
    SubElement(
        SubElement(annotations, "oms:SimulationInformation"),
        "oms:FixedStepMaster",
        description="oms-ma",
        stepSize=repr(step),
        absoluteTolerance="1e-4",
        relativeTolerance="1e-4",
    )


def parameter_set_xml(values: Mapping[str, Parameter], description: ModelDescription) -> bytes:
    """A ``.ssv`` file with bare variable names; the values have the FMI types of the variables."""
    variables = index_variables(description)
    root = Element("ssv:ParameterSet", {**_SET_SPACES, "version": "1.0", "name": PARAMETER_SET})
    parameters = SubElement(root, "ssv:Parameters")
    units: dict[str, Unit] = {}
    for name, entry in values.items():
        variable = variables[name]
        text = str(entry.value).lower() if variable.type == "Boolean" else str(entry.value)
        attributes = {"value": text} | _unit(variable, description, units)
        element = SubElement(parameters, "ssv:Parameter", name=name)
        SubElement(element, f"ssv:{_TYPES[variable.type]}", attributes)
        _add_notes(element, entry)
    _add_units(root, "ssv:Units", units.values())
    return _text(root)


def real_values_xml(values: Mapping[str, float]) -> bytes:
    """A ``.ssv`` file for ``--parameters``: Reals by ``component.parameter``, in the units of the variables."""
    root = Element("ssv:ParameterSet", {"xmlns:ssv": _SET_SPACES["xmlns:ssv"], "version": "1.0", "name": PARAMETER_SET})
    parameters = SubElement(root, "ssv:Parameters")
    for name, value in values.items():
        SubElement(SubElement(parameters, "ssv:Parameter", name=name), "ssv:Real", value=repr(float(value)))
    return _text(root)


def start_values_xml(values: Mapping[str, Parameter], about: str) -> bytes:
    """A ``.ssv`` file for ``--parameters``: values by ``component.parameter`` with their units and notes.

    ``about``: a comment for the head of the file.
    """
    root = Element("ssv:ParameterSet", {**_SET_SPACES, "version": "1.0", "name": PARAMETER_SET})
    parameters = SubElement(root, "ssv:Parameters")
    kinds = {bool: "Boolean", int: "Integer", float: "Real", str: "String"}
    for name, entry in values.items():
        element = SubElement(parameters, "ssv:Parameter", name=name)
        text = str(entry.value).lower() if isinstance(entry.value, bool) else str(entry.value)
        unit = {} if entry.unit is None else {"unit": entry.unit}
        SubElement(element, f"ssv:{kinds[type(entry.value)]}", {"value": text, **unit})
        _add_notes(element, entry)
    head, _, rest = _text(root).partition(b"\n")
    comment = re.sub("-(?=-)", "- ", about)  # two hyphens end a comment
    return head + f"\n<!-- {comment} -->\n".encode() + rest


def _add_notes(element: Element, entry: Parameter) -> None:
    if entry.notes:
        group = SubElement(element, "ssv:Annotations")
        for note in sorted(entry.notes):
            SubElement(group, "ssc:Annotation", type=note)


def _unit(variable: ModelVariable, description: ModelDescription, used: dict[str, Unit]) -> dict[str, str]:
    """The attribute ``unit``, where SSP can define it (units with SI exponents); adds the unit to ``used``."""
    name = get_unit(variable)
    for unit in description.unitDefinitions:
        if variable.type == "Real" and unit.name == name and unit.baseUnit is not None:
            used.setdefault(unit.name, unit)
            return {"unit": unit.name}
    return {}


def _add_units(root: Element, tag: str, units: Iterable[Unit]) -> None:
    group = Element(tag)
    for unit in units:
        neutral = dict.fromkeys(_EXPONENTS, 0) | {"factor": 1.0, "offset": 0.0}
        stated = {name: float(getattr(unit.baseUnit, name)) for name in neutral}
        attributes = {name: f"{value:.17g}" for name, value in stated.items() if value != neutral[name]}
        SubElement(SubElement(group, "ssc:Unit", name=unit.name), "ssc:BaseUnit", attributes)
    if len(group):
        root.append(group)


def _annotation(parent: Element, kind: str) -> Element:
    return SubElement(SubElement(parent, "ssd:Annotations"), "ssc:Annotation", type=kind)


def _text(root: Element) -> bytes:
    indent(root)
    return b'<?xml version="1.0" encoding="UTF-8"?>\n' + tostring(root, encoding="utf-8") + b"\n"
