"""A tree of systems as one flat system: components, connections from output to input, and start values.

A component in a system inside the system is called ``system.component``.  What lies between an output and an input -
connectors of systems, signal dictionaries - becomes hops of one connection.  Which way a value goes, the kinds of the
two connectors say and not which of them is written first (SSP 1.0, section 5.3.2).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import NamedTuple

from ..errors import SystemFileError, UsageError
from ..structure import Component, Connection, Connector, Parameter, PortName, SystemInput, SystemOutput, suggest_names
from ..values import End, Hop
from .ssd import ComponentNode, Node, ReferenceNode, SystemNode, Wire

Path = tuple[str, ...]
GIVES, TAKES = ("output", "calculatedParameter", "constant", "local"), ("input", "parameter", "structuralParameter")


class Place(NamedTuple):
    """A connector: of a component or system by its path, or a signal, by the path of its dictionary's system."""

    path: Path
    connector: str
    dictionary: str | None = None


class Edge(NamedTuple):
    """Where a value comes from."""

    source: Place
    hop: Hop
    line: int
    node: SystemNode


@dataclass
class Flat:
    """What a tree comes to; see :func:`flatten`."""

    components: list[Component] = field(default_factory=list)
    connections: list[Connection] = field(default_factory=list)
    inputs: list[SystemInput] = field(default_factory=list)
    outputs: list[SystemOutput] = field(default_factory=list)
    remarks: list[str] = field(default_factory=list)


def flatten(root: SystemNode, lenient: bool = False) -> Flat:
    """The components, connections, inputs and outputs of a system and of all systems in it.

    Raises :class:`SystemFileError` with the line: a connection that leads nowhere or to a connector twice, between two
    outputs or two inputs, in a circle through systems; two components that end up with one name.  Raises
    :class:`UsageError`, unless it is ``lenient``: a value for something that is not there.
    """
    return _Flattener(root, lenient).flatten()


