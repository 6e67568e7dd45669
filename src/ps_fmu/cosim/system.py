"""Read the wiring of a system: an SSD file, a folder with one, or an SSP archive (SSP 1.0).

Only the dialect that all tools agree on is accepted (see :mod:`.dialect`): components that are FMUs,
connections from output to input, parameter sets.  Nothing in these files is trusted before it is checked.
"""

from __future__ import annotations

from pathlib import Path, PurePosixPath

from .archive import extract
from .dialect import check_element, get_only_child
from .errors import SystemFileError
from .ssv import parse_real, read_parameter_set, read_parameters
from .structure import (
    COMPONENT_NAME,
    Component,
    Connection,
    Connector,
    Experiment,
    Parameter,
    PortName,
    System,
    UnpackedFolder,
    suggest_names,
)
from .xmlfile import Element, read_xml

__all__ = ["System", "read_parameters", "read_system"]

FMU_TYPE = "application/x-fmu-sharedlibrary"
PARAMETER_TYPE = "application/x-ssp-parameter-set"
SSD_NAME = "SystemStructure.ssd"
KINDS = ("input", "output", "inout", "parameter", "calculatedParameter")


def read_system(path: Path, resources: Path | None = None) -> System:
    """Read a system description.

    Parameters
    ----------
    path: an ``.ssd`` file, a folder that holds ``SystemStructure.ssd``, or an ``.ssp`` archive
    resources: folder with the FMUs, found by file name; those that are not there, and by default all, lie where the
        description says

    Raises :class:`SystemFileError`, with file and line: not SSP 1.0, an element that cannot be honoured, a
    name that occurs twice or is malformed, a source that is missing or leaves the folder of the
    description.
    """
    path = Path(path)
    resources = Path(resources) if resources is not None else None
    if path.is_dir():
        ssd = path / SSD_NAME
    elif path.suffix.lower() == ".ssp":
        unpacked = UnpackedFolder(path)
        extract(path, unpacked.path)
        ssd = unpacked.path / SSD_NAME
        if ssd.is_file():
            with unpacked.name_members():
                return _Reader(ssd, resources, unpacked).read()
    else:
        ssd = path
    if not ssd.is_file():
        raise SystemFileError(path, f"there is no system description {ssd.name} here")
    return _Reader(ssd, resources).read()


def list_fmu_files(path: Path) -> set[str]:
    """File names of the FMUs that an ``.ssd`` file, or that of a folder, names, whether they are there or not.

    Raises :class:`SystemFileError`: it is not there, or no XML that is read here.
    """
    ssd = path / SSD_NAME if path.is_dir() else path
    if not ssd.is_file():
        raise SystemFileError(path, f"there is no system description {ssd.name} here")
    waiting, found = [read_xml(ssd)], set()
    while waiting:
        element = waiting.pop()
        waiting += element.children
        if element.tag == "ssd:Component":
            found.add(PurePosixPath(element.attributes.get("source", "")).name)
    return found


