"""Read ``OspSystemStructure.xml``: simulators, start values, connections and linear transformations on them.

A connection of two variables has no direction in the file: the causality of the variables says it, as in libcosim.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from fmpy.model_description import ModelVariable

from ...files.xmlfile import Element, read_xml
from ..description import index_variables, read_description
from ..errors import SystemFileError
from ..structure import (
    Component,
    Connection,
    Connector,
    Experiment,
    Parameter,
    PortName,
    System,
    suggest_names,
)
from ..values import EXPECTED, Hop, Transformation, Value, parse_real, parse_value
from .parameters import read_linear
from .rules import OSP_VALUES, check_element, get_only_child, list_checked, read_number, show_tag
from .sources import MOST_ELEMENTS, Sources

OSP_NAME = "OspSystemStructure.xml"
_ROOT = "OspSystemStructure"
_NAMESPACE = "http://opensimulationplatform.com/MSMI/OSPSystemStructure"


@dataclass(frozen=True)
class _Function:
    """A linear transformation, and where it is."""

    transformation: Transformation
    line: int


def read_osp(path: Path, sources: Sources) -> System:
    """Read a system.  Nothing is loaded; the descriptions of FMUs are read to tell outputs from inputs.

    Raises :class:`SystemFileError`, with file and line: another XML file, an element that cannot be honoured, a name
    that occurs twice or is not there, a source that is missing or leaves the folder of the description.
    """
    return _Reader(path, sources).read()


class _Reader:
    def __init__(self, path: Path, sources: Sources) -> None:
        self._path, self._sources = path, sources
        self._components: dict[str, Component] = {}
        self._variables: dict[str, Mapping[str, ModelVariable]] = {}
        self._connectors: dict[PortName, Connector] = {}

    def read(self) -> System:
        root = read_xml(self._path, texts=True)
        if root.tag != f"oss:{_ROOT}":
            name = root.tag.rpartition(":")[2]
            what = f'{name} of another namespace: write xmlns="{_NAMESPACE}"' if name == _ROOT else name
            raise self._make_error(f"is not a system of libcosim: expected {_ROOT}, got {what}", root)
        check_element(root, self._path)
        simulators = list_checked(root, "oss:Simulators", self._path)
        if not simulators:
            raise self._make_error("the system has no simulators", root)
        if len(simulators) > MOST_ELEMENTS:
            raise self._make_error(f"the system has more than {MOST_ELEMENTS} simulators", root)
        for element in simulators:
            component = self._read_simulator(element)
            if component.name in self._components:
                raise self._make_error(f"there are two simulators named {component.name!r}", element)
            self._components[component.name] = component
        connections = tuple(self._list_connections(root))
        components = [replace(one, connectors=self._list_connectors(name)) for name, one in self._components.items()]
        remarks = tuple(self._list_remarks(root))
        experiment = self._read_experiment(root)
        labels = {"name": self._path.stem}
        if (about := get_only_child(root, "oss:Description", self._path)) is not None:
            labels["description"] = about.text.strip()
        return System(self._path, tuple(components), connections, experiment, labels, remarks=remarks)

    def _list_connectors(self, component: str) -> tuple[Connector, ...]:
        """Those that connections name."""
        return tuple(connector for port, connector in self._connectors.items() if port.component == component)

    def _make_error(self, text: str, element: Element) -> SystemFileError:
        return SystemFileError(self._path, text, element.line)

    def _read_experiment(self, root: Element) -> Experiment:
        start = self._read_time(root, "StartTime") or 0.0
        stop, step = self._read_time(root, "EndTime"), self._read_time(root, "BaseStepSize")
        if stop is not None and stop <= start:
            raise self._make_error(f"EndTime {stop} s is not after StartTime {start} s", root)
        if step is not None and step <= 0.0:
            raise self._make_error(f"BaseStepSize must be a positive number of seconds, got {step}", root)
        return Experiment(start, stop, step)

    def _read_time(self, root: Element, name: str) -> float | None:
        element = get_only_child(root, f"oss:{name}", self._path)
        value = None if element is None else parse_real(element.text)
        if element is not None and value is None:
            raise self._make_error(f"{name}: expected a finite number, got {element.text.strip()!r}", element)
        return value

    def _list_remarks(self, root: Element) -> Iterator[str]:
        element = get_only_child(root, "oss:Algorithm", self._path)
        if element is not None and element.text.strip() != "fixedStep":
            where = f"{self._path}, line {element.line}"
            yield f"{where}: Algorithm {element.text.strip()!r} is not supported: the step is BaseStepSize"

    def _read_simulator(self, element: Element) -> Component:
        name = element.attributes["name"]
        if not name:
            raise self._make_error("Simulator has an empty name", element)
        fmu = self._sources.find_fmu(element.attributes["source"], element, self._path, f"simulator {name!r}")
        step = read_number(element, "stepSize", self._path) or 0.0
        if step < 0.0:
            raise self._make_error(f"stepSize must not be negative, got {step}", element)
        parameters: dict[str, Parameter] = {}
        for item in list_checked(element, "oss:InitialValues", self._path):
            variable = item.attributes["variable"]
            if variable in parameters:
                raise self._make_error(f"simulator {name!r}: there are two values for {variable!r}", item)
            where = f"{self._path}, line {item.line}"
            parameters[variable] = Parameter(self._read_value(item, f"{name}.{variable}"), None, where)
        return Component(name, fmu, (), parameters, element.line, step or None)  # 0: that of the system

    def _read_value(self, item: Element, name: str) -> Value:
        if len(item.children) != 1:
            raise self._make_error(f"{name}: expected one value, of {', '.join(OSP_VALUES)}", item)
        check_element(item.children[0], self._path)
        stated = show_tag(item.children[0].tag)
        kind, text = "Integer" if stated == "Enumeration" else stated, item.children[0].attributes["value"]
        value = parse_value(kind, text)
        if value is None:
            raise self._make_error(f"{name}: expected {EXPECTED[kind]}, got {text!r}", item.children[0])
        return value

    # ---- connections ---------------------------------------------------------------------------------------

    def _list_connections(self, root: Element) -> Iterator[Connection]:
        functions = self._read_functions(root)
        fed: dict[str, PortName] = {}
        led: list[tuple[str, PortName, Element]] = []
        for element in list_checked(root, "oss:Connections", self._path):
            if show_tag(element.tag) == "VariableConnection":
                source, target = self._direct(element)
                yield Connection(source, target, element.line)
                continue
            variable, signal, function = self._read_signal(element, functions)
            if signal == "out":
                led.append((function, variable, element))
            elif function in fed:
                raise self._make_error(f"the input of function {function!r} is connected twice", element)
            else:
                fed[function] = variable
        for function, target, element in led:
            if function not in fed:
                raise self._make_error(f"the input of function {function!r} is not connected", element)
            own = functions[function]
            hop = Hop(f"{self._path}, line {own.line}", transformation=own.transformation, converts=False)
            yield Connection(fed[function], target, element.line, (hop,))

    def _read_functions(self, root: Element) -> dict[str, _Function]:
        found: dict[str, _Function] = {}
        for element in list_checked(root, "oss:Functions", self._path):
            name = element.attributes["name"]
            if name in found:
                raise self._make_error(f"there are two functions named {name!r}", element)
            found[name] = _Function(read_linear(element, self._path), element.line)
        return found

    def _read_signal(self, element: Element, functions: dict[str, _Function]) -> tuple[PortName, str, str]:
        """The variable, ``in`` or ``out``, and the function."""
        if sorted(show_tag(child.tag) for child in element.children) != ["Signal", "Variable"]:
            raise self._make_error("SignalConnection: expected a Variable and a Signal", element)
        signal, variable = sorted(element.children, key=lambda child: child.tag)
        check_element(signal, self._path)
        name, function = signal.attributes["name"], signal.attributes["function"]
        if function not in functions:
            raise self._make_error(f"there is no function {function!r}{suggest_names(function, functions)}", signal)
        if name not in ("in", "out"):
            raise self._make_error(f"function {function!r}: expected the signal in or out, got {name!r}", signal)
        port, causality = self._read_variable(variable)
        if (name == "in") != (causality == "output"):
            expected = "an output" if name == "in" else "an input"
            text = f"{port} is of causality {causality}; {function}.{name} has to be connected to {expected}"
            raise self._make_error(text, variable)
        return port, name, function

    def _read_variable(self, element: Element) -> tuple[PortName, str]:
        """The port and its causality, ``output`` or another."""
        check_element(element, self._path)
        component, name = element.attributes["simulator"], element.attributes["name"]
        if component not in self._components:
            hint = suggest_names(component, self._components)
            raise self._make_error(f"there is no simulator {component!r}{hint}", element)
        if component not in self._variables:  # to read a description takes the digest of the whole FMU
            source = self._components[component].source
            self._variables[component] = index_variables(read_description(source, lenient=True))
        variables = self._variables[component]
        if name not in variables:
            hint = suggest_names(name, variables)
            raise self._make_error(f"there is no variable {name!r} in {component}{hint}", element)
        port, causality = PortName(component, name), str(variables[name].causality)
        self._connectors.setdefault(port, Connector(name, causality, None, None, element.line))
        return port, causality

    def _direct(self, element: Element) -> tuple[PortName, PortName]:
        """Source and target of a VariableConnection."""
        if [show_tag(child.tag) for child in element.children] != ["Variable", "Variable"]:
            raise self._make_error("VariableConnection: expected two Variables", element)
        (one, first), (other, second) = map(self._read_variable, element.children)
        if (first == "output") == (second == "output"):
            text = f"{one} is of causality {first}, {other} of {second}: expected an output and an input"
            raise self._make_error(text, element)
        return (one, other) if first == "output" else (other, one)



