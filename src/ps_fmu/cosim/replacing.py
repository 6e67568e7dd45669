"""FMUs in place of components of a system: the same names are wired; a remark names what does not fit."""

from __future__ import annotations

import textwrap
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from fmpy.model_description import ModelDescription

from .description import get_unit, index_variables, read_description
from .errors import UsageError
from .structure import Component, Connection, Connector, PortName, System, list_names


def replace_components(system: System, fmus: Mapping[str, Path]) -> System:
    """The system with other FMUs for some components, by their names.

    A variable of the new FMU takes over the connections and the start values of the variable of the same name.  What
    has no such variable is left out.  An input that the old FMU did not have is connected with the output of this name,
    where the other components have exactly one.  ``remarks`` of the system name all that, and what nothing feeds.

    Raises
    ------
    UsageError: no component has this name, or no connection is left.
    SystemFileError: an FMU cannot be read.
    """
    for name, path in fmus.items():
        system = _replace(system, system.component(name), path)
    return system


def _replace(system: System, old: Component, path: Path) -> System:
    description = read_description(path, lenient=True)
    known = frozenset(index_variables(description))

    def fits(port: PortName) -> bool:
        return port.component != old.name or port.variable in known

    wires = [wire for wire in system.connections if fits(wire.source) and fits(wire.target)]
    cut = [wire for wire in system.connections if not (fits(wire.source) and fits(wire.target))]
    lost = dict.fromkeys(wire.source.variable for wire in cut if not fits(wire.source))
    if lost and not any(wire.source.component == old.name for wire in wires):
        raise UsageError(
            f"--replace: {path.name} cannot take the place of {old.name}: expected a connected output:\n"
            f"  {list_names(list(lost))}"
        )
    left = [name for name in old.parameters if name not in known]
    fed = {wire.target.variable for wire in wires if wire.target.component == old.name}
    before = _list_inputs(read_description(old.source, lenient=True)) - fed - {wire.target.variable for wire in cut}
    unfed = sorted(_list_inputs(description) - fed - before)
    new_wires = [
        Connection(sources[0], PortName(old.name, name), 0, file=path.name)
        for name in unfed
        if len(sources := _find_outputs(system, old, name)) == 1
    ]
    lines = [
        f"{old.name} is {path.name} in place of {old.source.name}",
        *_list("new connections by name", [_show(wire) for wire in new_wires]),
        *_list("connections left out, for there is no such variable", [_show(wire) for wire in cut]),
        *_list("inputs without a connection", sorted({*unfed} - {wire.target.variable for wire in new_wires})),
        *_list("values left out, for there is no such variable", left),
    ]
    parameters = {name: entry for name, entry in old.parameters.items() if name in known}
    new = replace(old, source=path.absolute(), connectors=(), variables=known, parameters=parameters)
    components = [new if component is old else component for component in system.components]
    ports = {port for wire in (*wires, *new_wires) for port in (wire.source, wire.target)}
    inputs = [replace(one, targets=tuple(each for each in one.targets if fits(each[0]))) for one in system.inputs]
    return replace(
        system,
        components=tuple(_add_connectors(component, ports) for component in components),
        connections=(*wires, *new_wires),
        inputs=tuple(one for one in inputs if one.targets),
        outputs=tuple(one for one in system.outputs if fits(one.source)),
        remarks=(*system.remarks, "\n".join(lines)),
    )


def _add_connectors(component: Component, ports: Collection[PortName]) -> Component:
    """The component with connectors for all its variables that are connected."""
    there = {connector.name for connector in component.connectors}
    wanted = sorted(port.variable for port in ports if port.component == component.name and port.variable not in there)
    if not wanted:
        return component
    variables = index_variables(read_description(component.source, lenient=True))
    found = [variables[name] for name in wanted if name in variables]
    added = [Connector(one.name, one.causality, one.type, get_unit(one), 0) for one in found]
    return replace(component, connectors=(*component.connectors, *added))


def _find_outputs(system: System, old: Component, name: str) -> list[PortName]:
    """Outputs of this name of the other components."""
    return [
        PortName(other.name, name)
        for other in system.components
        if other is not old
        for variable in [index_variables(read_description(other.source, lenient=True)).get(name)]
        if variable is not None and variable.causality == "output"
    ]


def _list_inputs(description: ModelDescription) -> set[str]:
    return {variable.name for variable in description.modelVariables if variable.causality == "input"}


def _show(wire: Connection) -> str:
    return f"{wire.source} -> {wire.target}"


def _list(what: str, names: Sequence[str]) -> list[str]:
    """A line with a few of the names and the number of the others, wrapped; none without names."""
    text = f"{what}: {list_names(names)}"
    return [textwrap.fill(text, 100, initial_indent="- ", subsequent_indent="  ")] if names else []
