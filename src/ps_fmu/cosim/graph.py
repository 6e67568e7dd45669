"""Check the wiring of a system against its FMUs, and find the orders that follow from it.

Checked: names, causality, types, units, several sources for one input, names that tools confuse, start
values. Orders: in which initial values travel (from the dependencies of
``ModelStructure/InitialUnknowns``), and in which a Gauss-Seidel scheme steps the FMUs.
"""

from __future__ import annotations

import itertools
from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from fmpy.model_description import ModelDescription, ModelVariable

from .description import DISCRETE_TYPES, convert_value, explain_unsettable, get_unit, index_variables
from .errors import UsageError, WiringError
from .structure import Component, Connection, Connector, PortName, System, suggest_names

Node = TypeVar("Node", bound=Hashable)


@dataclass(frozen=True)
class OpenInput:
    """An input that nothing is connected to; it keeps its start value unless the user sets it."""

    port: PortName
    type: str
    unit: str | None
    start: str


@dataclass(frozen=True)
class InitialGroup:
    """Outputs whose initial values are passed on together, ``passes`` times (more than once in a loop)."""

    outputs: tuple[PortName, ...]
    passes: int


@dataclass(frozen=True)
class Wiring:
    """A system that has passed all checks.

    ``order``: outputs in the order in which initial values travel; ``loops``: the variables of each algebraic
    loop of the initialisation; ``stepping``: components in Gauss-Seidel order.
    """

    connections: tuple[Connection, ...]
    open_inputs: tuple[OpenInput, ...]
    order: tuple[InitialGroup, ...]
    loops: tuple[tuple[PortName, ...], ...]
    stepping: tuple[str, ...]


def check_wiring(system: System, descriptions: Mapping[str, ModelDescription]) -> Wiring:
    """Check a system against the model descriptions of its components.

    Raises :class:`WiringError` that lists everything that does not fit.
    """
    variables = {name: index_variables(description) for name, description in descriptions.items()}
    problems = _check_names(system, descriptions)
    for component in system.components:
        problems += _check_connectors(component, variables[component.name])
        problems += _check_parameters(component, variables[component.name])
    sources: dict[PortName, Connection] = {}
    for connection in system.connections:
        problems += _check_connection(connection, variables)
        if other := sources.get(connection.target):
            problems.append(
                f"line {connection.line}: input {connection.target} already has the source {other.source} "
                f"(line {other.line}): remove one of the two"
            )
        sources[connection.target] = connection
    if problems:
        raise WiringError(system.path, problems)
    groups, loops = _find_initial_order(system, descriptions)
    pairs = [(c.source.component, c.target.component) for c in system.connections]
    stepping = find_strong_groups([c.name for c in system.components], pairs)
    return Wiring(
        system.connections,
        tuple(_list_open_inputs(system, variables, sources)),
        tuple(groups),
        tuple(loops),
        tuple(name for group in stepping for name in group),
    )


def find_strong_groups(nodes: Sequence[Node], edges: Sequence[tuple[Node, Node]]) -> list[list[Node]]:
    """Strongly connected groups, each after all groups that lead to it; ties keep the order of ``nodes``."""
    place = {node: index for index, node in enumerate(nodes)}
    reach = np.eye(len(nodes), dtype=bool)
    for start, end in edges:
        reach[place[start], place[end]] = True
    for middle in range(len(nodes)):  # Warshall: paths through one more node at a time
        reach |= np.outer(reach[:, middle], reach[middle])
    ancestors = reach.sum(axis=0)  # equal within a group, smaller in every group that leads to it
    mutual = reach & reach.T
    groups: dict[int, list[Node]] = {}
    for index in sorted(range(len(nodes)), key=lambda i: (ancestors[i], int(np.argmax(mutual[i])), i)):
        groups.setdefault(int(np.argmax(mutual[index])), []).append(nodes[index])
    return list(groups.values())


def _check_names(system: System, descriptions: Mapping[str, ModelDescription]) -> list[str]:
    problems = []
    names = sorted(component.name for component in system.components)
    for shorter, longer in itertools.pairwise(names):
        if longer.startswith(shorter):
            problems.append(f"component {shorter!r} is a prefix of {longer!r}, which tools confuse: rename one")
    loaded: dict[object, str] = {}
    for component in system.components:
        key = component.source.resolve()
        if descriptions[component.name].coSimulation.canBeInstantiatedOnlyOncePerProcess and key in loaded:
            problems.append(
                f"components {loaded[key]!r} and {component.name!r} both need {component.source.name}, "
                "which can be instantiated only once per process"
            )
        loaded.setdefault(key, component.name)
    return problems