class _Reader:
    """Turns the elements of one SSD into data; every error names the file and the line."""

    def __init__(self, ssd: Path, resources: Path | None, unpacked: UnpackedFolder | None = None) -> None:
        self.ssd = ssd
        self.resources = resources
        self.unpacked = unpacked

    def locate(self, path: Path) -> Path:
        """A file as its user knows it."""
        return path if self.unpacked is None else self.unpacked.locate(path)

    def make_error(self, text: str, element: Element) -> SystemFileError:
        return SystemFileError(self.ssd, text, element.line)

    def read(self) -> System:
        root = read_xml(self.ssd)
        if root.tag != "ssd:SystemStructureDescription":
            raise self.make_error(f"expected ssd:SystemStructureDescription of SSP 1.0, got {root.tag}", root)
        check_element(root, self.ssd)
        if root.attributes["version"] != "1.0":
            version = root.attributes["version"]
            raise self.make_error(f'version {version!r} is not read: write version "1.0"', root)
        element = get_only_child(root, "ssd:System", self.ssd)
        if element is None:
            raise self.make_error("there is no ssd:System", root)
        connectors = get_only_child(element, "ssd:Connectors", self.ssd)
        if connectors is not None and connectors.children:
            raise self.make_error("connectors of the system itself are not supported: remove them", connectors)
        elements = get_only_child(element, "ssd:Elements", self.ssd)
        components = [self.read_component(child) for child in elements.children] if elements is not None else []
        if not components:
            raise self.make_error("the system has no components", element)
        self.check_unique([(c.name, c.line) for c in components], "component")
        system = System(
            self.locate(self.ssd),
            tuple(components),
            tuple(self.read_connections(element, {c.name: c for c in components})),
            self.read_experiment(root, element),
            {key: element.attributes[key] for key in ("name", "description") if key in element.attributes},
            self.unpacked,
        )
        # A binding of the system outranks those of its components (SSP 1.0, parameter bindings).
        return system.with_parameters(self.read_bindings(element))

    def check_unique(self, names: list[tuple[str, int]], what: str) -> None:
        seen: dict[str, int] = {}
        for name, line in names:
            if name in seen:
                raise SystemFileError(self.ssd, f"{what} {name!r} is also in line {seen[name]}", line)
            seen[name] = line

    def read_component(self, element: Element) -> Component:
        check_element(element, self.ssd)
        name = element.attributes["name"]
        if not COMPONENT_NAME.fullmatch(name):
            raise self.make_error(f"component {name!r}: letters, digits and _ only, no digit first", element)
        kind = element.attributes.get("type", FMU_TYPE)
        implementation = element.attributes.get("implementation", "any")
        if kind != FMU_TYPE or implementation not in ("any", "CoSimulation"):
            raise self.make_error(
                f"component {name!r}: expected an FMU for co-simulation (type {FMU_TYPE!r}, implementation "
                f"'CoSimulation'), got {kind!r}, {implementation!r}",
                element,
            )
        group = get_only_child(element, "ssd:Connectors", self.ssd)
        connectors = [self.read_connector(child) for child in group.children] if group is not None else []
        self.check_unique([(c.name, c.line) for c in connectors], f"connector of {name!r}:")
        return Component(
            name, self.find_source(element, name), tuple(connectors), self.read_bindings(element), element.line
        )

    def read_connector(self, element: Element) -> Connector:
        check_element(element, self.ssd)
        name, kind = element.attributes["name"], element.attributes["kind"]
        if kind not in KINDS:
            raise self.make_error(f"connector {name!r}: kind {kind!r} is none of {', '.join(KINDS)}", element)
        types = [child for child in element.children if child.tag.startswith("ssc:")]
        if len(types) > 1:
            raise self.make_error(f"connector {name!r} has more than one type", element)
        if not types:
            return Connector(name, kind, None, None, element.line)
        check_element(types[0], self.ssd)
        unit = types[0].attributes.get("unit")
        return Connector(name, kind, types[0].tag.removeprefix("ssc:"), unit, element.line)

    def find_source(self, element: Element, name: str) -> Path:
        text = element.attributes["source"]
        relative = self.check_relative(text, element)
        places = [self.ssd.parent / relative]
        if self.resources is not None:
            places.insert(0, self.resources / relative.name)
        for path in places:
            if path.is_file():
                return path.absolute()  # a thread that loads an FMU changes the working directory of all
        known = " and no ".join(str(self.locate(path) if path is places[-1] else path) for path in places)
        raise self.make_error(f"component {name!r}: there is no FMU {known}; build it, or say where it is", element)

    def check_relative(self, text: str, element: Element) -> PurePosixPath:
        """A source inside the folder of the description."""
        path = PurePosixPath(text)
        if not path.name or set(text) & set("\\:\0") or path.is_absolute() or ".." in path.parts:
            raise self.make_error(f"source {text!r} is not a path inside the folder of the description", element)
        return path

    def read_bindings(self, element: Element) -> dict[str, Parameter]:
        """All parameter bindings of a component or of the system; a later one replaces an earlier one."""
        parameters: dict[str, Parameter] = {}
        group = get_only_child(element, "ssd:ParameterBindings", self.ssd)
        for binding in group.children if group is not None else ():
            check_element(binding, self.ssd)
            given = binding.attributes
            if given.get("type", PARAMETER_TYPE) != PARAMETER_TYPE or given.get("sourceBase", "SSD") != "SSD":
                raise self.make_error(
                    f"a parameter binding must be of type {PARAMETER_TYPE!r} and sourceBase 'SSD'", binding
                )
            if given.get("prefix"):
                raise self.make_error("a prefix of a parameter binding is not supported: name them in full", binding)
            inline = get_only_child(binding, "ssd:ParameterValues", self.ssd)
            if (inline is None) == ("source" not in given):
                raise self.make_error("a parameter binding needs a source or values, not both", binding)
            if inline is None:
                path = self.ssd.parent / self.check_relative(given["source"], binding)
                parameters.update(read_parameter_set(read_xml(path), self.locate(path)).entries())
            for entry in inline.children if inline is not None else ():
                parameters.update(read_parameter_set(entry, self.locate(self.ssd)).entries())
        return parameters

    def read_connections(self, system: Element, components: dict[str, Component]) -> list[Connection]:
        group = get_only_child(system, "ssd:Connections", self.ssd)
        connections = []
        for element in group.children if group is not None else ():
            check_element(element, self.ssd)
            ends = [
                PortName(element.attributes[f"{end}Element"], element.attributes[f"{end}Connector"])
                for end in ("start", "end")
            ]
            for port in ends:
                if port.component not in components:
                    hint = suggest_names(port.component, components)
                    raise self.make_error(f"connection: there is no component {port.component!r}{hint}", element)
                known = [c.name for c in components[port.component].connectors]
                if port.variable not in known:
                    hint = suggest_names(port.variable, known)
                    raise self.make_error(
                        f"connection: component {port.component!r} has no connector {port.variable!r}{hint}",
                        element,
                    )
            connections.append(Connection(ends[0], ends[1], element.line))
        return connections

    def read_experiment(self, root: Element, system: Element) -> Experiment:
        element = get_only_child(root, "ssd:DefaultExperiment", self.ssd)
        if element is None:
            return Experiment()
        times = {name: self.read_number(element, name) for name in ("startTime", "stopTime")}
        start, stop = times["startTime"] or 0.0, times["stopTime"]
        if stop is not None and stop <= start:
            raise self.make_error(f"the stop time {stop} s is not after the start time {start} s", element)
        return Experiment(start, stop, self.read_step(element))

    def read_step(self, experiment: Element) -> float | None:
        """The communication step, from the annotation that libcosim reads."""
        group = get_only_child(experiment, "ssd:Annotations", self.ssd) if experiment.children else None
        for annotation in group.children if group is not None else ():
            algorithm = annotation.descendant("osp:Algorithm", "osp:FixedStepAlgorithm")
            if annotation.attributes.get("type") == "com.opensimulationplatform" and algorithm is not None:
                step = self.read_number(algorithm, "baseStepSize")
                if step is None or step <= 0.0:
                    raise self.make_error("baseStepSize must be a positive number of seconds", algorithm)
                return step
        return None

    def read_number(self, element: Element, name: str) -> float | None:
        text = element.attributes.get(name)
        value = None if text is None else parse_real(text)
        if text is not None and value is None:
            raise self.make_error(f"{name}: expected a finite number, got {text!r}", element)
        return value
