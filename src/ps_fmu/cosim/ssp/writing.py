"""Write a system as one file: an SSP 1.0 archive with the wiring, the FMUs and the start values.

Each component has one parameter set of its own.  It holds what somebody who runs the file in a simulator may want to
choose: the inputs that no connection feeds, the switches and counts (Boolean and Integer parameters), and whatever the
system states.  Real parameters that keep their value stay in the FMU alone, where they have description and bounds: a
copy of two hundred masses and frequencies would only hide the few values that matter, and go out of date.

A variant of a system is another archive, with other values in the same sets.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Collection, Iterable, Mapping
from dataclasses import replace
from pathlib import Path, PurePosixPath
from xml.etree.ElementTree import Element, SubElement, indent, tostring

from fmpy.model_description import ModelDescription, ModelVariable, Unit

from ...files.archive import write_zip
from ..description import get_unit, index_variables, read_descriptions, read_start
from ..errors import SystemFileError, UsageError, WiringError
from ..graph import Wiring, check_wiring
from ..structure import COMPONENT_NAME, Component, Parameter, System, Value
from ..values import EXPONENTS
from .packing import pack_files
from .reading import FMU_TYPE, PARAMETER_TYPE, SSD_NAME

_PLAIN = re.compile(r"[A-Za-z0-9_.-]+")


def write_ssp(system: System, output: Path) -> tuple[str, ...]:
    """Write a system, see :func:`read_system`, into the file ``output``; the same system gives the same bytes.

    Files that text parameters name are packed into the FMUs.  Returns a line of text for each file that cannot be
    packed.

    Raises
    ------
    WiringError, SystemFileError: the parts do not fit together, or an FMU cannot be read.
    UsageError: the system states no step or stop time, which libcosim needs.
    OSError: the file cannot be written.
    """
    step, stop_time = system.experiment.step, system.experiment.stop_time
    if step is None or stop_time is None:
        missing = "step" if step is None else "stop time"
        raise UsageError(f"{system.path} states no {missing} in its default experiment: an archive needs one")
    descriptions = read_descriptions(system)
    wiring = check_wiring(system, descriptions)
    _check_dialect(system, wiring)
    open_inputs = [item.port for item in wiring.open_inputs]

    files: dict[PurePosixPath, bytes] = {}
    packed = pack_files(system.components)
    for component in packed.components:
        content = packed.fmus[component.source]
        if files.setdefault(_place(component), content) != content:
            text = f"another component has a different file {component.source.name}: rename one of the two"
            raise SystemFileError(component.source, text)
        own_inputs = [port.variable for port in open_inputs if port.component == component.name]
        starts = {
            name: component.parameters[name].value if isinstance(value, str) and name in component.parameters else value
            for name, value in wiring.starts[component.name].items()
        }
        values = choose_values(component, descriptions[component.name], own_inputs, starts)
        files[PurePosixPath(parameters_place(component))] = parameter_set_xml(values, descriptions[component.name])
    files[PurePosixPath(SSD_NAME)] = structure_xml(system, descriptions, system.labels, step, stop_time)
    write_zip(output, files)
    return packed.left


def choose_values(
    component: Component, description: ModelDescription, open_inputs: Iterable[str], starts: Mapping[str, Value]
) -> dict[str, Parameter]:
    """Start values that go into the component's parameter set, in the order of the model description.

    ``starts``: those of the system as the FMU takes them.
    """
    inputs = set(open_inputs)
    chosen = {}
    for name, variable in index_variables(description).items():
        switch = variable.causality == "parameter" and variable.type in ("Boolean", "Integer")
        if name in component.parameters:
            chosen[name] = replace(component.parameters[name], value=starts[name])
        elif (name in inputs or switch) and variable.start is not None:
            chosen[name] = Parameter(read_start(variable), variable.unit, "start value of the FMU")
    return chosen


def _check_dialect(system: System, wiring: Wiring) -> None:
    """Raises :class:`WiringError` for what other tools confuse, leave out or do wrong."""
    names = sorted(component.name for component in system.components)
    problems = [
        f"component {name!r}: letters, digits and _ only, no digit first, as other tools want"
        for name in names
        if not COMPONENT_NAME.fullmatch(name)
    ]
    for shorter, longer in itertools.pairwise(names):
        if longer.startswith(shorter):
            problems.append(f"component {shorter!r} is a prefix of {longer!r}, which tools confuse: rename one")
    problems += [
        f"{c.where}: connection {c.source} -> {c.target}: converts the value, which other tools do not or do wrong"
        for c in system.connections
        if c.target in wiring.conversions
    ]
    if problems:
        raise WiringError(system.path, problems)


def _place(component: Component) -> PurePosixPath:
    if not _PLAIN.fullmatch(component.source.name):
        text = "the name of an FMU in an archive may have letters, digits, _, - and . only"
        raise SystemFileError(component.source, text)
    return PurePosixPath(get_fmu_path(component))


# ---- the XML files, in the one form that FMPy, libcosim, Ecos and OMSimulator all load ------------------------------


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
    root, parameters = _begin_set()
    units: dict[str, Unit] = {}
    for name, entry in values.items():
        variable = variables[name]
        _add_value(parameters, name, _TYPES[variable.type], entry, _unit(variable, description, units))
    _add_units(root, "ssv:Units", units.values())
    return _text(root)


def real_values_xml(values: Mapping[str, float]) -> bytes:
    """A ``.ssv`` file for ``--parameters``: Reals by ``component.parameter``, in the units of the variables."""
    return start_values_xml({name: Parameter(float(value), None, "") for name, value in values.items()})


def start_values_xml(values: Mapping[str, Parameter], about: str = "") -> bytes:
    """A ``.ssv`` file for ``--parameters``: values by ``component.parameter`` with their units and notes.

    ``about``: a comment for the head of the file.
    """
    root, parameters = _begin_set()
    kinds = {bool: "Boolean", int: "Integer", float: "Real", str: "String"}
    for name, entry in values.items():
        unit = {} if entry.unit is None else {"unit": entry.unit}
        _add_value(parameters, name, kinds[type(entry.value)], entry, unit)
    head, _, rest = _text(root).partition(b"\n")
    comment = re.sub("-(?=-)", "- ", about)  # two hyphens end a comment
    return head + (f"\n<!-- {comment} -->\n" if about else "\n").encode() + rest


def _begin_set() -> tuple[Element, Element]:
    """The root of a parameter set, and the element of its parameters."""
    root = Element("ssv:ParameterSet", {**_SET_SPACES, "version": "1.0", "name": PARAMETER_SET})
    return root, SubElement(root, "ssv:Parameters")


def _add_value(parameters: Element, name: str, kind: str, entry: Parameter, unit: dict[str, str]) -> None:
    text = str(entry.value).lower() if kind == "Boolean" else str(entry.value)
    element = SubElement(parameters, "ssv:Parameter", name=name)
    SubElement(element, f"ssv:{kind}", {"value": text} | unit)
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
        neutral = dict.fromkeys(EXPONENTS, 0) | {"factor": 1.0, "offset": 0.0}
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