class _Flattener:
    """``ends``: what is stated of each connector; ``edges``: where the value of a connector comes from."""

    def __init__(self, root: SystemNode, lenient: bool) -> None:
        self.root = root
        self.lenient = lenient
        self.nodes: dict[Path, ComponentNode] = {}
        self.ends: dict[Place, End] = {}
        self.edges: dict[Place, list[Edge]] = {}
        self.given: dict[Place, Parameter] = {}
        self.found = Flat()

    def flatten(self) -> Flat:
        self.visit(self.root, (), {})
        self.check_names()
        self.find_connections()
        own: dict[Path, dict[str, Parameter]] = {path: {} for path in self.nodes}
        for place, entry in self.given.items():
            if place.path in own:
                own[place.path][place.connector] = entry
        for path, node in self.nodes.items():
            name, connectors = ".".join(path), tuple(node.connectors.values())
            component = Component(name, node.source, connectors, own[path], node.line, node.step)
            self.found.components.append(component)
        return self.found

    # ---- the tree ----------------------------------------------------------------------------------------

    def visit(self, node: Node, path: Path, dictionaries: Mapping[str, tuple[Path, Mapping[str, End]]]) -> None:
        """Take in a node and all below it; bindings of a system come after those of its elements, and outrank them."""
        if isinstance(node, ReferenceNode):
            return
        for connector in node.connectors.values():
            self.ends[Place(path, connector.name)] = connector.end
        if isinstance(node, ComponentNode):
            self.nodes[path] = node
        if isinstance(node, SystemNode):
            own = {name: (path, entries) for name, entries in node.dictionaries.items()}
            known = {**dictionaries, **own}
            for child in node.children.values():
                self.visit(child, (*path, child.name), known)
            for wire in node.wires:
                self.add_edge(wire, node, path, known)
        for binding in node.bindings:
            for name, entry in binding.items():
                places = list(self.find_places(node, path, name))
                for place in places:
                    self.given[place] = entry
                if not places:
                    text = f"{entry.origin}: there is no {name!r} in the system {node.name!r}"
                    if not (self.lenient and entry.bound):
                        raise UsageError(text)
                    self.found.remarks.append(f"{text}: ignored")

    def find_places(self, node: Node, path: Path, name: str) -> Iterator[Place]:
        """All that a hierarchical name means in a node (SSP 1.0, section 5.3.1): several, where names have dots."""
        if isinstance(node, ComponentNode):
            yield Place(path, name)
        elif isinstance(node, SystemNode):
            if name in node.connectors:
                yield Place(path, name)
            dot = name.find(".")
            while dot >= 0:
                if child := node.children.get(name[:dot]):
                    yield from self.find_places(child, (*path, child.name), name[dot + 1 :])
                dot = name.find(".", dot + 1)

    def add_edge(
        self, wire: Wire, node: SystemNode, path: Path, known: Mapping[str, tuple[Path, Mapping[str, End]]]
    ) -> None:
        roles, places = [], []
        for element, name in wire.ends:
            child = node if element is None else node.children.get(element)
            if child is None:
                hint = suggest_names(str(element), node.children)
                raise _make_error(node, wire.line, f"connection: there is no component {element!r}{hint}")
            if name not in child.connectors:
                what = "the system" if element is None else f"component {element!r}"
                hint = suggest_names(name, child.connectors)
                raise _make_error(node, wire.line, f"connection: there is no connector {name!r} at {what}{hint}")
            roles.append(_find_role(child.connectors[name], element is None))
            if isinstance(child, ReferenceNode):
                places.append(self.find_signal(child, name, known))
            else:
                places.append(Place(path if element is None else (*path, child.name), name))
        if roles[0] == roles[1] != 0 and not all(place.path in self.nodes for place in places):
            what = "give a value" if roles[0] > 0 else "take a value"
            shown = " and ".join(_show(place) for place in places)
            raise _make_error(node, wire.line, f"connection: {shown} both {what}: correct a kind, or remove it")
        # Two such connectors of components are reported with what the FMUs say of them.
        source, target = places if roles[0] >= roles[1] else places[::-1]
        self.edges.setdefault(target, []).append(Edge(source, wire.hop, wire.line, node))

    def find_signal(
        self, node: ReferenceNode, name: str, known: Mapping[str, tuple[Path, Mapping[str, End]]]
    ) -> Place:
        if node.dictionary not in known:
            hint = suggest_names(node.dictionary, known)
            raise _make_error(node, node.line, f"there is no signal dictionary {node.dictionary!r}{hint}")
        path, entries = known[node.dictionary]
        if name not in entries:
            hint = suggest_names(name, entries)
            text = f"there is no entry {name!r} in the signal dictionary {node.dictionary!r}{hint}"
            raise _make_error(node, node.connectors[name].line, text)
        place = Place(path, name, node.dictionary)
        self.ends[place] = entries[name]
        return place

    def check_names(self) -> None:
        seen: dict[str, ComponentNode] = {}
        for path, node in self.nodes.items():
            name = ".".join(path)
            if other := seen.get(name):
                text = f"this component and that in line {other.line} are both called {name!r}: rename one"
                raise _make_error(node, node.line, text)
            seen[name] = node

    # ---- the ways of the values --------------------------------------------------------------------------

    def find_connections(self) -> None:
        fed: dict[str, list[tuple[PortName, tuple[Hop, ...]]]] = {}
        for target, edges in self.edges.items():
            inside = target.dictionary is None and target.path in self.nodes
            if len(edges) > 1 and not inside:
                text = f"{_show(target)} already has a source (line {edges[0].line}): remove one of the two"
                raise _make_error(edges[1].node, edges[1].line, text)
            for edge in edges if inside else ():
                origin, hops = self.trace(edge, self.ends[target])
                port = PortName(".".join(target.path), target.connector)
                if origin.dictionary is None and origin.path in self.nodes:
                    source = PortName(".".join(origin.path), origin.connector)
                    self.found.connections.append(Connection(source, port, edge.line, hops, edge.node.file))
                elif origin in self.given:  # a parameter of a system, or an input that nothing else feeds
                    entry = self.given[origin]
                    self.given[target] = replace(entry, hops=(*entry.hops, Hop(entry.origin, self.ends[origin]), *hops))
                if origin.path == () and origin.dictionary is None and origin.connector in self.root.connectors:
                    fed.setdefault(origin.connector, []).append((port, hops))
        for connector in self.root.connectors.values():
            if targets := fed.get(connector.name):
                line = connector.line
                self.found.inputs.append(SystemInput(connector.name, connector.end, tuple(targets), line))
            elif shown := self.edges.get(Place((), connector.name)):
                self.add_output(connector, shown[0])
            unused = self.given.get(Place((), connector.name)) if connector.name not in fed else None
            if unused is not None:
                text = f"connector {connector.name!r} leads to no input of a component: ignored"
                self.found.remarks.append(f"{unused.origin}: {text}")

    def add_output(self, connector: Connector, edge: Edge) -> None:
        origin, hops = self.trace(edge, connector.end)
        if origin.dictionary is None and origin.path in self.nodes:
            source = PortName(".".join(origin.path), origin.connector)
            self.found.outputs.append(SystemOutput(connector.name, connector.end, source, hops, connector.line))
        else:
            text = f"connector {connector.name!r} (line {connector.line}) shows no output of a component: not recorded"
            self.found.remarks.append(text)

    def trace(self, edge: Edge, end: End) -> tuple[Place, tuple[Hop, ...]]:
        """Back to where a value comes from, and the hops from there."""
        hops, seen = [replace(edge.hop, end=end)], {edge.source}
        source = edge.source
        while edges := self.edges.get(source) if source.path not in self.nodes or source.dictionary else None:
            hops.append(replace(edges[0].hop, end=self.ends[source]))
            source = edges[0].source
            if source in seen:
                raise _make_error(edge.node, edge.line, f"the value of {_show(source)} goes round in a circle")
            seen.add(source)
        return source, tuple(reversed(hops))


def _find_role(connector: Connector, of_system: bool) -> int:
    """1 if the connector gives a value to the connection, -1 if it takes one, 0 if it can do both."""
    role = 1 if connector.kind in GIVES else -1 if connector.kind in TAKES else 0
    return -role if of_system else role


def _show(place: Place) -> str:
    what = f"signal {place.dictionary}." if place.dictionary else "connector "
    return f"{what}{'.'.join((*place.path, place.connector))}"


def _make_error(node: Node, line: int, text: str) -> SystemFileError:
    return SystemFileError(node.ssd, text, line)
