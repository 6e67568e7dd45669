"""Check the wiring of a system against its FMUs, and find the orders that follow from it.

Checked: causality, types, units, several sources for one input, transformations, start values.  Orders: in which
initial values travel (from the dependencies of ``ModelStructure/InitialUnknowns``), and in which a Gauss-Seidel scheme
steps the FMUs.
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar

from fmpy.model_description import ModelDescription, ModelVariable

from .conversion import are_equal, combine, find_end, resolve_start_values
from .description import get_unit, index_variables
from .errors import WiringError
from .structure import Component, Connection, Connector, PortName, System, suggest_names
from .values import Conversion, End, Hop, Value


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
    loop of the initialisation; ``stepping``: components in Gauss-Seidel order; ``starts``: start values by component
    and variable, as their FMUs take them; ``conversions``: what the connection to an input does to the value, if
    anything; ``remarks``: what the files of the system say in vain.
    """

    connections: tuple[Connection, ...]
    open_inputs: tuple[OpenInput, ...]
    order: tuple[InitialGroup, ...]
    loops: tuple[tuple[PortName, ...], ...]
    stepping: tuple[str, ...]
    starts: Mapping[str, Mapping[str, Value]]
    conversions: Mapping[PortName, Conversion]
    remarks: tuple[str, ...] = ()


def check_wiring(
    system: System, descriptions: Mapping[str, ModelDescription], known: KnownVariables | None = None
) -> Wiring:
    """Check a system against the model descriptions of its components.

    ``known``: of the same descriptions, kept from an earlier check.  Raises :class:`WiringError` that lists everything
    that does not fit.
    """
    known = known or KnownVariables(descriptions)
    variables, ends = known.variables, known.ends
    problems, remarks = _check_instances(system, descriptions), [*system.remarks]
    starts: dict[str, dict[str, Value]] = {}
    for component in system.components:
        name = component.name
        problems += _check_connectors(component, ends[name], variables[name])
        starts[name], wrong, ignored = resolve_start_values(component, variables[name], ends[name])
        problems += wrong
        remarks += ignored
    sources: dict[PortName, Connection] = {}
    conversions: dict[PortName, Conversion] = {}
    for connection in system.connections:
        wrong = _check_connection(connection, variables)
        conversion, reason = _convert(connection, ends)
        problems += wrong or ([reason] if reason else [])
        if not conversion.changes_nothing:
            conversions[connection.target] = conversion
        if other := sources.get(connection.target):
            problems.append(
                f"{connection.where}: input {connection.target} already has the source {other.source} "
                f"({other.where}): remove one of the two"
            )
        sources[connection.target] = connection
    if problems:
        raise WiringError(system.path, problems)
    groups, loops = _find_initial_order(system, descriptions)
    pairs = [(c.source.component, c.target.component) for c in system.connections]
    stepping = find_strong_groups([c.name for c in system.components], pairs)
    return Wiring(
        system.connections,
        tuple(_list_open_inputs(system, variables, sources, starts)),
        tuple(groups),
        tuple(loops),
        tuple(name for group in stepping for name in group),
        starts,
        conversions,
        tuple(remarks),
    )


class KnownVariables:
    """What the FMUs say of their variables, by component and name; components of one FMU share it."""

    def __init__(self, descriptions: Mapping[str, ModelDescription]) -> None:
        shared: dict[int, tuple[dict[str, ModelVariable], dict[str, End]]] = {}
        for description in descriptions.values():
            if id(description) not in shared:
                variables = index_variables(description)
                ends = {name: find_end(variable, description) for name, variable in variables.items()}
                shared[id(description)] = variables, ends
        self.variables = {name: shared[id(description)][0] for name, description in descriptions.items()}
        self.ends = {name: shared[id(description)][1] for name, description in descriptions.items()}


def _check_instances(system: System, descriptions: Mapping[str, ModelDescription]) -> list[str]:
    problems = []
    loaded: dict[object, str] = {}
    for component in system.components:
        key = component.source.resolve()
        if descriptions[component.name].coSimulation.canBeInstantiatedOnlyOncePerProcess and key in loaded:
            problems.append(
                f"components {loaded[key]!r} and {component.name!r} both need {component.source.name}, of which a "
                "process can have only one instance: remove one of the two"
            )
        loaded.setdefault(key, component.name)
    return problems


def _check_connectors(
    component: Component, ends: Mapping[str, End], variables: Mapping[str, ModelVariable]
) -> list[str]:
    problems = []
    for connector in component.connectors:
        where = f"line {connector.line}: connector {component.name}.{connector.name}"
        if connector.name not in variables:
            hint = suggest_names(connector.name, variables)
            problems.append(f"{where}: there is no such variable in {component.source.name}{hint}")
            continue
        texts = _compare_connector(connector, variables[connector.name], ends[connector.name])
        problems += [f"{where}: {text}" for text in texts]
    return problems


def _compare_connector(connector: Connector, variable: ModelVariable, end: End) -> list[str]:
    problems = []
    if connector.kind not in (variable.causality, "inout", "unspecified"):
        problems.append(f"is declared {connector.kind}, in the FMU it is {variable.causality}")
    if connector.type not in (None, variable.type) and {connector.type, variable.type} != {"Integer", "Enumeration"}:
        problems.append(f"is declared {connector.type}, in the FMU it is {variable.type}")
    stated = connector.end.unit
    if stated is not None and end.unit is not None and stated.name != end.unit.name and not are_equal(stated, end.unit):
        problems.append(f"is declared in {stated.name!r}, in the FMU its unit is {end.unit.name!r}")
    return problems


