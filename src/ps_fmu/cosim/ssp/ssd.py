"""A system structure description (SSP 1.0, 2.0) as a tree of systems, components and references to dictionaries.

Nothing in the files is trusted before it is checked; every error names the file and the line.  What the tree means,
:mod:`.flatten` finds out.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path, PurePosixPath

from ...files.archive import check_archive, read_member
from ...files.xmlfile import MAXIMUM_BYTES, Element, parse_xml, read_xml
from ..errors import SystemFileError
from ..structure import Connector, Parameter
from ..values import End, Hop, Items, Unit, parse_real
from .parameters import apply_mapping, read_hop, read_items, read_parameter_set, read_units
from .rules import check_element, check_version, get_only_child, get_type, is_type, list_checked
from .sources import DEEPEST, MOST_CONNECTORS, MOST_ELEMENTS, MOST_SYSTEMS, SSD_NAME, Sources

FMU_TYPE = "application/x-fmu-sharedlibrary"
SSD_TYPE = "application/x-ssp-definition"
SSP_TYPE = "application/x-ssp-package"
PARAMETER_TYPE = "application/x-ssp-parameter-set"
MAPPING_TYPE = "application/x-ssp-parameter-mapping"
DICTIONARY_TYPE = "application/x-ssp-signal-dictionary"
KINDS = (
    "input", "output", "inout", "parameter", "calculatedParameter", "structuralParameter", "constant", "local",
    "unspecified",
)  # fmt: skip


@dataclass(frozen=True)
class Wire:
    """A connection as it is written; an element of None is the system itself."""

    ends: tuple[tuple[str | None, str], tuple[str | None, str]]
    hop: Hop
    line: int


@dataclass(frozen=True)
class Node:
    """An element of a system.  ``file`` is its description as the user knows it, "" for that of the whole system."""

    name: str
    line: int
    ssd: Path
    file: str
    connectors: Mapping[str, Connector]
    bindings: tuple[Mapping[str, Parameter], ...]


@dataclass(frozen=True)
class ComponentNode(Node):
    """An FMU; ``source`` is the file, ``step`` [s] what the description states."""

    source: Path
    step: float | None = None


@dataclass(frozen=True)
class ReferenceNode(Node):
    """A place where signals of a dictionary are read or written."""

    dictionary: str


@dataclass(frozen=True)
class SystemNode(Node):
    """A system with its elements and its signal dictionaries, which are the entries by name."""

    children: Mapping[str, Node] = field(default_factory=dict)
    wires: tuple[Wire, ...] = ()
    dictionaries: Mapping[str, Mapping[str, End]] = field(default_factory=dict)


class SsdReader:
    """Turns the elements of one description into nodes."""

    def __init__(self, ssd: Path, sources: Sources, above: tuple[Path, ...] = ()) -> None:
        self.ssd = ssd
        self.sources = sources
        self.above = (*above, ssd)
        self.file = str(sources.locate(ssd)) if above else ""
        if len(self.above) > DEEPEST:
            raise SystemFileError(ssd, f"more than {DEEPEST} system descriptions refer to one another")
        self.root = read_xml(ssd)
        if self.root.tag != "ssd:SystemStructureDescription":
            text = f"expected ssd:SystemStructureDescription of SSP 1.0 or 2.0, got {self.root.tag}"
            raise self.make_error(text, self.root)
        check_element(self.root, ssd)
        check_version(self.root, ssd)
        self.units: Mapping[str, Unit] = read_units(get_only_child(self.root, "ssd:Units", ssd), ssd)
        self.items: Mapping[str, Items] = read_items(get_only_child(self.root, "ssd:Enumerations", ssd), ssd)

    def make_error(self, text: str, element: Element) -> SystemFileError:
        """An error about an element of this description."""
        return SystemFileError(self.ssd, text, element.line)

    def get_top(self) -> Element:
        """The outermost ``ssd:System``."""
        element = get_only_child(self.root, "ssd:System", self.ssd)
        if element is None:
            raise self.make_error("there is no ssd:System", self.root)
        return element

    def read(self) -> SystemNode:
        """The outermost system and all in it."""
        return self.read_system(self.get_top())

    # ---- elements ----------------------------------------------------------------------------------------

    def read_system(self, element: Element) -> SystemNode:
        """A system and all in it."""
        check_element(element, self.ssd)
        self.sources.depth += 1
        if self.sources.depth > MOST_SYSTEMS:
            raise self.make_error(f"more than {MOST_SYSTEMS} systems lie in one another", element)
        children = [self._read_child(child) for child in list_checked(element, "ssd:Elements", self.ssd)]
        self.sources.depth -= 1
        self._check_unique([(child.name, child.line) for child in children], "component")
        return SystemNode(
            *self._read_common(element, element.attributes["name"]),
            children={child.name: child for child in children},
            wires=tuple(self._read_wires(element)),
            dictionaries=self._read_dictionaries(element),
        )

    def _read_child(self, element: Element) -> Node:
        name = element.attributes["name"]
        self.sources.elements += 1
        if self.sources.elements > MOST_ELEMENTS:
            raise self.make_error(f"the system has more than {MOST_ELEMENTS} elements", element)
        if not name:
            raise self.make_error(f"{element.tag} has an empty name", element)
        if element.tag == "ssd:System":
            return self.read_system(element)
        if element.tag == "ssd:SignalDictionaryReference":
            return ReferenceNode(*self._read_common(element, name), element.attributes["dictionary"])
        return self._read_component(element, name)

    def _read_component(self, element: Element, name: str) -> Node:
        kind = element.attributes.get("type", FMU_TYPE)
        implementation = element.attributes.get("implementation", "any")
        source = element.attributes["source"]
        if source.startswith("#") or kind in (SSD_TYPE, SSP_TYPE):
            return self._read_reference(element, name, kind, source)
        if kind != FMU_TYPE or implementation not in ("any", "CoSimulation"):
            raise self.make_error(
                f"component {name!r}: expected an FMU for co-simulation (type {FMU_TYPE!r}, implementation "
                f"'CoSimulation'), got {kind!r}, {implementation!r}",
                element,
            )
        fmu = self.sources.find_fmu(source, element, self.ssd, f"component {name!r}")
        return ComponentNode(*self._read_common(element, name, fmu), fmu, self._read_step(element, name))

    def _read_step(self, element: Element, name: str) -> float | None:
        """The step of a component [s], as libcosim and Ecos read it: annotation ``osp:StepSizeHint``."""
        group = get_only_child(element, "ssd:Annotations", self.ssd)
        for annotation in group.children if group is not None else ():
            hint = annotation.find("osp:StepSizeHint")
            if hint is not None and annotation.attributes.get("type") == "com.opensimulationplatform":
                step = parse_real(hint.attributes.get("value", ""))
                if step is None or step <= 0.0:
                    text = f"component {name!r}: value of osp:StepSizeHint must be a positive number of seconds"
                    raise self.make_error(text, hint)
                return step
        return None

    def _read_reference(self, element: Element, name: str, kind: str, source: str) -> SystemNode:
        """A component that stands for a system: of this description, of another one or of an archive."""
        place, _, fragment = source.partition("#")
        if place == "":
            system = self._find_by_id(self.root, fragment)
            if system is None:
                raise self.make_error(f"component {name!r}: no system has the id {fragment!r}", element)
            if len(self.above) > DEEPEST:
                raise self.make_error(f"component {name!r}: more than {DEEPEST} systems refer to one another", element)
            reader = self._go_deeper()
            found = reader.read_system(system)
        else:
            path = self.sources.find_fmu(place, element, self.ssd, f"component {name!r}")
            if kind == SSP_TYPE:
                if len(self.above) >= DEEPEST:
                    raise self.make_error(f"more than {DEEPEST} system descriptions refer to one another", element)
                folder = self.sources.open_archive(path)
                path = self.sources.find(fragment or SSD_NAME, element, folder / SSD_NAME)
                if not path.is_file():
                    raise self.make_error(f"component {name!r}: there is no {path.name} in {place}", element)
            found = SsdReader(path, self.sources, self.above).read()
        _, line, _, _, connectors, bindings = self._read_common(element, name)
        # The connectors of the system count; the component may state fewer (SSP 2.0, section 5.4.1).
        both = {**connectors, **found.connectors}
        return replace(found, name=name, line=line, connectors=both, bindings=(*found.bindings, *bindings))

    def _go_deeper(self) -> SsdReader:
        """A reader of the same description for a system that this one refers to."""
        deeper = object.__new__(SsdReader)
        deeper.__dict__.update(self.__dict__)
        deeper.above = (*self.above, self.ssd)
        return deeper

    def _find_by_id(self, element: Element, wanted: str) -> Element | None:
        if element.tag == "ssd:System" and element.attributes.get("id") == wanted:
            return element
        found = (self._find_by_id(child, wanted) for child in element.children)
        return next((system for system in found if system is not None), None)

    def _read_common(
        self, element: Element, name: str, fmu: Path | None = None
    ) -> tuple[str, int, Path, str, dict[str, Connector], tuple[Mapping[str, Parameter], ...]]:
        """What all elements have, in the order of :class:`Node`."""
        connectors = [self._read_connector(child) for child in list_checked(element, "ssd:Connectors", self.ssd)]
        self.sources.connectors += len(connectors)
        if self.sources.connectors > MOST_CONNECTORS:
            raise self.make_error(f"the system has more than {MOST_CONNECTORS} connectors", element)
        self._check_unique([(c.name, c.line) for c in connectors], f"connector of {name!r}:")
        return (
            name, element.line, self.ssd, self.file, {c.name: c for c in connectors}, self._read_bindings(element, fmu),
        )  # fmt: skip

    def _check_unique(self, names: list[tuple[str, int]], what: str) -> None:
        seen: dict[str, int] = {}
        for name, line in names:
            if name in seen:
                raise SystemFileError(self.ssd, f"{what} {name!r} is also in line {seen[name]}", line)
            seen[name] = line

    def _read_connector(self, element: Element) -> Connector:
        name, kind = element.attributes["name"], element.attributes["kind"]
        if kind not in KINDS:
            raise self.make_error(f"connector {name!r}: kind {kind!r} is none of {', '.join(KINDS)}", element)
        end = self._read_end(element, f"connector {name!r}", self.units, self.items)
        return Connector(name, kind, end.type, end.unit.name if end.unit else None, element.line, end)

    def _read_end(
        self, element: Element, what: str, units: Mapping[str, Unit], items: Mapping[str, Items]
    ) -> End:
        """Type, unit and enumeration of a connector or of an entry of a dictionary."""
        types = [child for child in element.children if is_type(child.tag)]
        if len(types) > 1:
            raise self.make_error(f"{what} has more than one type", element)
        if not types:
            return End()
        check_element(types[0], self.ssd)
        kind, given = get_type(types[0].tag), types[0].attributes
        unit = units.get(given["unit"], Unit(given["unit"])) if given.get("unit") else None
        return End(kind, unit, items.get(given.get("name", "")) if kind == "Enumeration" else None)

    def _read_wires(self, system: Element) -> list[Wire]:
        wires = []
        for element in list_checked(system, "ssd:Connections", self.ssd):
            given = element.attributes
            # OMSimulator writes an empty name for the system itself.
            start, end = ((given.get(f"{side}Element") or None, given[f"{side}Connector"]) for side in ("start", "end"))
            where = f"{self.file}, line {element.line}" if self.file else f"line {element.line}"
            wires.append(Wire((start, end), read_hop(element, self.ssd, where), element.line))
        return wires

    # ---- signal dictionaries and parameters --------------------------------------------------------------

    def _read_dictionaries(self, system: Element) -> dict[str, Mapping[str, End]]:
        found: dict[str, Mapping[str, End]] = {}
        for element in list_checked(system, "ssd:SignalDictionaries", self.ssd):
            name, inline = element.attributes["name"], element.find("ssb:SignalDictionary")
            if element.attributes.get("type", DICTIONARY_TYPE) != DICTIONARY_TYPE:
                raise self.make_error(f"signal dictionary {name!r}: the type must be {DICTIONARY_TYPE!r}", element)
            if (inline is None) == ("source" not in element.attributes):
                raise self.make_error(f"signal dictionary {name!r} needs a source or entries, not both", element)
            if inline is None:
                path = self.sources.find(element.attributes["source"], element, self.ssd)
                found[name] = self._read_entries(read_xml(path), path)
            else:
                found[name] = self._read_entries(inline, self.ssd)
        return found

    def _read_entries(self, root: Element, path: Path) -> dict[str, End]:
        if root.tag != "ssb:SignalDictionary":
            raise SystemFileError(path, f"is not a signal dictionary of SSP: got {root.tag}", root.line)
        check_element(root, path)
        check_version(root, path)
        units = {**self.units, **read_units(root.find("ssb:Units"), path)}
        items = {**self.items, **read_items(root.find("ssb:Enumerations"), path)}
        entries = {}
        for entry in root.all("ssb:DictionaryEntry"):
            check_element(entry, path)
            name = entry.attributes["name"]
            if name in entries:
                raise SystemFileError(path, f"entry {name!r} occurs twice", entry.line)
            entries[name] = self._read_end(entry, f"entry {name!r}", units, items)
        return entries

    def _read_bindings(self, element: Element, fmu: Path | None) -> tuple[Mapping[str, Parameter], ...]:
        """The parameter bindings of an element, in their order: a later one replaces an earlier one."""
        bindings = list_checked(element, "ssd:ParameterBindings", self.ssd)
        return tuple(self._read_binding(binding, fmu) for binding in bindings)

    def _read_binding(self, binding: Element, fmu: Path | None) -> dict[str, Parameter]:
        given = binding.attributes
        if given.get("type", PARAMETER_TYPE) != PARAMETER_TYPE:
            raise self.make_error(f"a parameter binding must be of type {PARAMETER_TYPE!r}", binding)
        inline = get_only_child(binding, "ssd:ParameterValues", self.ssd)
        if (inline is None) == ("source" not in given):
            raise self.make_error("a parameter binding needs a source or values, not both", binding)
        roots = [(child, self.ssd) for child in inline.children] if inline is not None else []
        if inline is None:
            roots = [self._read_source(binding, fmu)]
        entries: dict[str, Parameter] = {}
        for root, path in roots:
            for name, entry in read_parameter_set(root, path, self.sources.locate(path)).entries().items():
                unit = entry.defined or (None if entry.unit is None else self.units.get(entry.unit))
                entries[given.get("prefix", "") + name] = replace(entry, bound=self.sources.lenient, defined=unit)
        mapping = get_only_child(binding, "ssd:ParameterMapping", self.ssd)
        return entries if mapping is None else self._read_mapping(mapping, fmu, entries)

    def _read_mapping(
        self, element: Element, fmu: Path | None, entries: Mapping[str, Parameter]
    ) -> dict[str, Parameter]:
        if element.attributes.get("type", MAPPING_TYPE) != MAPPING_TYPE:
            raise self.make_error(f"a parameter mapping must be of type {MAPPING_TYPE!r}", element)
        inline = element.find("ssm:ParameterMapping")
        if (inline is None) == ("source" not in element.attributes):
            raise self.make_error("a parameter mapping needs a source or entries, not both", element)
        root, path = self._read_source(element, fmu) if inline is None else (inline, self.ssd)
        return apply_mapping(root, path, self.sources.locate(path), entries)

    def _read_source(self, element: Element, fmu: Path | None) -> tuple[Element, Path]:
        """Root element and path of the file that a binding or mapping names, which may lie inside an FMU."""
        text, base = element.attributes["source"], element.attributes.get("sourceBase", "SSD")
        if base == "SSD":
            path = self.sources.find(text, element, self.ssd)
            return read_xml(path), path
        if base != "component" or fmu is None:
            raise self.make_error(f"sourceBase {base!r}: expected 'SSD', or 'component' at an FMU", element)
        name = str(PurePosixPath(text))
        if name not in check_archive(fmu):
            raise self.make_error(f"there is no {text!r} in {fmu.name}", element)
        return parse_xml(read_member(fmu, name, MAXIMUM_BYTES), fmu / name), fmu / name
