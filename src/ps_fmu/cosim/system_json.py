"""A flat system as JSON, to be rebuilt on another machine without the files that it was read from.

It has all that decides a run: components, start values, connections with the conversions on their way, inputs and
outputs of the system.  It has no paths and no lines: the same system in another folder is the same text.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path, PurePosixPath
from typing import Any

from .errors import SystemFileError
from .structure import (
    Component,
    Connection,
    Connector,
    Experiment,
    Parameter,
    PortName,
    System,
    SystemInput,
    SystemOutput,
)
from .values import End, Hop, Transformation, Unit
from .xmlfile import read_bytes

MAXIMUM_BYTES = 2**30

WHERE = "the system of the study"
"""Instead of files and lines, in messages."""


def encode_system(system: System, files: Mapping[str, str]) -> bytes:
    """The system as JSON; ``files``: what the FMU of each component is called there, by the name of the component."""
    found = {
        "components": [
            {
                "name": component.name,
                "source": files[component.name],
                "step": component.step,
                "connectors": [
                    [one.name, one.kind, one.type, one.unit, _write_end(one.end)] for one in component.connectors
                ],
                "parameters": {name: _write_parameter(entry) for name, entry in component.parameters.items()},
            }
            for component in system.components
        ],
        "connections": [[one.source, one.target, _write_hops(one.hops)] for one in system.connections],
        "inputs": [
            [one.name, _write_end(one.end), [[port, _write_hops(hops)] for port, hops in one.targets]]
            for one in system.inputs
        ],
        "outputs": [[one.name, _write_end(one.end), one.source, _write_hops(one.hops)] for one in system.outputs],
        "experiment": [system.experiment.start_time, system.experiment.stop_time, system.experiment.step],
    }
    return json.dumps(found, indent=1, ensure_ascii=False).encode()


def decode_system(path: Path) -> System:
    """The system that :func:`encode_system` has written into a file, beside which its FMUs are.

    Raises :class:`SystemFileError` for a file that is not there or damaged, or names an FMU outside its folder.
    """
    content = read_bytes(path, MAXIMUM_BYTES)
    try:
        return _read_system(json.loads(content), path.parent)
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError) as error:
        raise SystemFileError(path, f"is no system of a study: {error!r}") from error


def _read_system(found: dict[str, Any], folder: Path) -> System:
    components = tuple(
        Component(
            one["name"],
            _find_inside(folder, one["source"]),
            tuple(
                Connector(name, kind, type_, unit, 0, _read_end(end))
                for name, kind, type_, unit, end in one["connectors"]
            ),
            {name: _read_parameter(entry) for name, entry in one["parameters"].items()},
            0,
            one["step"],
        )
        for one in found["components"]
    )
    return System(
        Path(WHERE),
        components,
        tuple(
            Connection(PortName(*source), PortName(*target), 0, _read_hops(hops), WHERE)
            for source, target, hops in found["connections"]
        ),
        Experiment(*found["experiment"]),
        inputs=tuple(
            SystemInput(name, _read_end(end), tuple((PortName(*port), _read_hops(hops)) for port, hops in targets), 0)
            for name, end, targets in found["inputs"]
        ),
        outputs=tuple(
            SystemOutput(name, _read_end(end), PortName(*source), _read_hops(hops), 0)
            for name, end, source, hops in found["outputs"]
        ),
    )


def _find_inside(folder: Path, name: str) -> Path:
    place = PurePosixPath(name)
    if place.is_absolute() or ".." in place.parts:
        raise ValueError(f"{name!r} is not a path inside the folder")
    return (folder / place).absolute()


def _write_end(end: End) -> list[object]:
    return [end.type, _write_unit(end.unit), None if end.items is None else dict(end.items)]


def _read_end(found: Sequence[Any]) -> End:
    type_, unit, items = found
    return End(type_, _read_unit(unit), items)


def _write_unit(unit: Unit | None) -> list[object] | None:
    return None if unit is None else [unit.name, unit.exponents, unit.factor, unit.offset]


def _read_unit(found: Sequence[Any] | None) -> Unit | None:
    if found is None:
        return None
    name, exponents, factor, offset = found
    return Unit(name, None if exponents is None else tuple(exponents), factor, offset)


def _write_hops(hops: Sequence[Hop]) -> list[object]:
    return [[_write_end(hop.end), _write_transformation(hop.transformation), hop.converts] for hop in hops]


def _read_hops(found: Sequence[Any]) -> tuple[Hop, ...]:
    return tuple(Hop(WHERE, _read_end(end), _read_transformation(kind), converts) for end, kind, converts in found)


def _write_transformation(one: Transformation | None) -> list[object] | None:
    return None if one is None else [one.kind, one.factor, one.offset, one.entries]


def _read_transformation(found: Sequence[Any] | None) -> Transformation | None:
    if found is None:
        return None
    kind, factor, offset, entries = found
    return Transformation(kind, factor, offset, tuple((source, target) for source, target in entries))


def _write_parameter(entry: Parameter) -> list[object]:
    items = None if entry.items is None else dict(entry.items)
    return [entry.value, entry.unit, _write_unit(entry.defined), items, _write_hops(entry.hops), entry.bound]


def _read_parameter(found: Sequence[Any]) -> Parameter:
    value, unit, defined, items, hops, bound = found
    return Parameter(
        value, unit, WHERE, defined=_read_unit(defined), items=items, hops=_read_hops(hops), bound=bound
    )