def _check_connection(connection: Connection, variables: Mapping[str, Mapping[str, ModelVariable]]) -> list[str]:
    where = f"{connection.where}: connection {connection.source} -> {connection.target}"
    ends = [variables[port.component].get(port.variable) for port in (connection.source, connection.target)]
    if ends[0] is None or ends[1] is None:
        return []  # already reported with the connectors
    source, target = ends[0], ends[1]
    if source.causality == "input" and target.causality == "output":
        return [f"{where}: is written backwards: swap start and end"]
    problems = []
    if (source.causality, target.causality) not in _allowed():
        problems.append(
            f"{where}: must go from an output to an input, goes from {source.causality} to {target.causality}"
        )
    if source.type != target.type and {source.type, target.type} != {"Integer", "Enumeration"}:
        problems.append(f"{where}: the types differ, {source.type} and {target.type}")
    return problems


def _allowed() -> set[tuple[str, str]]:
    """Causalities that may be connected (SSP 1.0, section 5.3.2)."""
    always = {(source, "input") for source in ("output", "local", "calculatedParameter", "constant")}
    return always | {("calculatedParameter", "parameter"), ("constant", "parameter")}


def _convert(connection: Connection, ends: Mapping[str, Mapping[str, End]]) -> tuple[Conversion, str | None]:
    """The conversion of a connection, or the reason why there is none."""
    start, end = (ends[port.component].get(port.variable) for port in (connection.source, connection.target))
    if start is None or end is None:
        return Conversion(), None
    hops = connection.hops or (Hop(connection.where),)
    try:
        return combine(start, hops, end), None
    except ValueError as error:
        place, _, reason = str(error).partition(": ")
        return Conversion(), f"{place}: connection {connection.source} -> {connection.target}: {reason}"


def _list_open_inputs(
    system: System,
    variables: Mapping[str, Mapping[str, ModelVariable]],
    sources: Mapping[PortName, Connection],
    starts: Mapping[str, Mapping[str, Value]],
) -> list[OpenInput]:
    inputs = []
    for component in system.components:
        for name, variable in variables[component.name].items():
            port = PortName(component.name, name)
            if variable.causality == "input" and port not in sources:
                start = str(starts[component.name].get(name, variable.start))
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
    ports_of: dict[str, list[PortName]] = {}
    for port in ports:
        ports_of.setdefault(port.component, []).append(port)
    for name, own in ports_of.items():
        description = descriptions[name]
        inputs = [port for port in own if port in targets]
        listed = {unknown.variable.name: unknown.dependencies for unknown in description.initialUnknowns}
        for output in (port for port in own if port in sources):
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


Node = TypeVar("Node", bound=Hashable)


def find_strong_groups(nodes: Sequence[Node], edges: Sequence[tuple[Node, Node]]) -> list[list[Node]]:
    """Strongly connected groups, each after all groups that lead to it; ties keep the order of ``nodes``.

    Linear in nodes and edges, but for the order: among groups that do not lead to one another, the one that fewer nodes
    lead to comes first, for which each group has the set of those as the bits of an integer.
    """
    place = {node: index for index, node in enumerate(nodes)}
    following: list[list[int]] = [[] for _ in place]
    for start, end in edges:
        following[place[start]].append(place[end])
    components = _find_components(following)
    group_of = {index: number for number, group in enumerate(components) for index in group}
    leading = [sum(1 << index for index in group) for group in components]
    for number in range(len(components) - 1, -1, -1):  # a group is found after all that it leads to
        for index in components[number]:
            for target in following[index]:
                if group_of[target] != number:
                    leading[group_of[target]] |= leading[number]
    order = sorted(range(len(components)), key=lambda n: (leading[n].bit_count(), min(components[n])))
    return [[nodes[index] for index in sorted(components[number])] for number in order]


def _find_components(following: Sequence[Sequence[int]]) -> list[list[int]]:
    """Tarjan's algorithm without recursion: a chain of a thousand FMUs is no deeper than one."""
    number: dict[int, int] = {}
    lowest: dict[int, int] = {}
    waiting: list[int] = []
    is_waiting: set[int] = set()
    found = []
    for root in range(len(following)):
        path = [(root, iter(following[root]))] if root not in number else []
        while path:
            node, targets = path[-1]
            if node not in number:
                number[node] = lowest[node] = len(number)
                waiting.append(node)
                is_waiting.add(node)
            for target in targets:
                if target not in number:
                    path.append((target, iter(following[target])))
                    break
                if target in is_waiting:
                    lowest[node] = min(lowest[node], number[target])
            else:
                path.pop()
                if path:
                    above = path[-1][0]
                    lowest[above] = min(lowest[above], lowest[node])
                if lowest[node] == number[node]:
                    cut = _find_last(waiting, node)
                    group, waiting[cut:] = waiting[cut:], []
                    is_waiting -= set(group)
                    found.append(group)
    return found


def _find_last(waiting: Sequence[int], node: int) -> int:
    """Place of a node, which is near the end."""
    place = len(waiting) - 1
    while waiting[place] != node:
        place -= 1
    return place
