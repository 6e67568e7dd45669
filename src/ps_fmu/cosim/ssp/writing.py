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
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path, PurePosixPath

from fmpy.model_description import ModelDescription

from ...slavekit.pack.files import write_zip
from ..description import index_variables, read_descriptions, read_start
from ..errors import SystemFileError, UsageError, WiringError
from ..graph import Wiring, check_wiring
from ..structure import COMPONENT_NAME, Component, Parameter, System, Value
from .reading import SSD_NAME
from .xml_parts import get_fmu_path, parameter_set_xml, parameters_place, structure_xml

_PLAIN = re.compile(r"[A-Za-z0-9_.-]+")


def write_ssp(system: System, output: Path) -> None:
    """Write a system, see :func:`read_system`, into the file ``output``; the same system gives the same bytes.

    Raises
    ------
    WiringError, SystemFileError: the parts do not fit together, or an FMU cannot be read.
    UsageError: the system states no step or stop time, which libcosim cannot do without.
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
    for component in system.components:
        content = component.source.read_bytes()
        if files.setdefault(_place(component), content) != content:
            text = f"another component has a different file {component.source.name}: rename one of the two"
            raise SystemFileError(component.source, text)
        own_inputs = [port.variable for port in open_inputs if port.component == component.name]
        values = choose_values(component, descriptions[component.name], own_inputs, wiring.starts[component.name])
        files[PurePosixPath(parameters_place(component))] = parameter_set_xml(values, descriptions[component.name])
    files[PurePosixPath(SSD_NAME)] = structure_xml(system, descriptions, system.labels, step, stop_time)
    write_zip(output, files)


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
