"""The complete ``modelDescription.xml`` of a slave (FMI 2.0.4, chapter 2.2).

pythonfmu writes the frame; this adds what it leaves out: unit definitions, the dependencies of outputs and
initial unknowns, who made it.  The same class gives the same text, whenever and wherever.
"""

from __future__ import annotations

import hashlib
import os
import uuid
from collections.abc import Callable, Iterable
from datetime import UTC, datetime
from xml.etree.ElementTree import Element, SubElement, tostring

from pythonfmu.default_experiment import DefaultExperiment

from ... import __version__
from .buffer import BufferLayout
from .units import define_units
from .values import Values
from .variables import Port, make_fmi_variable

CAPABILITIES = {
    # The FMU carries its code, but no interpreter unless it is bundled: the target needs a Python with numpy.
    "needsExecutionTool": True,
    "canHandleVariableCommunicationStepSize": True,
    "canInterpolateInputs": False,
    "canBeInstantiatedOnlyOncePerProcess": False,
    "canGetAndSetFMUstate": True,
    "canSerializeFMUstate": True,
}

AUTHOR = "The ps_fmu developers"
LICENSE = "BSD-3-Clause"
COPYRIGHT = "Copyright (c) 2026, The ps_fmu developers"
DATE = datetime(2023, 2, 8, tzinfo=UTC)  # of the paper: builds of the same source have the same bytes


def model_description(slave: Values, pythonfmu_xml: Callable[[dict[str, str]], Element]) -> Element:
    """The ``fmiModelDescription`` of a slave that has just been instantiated.

    Parameters
    ----------
    slave: the instance.
    pythonfmu_xml: pythonfmu's own ``to_xml``, bound to it.
    """
    slave.vars.clear()
    for port in (*slave.layout.ports, *slave.layout.local):
        reference = slave.layout.reference[port.name]
        slave.vars[reference] = make_fmi_variable(port, reference)
    slave.description = slave.model_description or None
    slave.author, slave.license, slave.copyright, slave.version = AUTHOR, LICENSE, COPYRIGHT, __version__
    slave.default_experiment = DefaultExperiment(0.0, slave.default_stop, slave.default_step)

    root = pythonfmu_xml({name: str(value).lower() for name, value in CAPABILITIES.items()})
    if slave.provides_derivatives:
        _find_child(root, "CoSimulation").set("providesDirectionalDerivative", "true")
    root.set("generationTool", f"ps_fmu {__version__} with {root.get('generationTool')}")
    root.set("generationDateAndTime", _get_date().strftime("%Y-%m-%dT%H:%M:%SZ"))
    units = define_units(_list_units(slave.layout.ports))
    root.insert(list(root).index(_find_child(root, "CoSimulation")) + 1, units)
    _fill_structure(_find_child(root, "ModelStructure"), slave.layout)
    _mark_derivatives(_find_child(root, "ModelVariables"), slave.layout)
    root.set("guid", "")
    root.set("guid", make_guid(hashlib.sha256(tostring(root)).digest()))
    return root


def make_guid(digest: bytes) -> str:
    """A GUID that states a content: the same content has the same GUID."""
    return f"{{{uuid.UUID(bytes=digest[:16])}}}"


def _get_date() -> datetime:
    """The date of the build: that in SOURCE_DATE_EPOCH (s since 1970) if it is set, else a fixed one."""
    epoch = os.environ.get("SOURCE_DATE_EPOCH")
    return DATE if epoch is None else datetime.fromtimestamp(int(epoch), UTC)


def _list_units(ports: Iterable[Port]) -> list[str]:
    return list(dict.fromkeys(port.unit for port in ports if port.type == "Real"))


def _find_child(root: Element, tag: str) -> Element:
    child = root.find(tag)
    if child is None:
        raise RuntimeError(f"pythonfmu wrote no {tag} element")
    return child


def _mark_derivatives(variables: Element, layout: BufferLayout) -> None:
    """Of which variable each of the last ones is the derivative; as an index, see :func:`_fill_structure`."""
    n, first = len(layout.rates), len(layout.ports) + 1
    for k, variable in enumerate(list(variables)[len(variables) - n :]):
        variable[0].set("derivative", str(first + k))


def _fill_structure(structure: Element, layout: BufferLayout) -> None:
    """Outputs, Derivatives, InitialUnknowns, ascending.  An index is a variable's place in ModelVariables, from 1."""
    variables = (*layout.ports, *layout.local)
    index = {port.name: i for i, port in enumerate(variables, 1)}
    outputs = [port for port in layout.ports if port.causality == "output"]
    structure.clear()
    for tag, unknowns in (
        ("Outputs", outputs), ("Derivatives", layout.rates), ("InitialUnknowns", [*outputs, *layout.local])
    ):  # fmt: skip
        if not unknowns:
            continue
        element = SubElement(structure, tag)
        for port in unknowns:
            known = port.initially_depends_on if tag == "InitialUnknowns" else port.depends_on
            if port.causality == "local":
                known = None
            unknown = SubElement(element, "Unknown", index=str(index[port.name]))
            if known is not None:
                unknown.set("dependencies", " ".join(map(str, sorted(index[name] for name in known))))
