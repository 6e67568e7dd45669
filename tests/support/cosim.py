"""System descriptions for toy FMUs, and all rows of a run."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from ps_fmu.cosim import Event, Master, Scheme, System

HEAD = (
    '<?xml version="1.0" encoding="UTF-8"?>\n'
    '<ssd:SystemStructureDescription xmlns:ssd="http://ssp-standard.org/SSP1/SystemStructureDescription"\n'
    '    xmlns:ssc="http://ssp-standard.org/SSP1/SystemStructureCommon"\n'
    '    xmlns:ssv="http://ssp-standard.org/SSP1/SystemStructureParameterValues"\n'
    '    version="1.0" name="test">\n<ssd:System name="test">\n'
)
PORTS = {
    "ToyMass": [
        ("force", "input", "Real"),
        ("position", "output", "Real"),
        ("velocity", "output", "Real"),
    ],
    "ToySpring": [("position", "input", "Real"), ("velocity", "input", "Real"), ("force", "output", "Real")],
    "ToyGain": [("u", "input", "Real"), ("y", "output", "Real")],
    "ToyCounter": [
        ("enabled", "input", "Boolean"),
        ("increment", "input", "Integer"),
        ("count", "output", "Integer"),
        ("odd", "output", "Boolean"),
        ("half", "output", "Real"),
    ],
    "ToyFailing": [("clock", "output", "Real")],
    "ToyInterrupting": [("clock", "output", "Real")],
    "Faulty": [("u", "input", "Real"), ("y", "output", "Real")],
}
OSCILLATOR = (
    {"mass": "ToyMass", "spring": "ToySpring"},
    ["mass.position -> spring.position", "mass.velocity -> spring.velocity", "spring.force -> mass.force"],
)


def ssd_text(components: Mapping[str, str], connections: Sequence[str], inside: str = "", after: str = "") -> str:
    """A system description: component -> FMU, ``a.x -> b.y``; ``inside`` the system and ``after`` it, any XML."""
    lines = [HEAD, "<ssd:Elements>\n"]
    for name, model in components.items():
        lines.append(
            f'<ssd:Component name="{name}" type="application/x-fmu-sharedlibrary" '
            f'source="resources/{model}.fmu">\n<ssd:Connectors>\n'
        )
        lines += [
            f'<ssd:Connector name="{port}" kind="{kind}"><ssc:{type_}/></ssd:Connector>\n'
            for port, kind, type_ in PORTS[model]
        ]
        lines.append("</ssd:Connectors>\n</ssd:Component>\n")
    lines.append("</ssd:Elements>\n<ssd:Connections>\n")
    for connection in connections:
        start, end = (port.split(".", 1) for port in connection.split(" -> "))
        lines.append(
            f'<ssd:Connection startElement="{start[0]}" startConnector="{start[1]}" '
            f'endElement="{end[0]}" endConnector="{end[1]}"/>\n'
        )
    lines.append(f"</ssd:Connections>{inside}</ssd:System>{after}</ssd:SystemStructureDescription>\n")
    return "".join(lines)


class Collect:
    """Observer that keeps everything; with the names of the columns, each is there by its name."""

    def __init__(self, names: Sequence[str] = ()) -> None:
        self.names = list(names)
        self.firsts: list[int] = []
        self._times: list[np.ndarray] = []
        self._values: list[np.ndarray] = []

    def block(self, first_index: int, time: np.ndarray, values: np.ndarray) -> None:
        self.firsts.append(first_index)
        self._times.append(time.copy())
        self._values.append(values.copy())

    @property
    def time(self) -> np.ndarray:
        return np.concatenate(self._times) if self._times else np.zeros(0)

    @property
    def values(self) -> np.ndarray:
        return np.concatenate(self._values)

    def __getitem__(self, name: str) -> np.ndarray:
        return self.values[:, self.names.index(name)]


def simulate(
    system: System, step: float | None = None, end: float = 0.5, scheme: str | Scheme = "jacobi",
    events: Iterable[Event] = (), **options: Any,
) -> Collect:  # fmt: skip
    """All rows of a run up to ``end`` [s] by name; options as of the master."""
    with Master(system, step, scheme, **options) as master:
        rows = Collect([column.name for column in master.columns])
        master.initialise()
        master.run(end, [rows], events)
    return rows