def _check_connectors(component: Component, variables: Mapping[str, ModelVariable]) -> list[str]:
    problems = []
    for connector in component.connectors:
        where = f"line {connector.line}: connector {component.name}.{connector.name}"
        if connector.name not in variables:
            hint = suggest_names(connector.name, variables)
            problems.append(f"{where}: {component.source.name} has no such variable{hint}")
            continue
        problems += [f"{where}: {text}" for text in _compare_connector(connector, variables[connector.name])]
    return problems


def _compare_connector(connector: Connector, variable: ModelVariable) -> list[str]:
    problems = []
    if connector.kind != variable.causality:
        problems.append(f"is declared {connector.kind}, in the FMU it is {variable.causality}")
    if connector.type not in (None, variable.type):
        problems.append(f"is declared {connector.type}, in the FMU it is {variable.type}")
    if connector.unit and get_unit(variable) and connector.unit != get_unit(variable):
        problems.append(f"is declared in {connector.unit!r}, in the FMU its unit is {get_unit(variable)!r}")
    return problems


def _check_parameters(component: Component, variables: Mapping[str, ModelVariable]) -> list[str]:
    problems = []
    for name, parameter in component.parameters.items():
        where = f"parameter {component.name}.{name} ({parameter.origin})"
        if name not in variables:
            hint = suggest_names(name, variables)
            problems.append(f"{where}: {component.source.name} has no such variable{hint}")
            continue
        variable = variables[name]
        if reason := explain_unsettable(variable, running=False):
            problems.append(f"{where}: {reason}")
        if parameter.unit and get_unit(variable) and parameter.unit != get_unit(variable):
            problems.append(f"{where}: is given in {parameter.unit!r}, its unit is {get_unit(variable)!r}")
        try:
            convert_value(variable, parameter.value)
        except UsageError as error:
            problems.append(f"{where}: {error}")
    return problems


def _check_connection(connection: Connection, variables: Mapping[str, Mapping[str, ModelVariable]]) -> list[str]:
    where = f"line {connection.line}: connection {connection.source} -> {connection.target}"
    ends = [variables[port.component].get(port.variable) for port in (connection.source, connection.target)]
    if ends[0] is None or ends[1] is None:
        return []  # already reported with the connectors
    source, target = ends[0], ends[1]
    if source.causality == "input" and target.causality == "output":
        return [f"{where}: is written backwards: swap start and end"]
    problems = []
    if source.causality != "output" or target.causality != "input":
        problems.append(
            f"{where}: must go from an output to an input, goes from {source.causality} to {target.causality}"
        )
    if source.type != target.type:
        problems.append(f"{where}: the types differ, {source.type} and {target.type}")
    elif source.type != "Real" and source.type not in DISCRETE_TYPES:
        problems.append(f"{where}: variables of type {source.type} cannot be connected")
    units = (get_unit(source), get_unit(target))
    if None not in units and units[0] != units[1]:
        problems.append(f"{where}: the units differ, {units[0]!r} and {units[1]!r}; nobody converts them")
    return problems


def _list_open_inputs(
    system: System, variables: Mapping[str, Mapping[str, ModelVariable]], sources: Mapping[PortName, Connection]
) -> list[OpenInput]:
    inputs = []
    for component in system.components:
        for name, variable in variables[component.name].items():
            port = PortName(component.name, name)
            if variable.causality == "input" and port not in sources:
                given = component.parameters.get(name)
                start = str(variable.start) if given is None else str(given.value)
                inputs.append(OpenInput(port, variable.type, get_unit(variable), start))
    return inputs


def _find_initial_order(
    system: System, descriptions: Mapping[str, ModelDescription]
) -> tuple[list[InitialGroup], list[tuple[PortName, ...]]]:
    """Initial values travel along connections, and inside an FMU from the inputs an output depends on.

    A loop is not solved but passed round as often as there are FMUs, the scheme that other tools use.
    """
    ports = list(dict.fromkeys(port for c in system.connections for port in (c.source, c.target)))
    edges = [(c.source, c.target) for c in system.connections]
    targets = {c.target for c in system.connections}
    sources = {c.source for c in system.connections}
    for name, description in descriptions.items():
        inputs = [port for port in ports if port.component == name and port in targets]
        listed = {unknown.variable.name: unknown.dependencies for unknown in description.initialUnknowns}
        for output in (port for port in ports if port.component == name and port in sources):
            # Without a list of dependencies an output may depend on everything.
            known = listed.get(output.variable)
            names = None if known is None else {variable.name for variable in known}
            edges += [(port, output) for port in inputs if names is None or port.variable in names]
    groups, loops = [], []
    for group in find_strong_groups(ports, edges):
        outputs = tuple(port for port in group if port in sources)
        if len(group) > 1:
            loops.append(tuple(group))
        if outputs:
            groups.append(InitialGroup(outputs, len(system.components) if len(group) > 1 else 1))
    return groups, loops
