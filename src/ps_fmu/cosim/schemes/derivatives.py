"""Interface Jacobians from the directional derivatives of FMUs (fmi2GetDirectionalDerivative)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..errors import SlaveError
from ..fmu_instance import FmuInstance
from ..rows import Array
from ..structure import PortName
from ..wires import Wires


@dataclass(frozen=True)
class Link:
    """A component of a loop: its Real inputs from the loop with source and factor, and its outputs into it."""

    instance: FmuInstance
    inputs: tuple[tuple[str, PortName, float], ...]
    outputs: tuple[PortName, ...]


def list_links(members: Sequence[FmuInstance], wires: Wires) -> list[Link]:
    """The links of a loop, in the order of its components."""
    names = {member.name for member in members}
    used = {
        source: None
        for target, source in wires.sources.items()
        if target.component in names and source.component in names
    }
    links = []
    for member in members:
        inputs = [
            (port.variable, wires.sources[port], _get_factor(wires, port))
            for port in wires.inputs[member.name]
            if wires.sources[port] in used and member.variables[port.variable].type == "Real"
        ]
        outputs = [p for p in used if p.component == member.name and member.variables[p.variable].type == "Real"]
        links.append(Link(member, tuple(inputs), tuple(outputs)))
    return links


def derive(
    links: Sequence[Link], unknowns: Sequence[PortName], time: float, at_once: bool = False
) -> Array | None:
    """Derivatives of what comes out of a loop by the unknowns that go in, (n, n).

    ``at_once``: all components see the unknowns; else each sees what those before it put out.  None if an FMU refuses.
    """
    jacobian = np.zeros((len(unknowns), len(unknowns)))
    try:
        for column, unknown in enumerate(unknowns):
            seen = {unknown: 1.0}
            found: dict[PortName, float] = {}
            for link in links:
                seeds = {name: factor * seen.get(source, 0.0) for name, source, factor in link.inputs}
                if not seeds or not link.outputs:
                    continue
                names = [port.variable for port in link.outputs]
                answer = link.instance.get_directional_derivative(names, seeds, time)
                found |= dict(zip(link.outputs, answer, strict=True))
                if not at_once:
                    seen |= found
            jacobian[:, column] = [found.get(port, 0.0) for port in unknowns]
    except SlaveError:
        if any(link.instance.has_failed for link in links):
            raise
        return None
    return jacobian if np.isfinite(jacobian).all() else None


def _get_factor(wires: Wires, port: PortName) -> float:
    conversion = wires.conversions.get(port)
    return 1.0 if conversion is None else conversion.factor
