"""The linear continuous system that a system of FMUs is about its present state, from their directional derivatives.

The derivatives are those of FMI 2.0: of outputs and of rates of states (``Derivatives`` of the model structure), by
states and inputs.  Connections have no delay here, as if the communication step were infinitely short.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from fmpy.model_description import ModelDescription
from numpy.typing import NDArray

from .errors import SlaveError, UsageError
from .fmu_instance import DISCARD, FmuInstance
from .master import Master
from .structure import PortName, parse_port

Array = NDArray[np.float64]
#: Condition of the equations of an algebraic loop beyond which they have no solution.
WORST_LOOP = 1e12


@dataclass(frozen=True, eq=False)
class LinearSystem:
    """``x' = A x + B u``, ``y = C x + D u`` of deviations."""

    A: Array
    B: Array
    C: Array
    D: Array
    states: tuple[str, ...]
    """``component.x[i]``, those that move or act."""
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    constant: tuple[str, ...]
    """Connected inputs ``component.variable`` that are taken as constant: their FMU provides no derivative by them."""


@dataclass(frozen=True, eq=False)
class _Part:
    """One component: its matrices, from states and inputs to rates and outputs."""

    matrices: tuple[Array, Array, Array, Array]
    states: list[str]
    inputs: list[PortName]
    outputs: list[PortName]
    constant: list[PortName]


def linearise(
    master: Master, inputs: Sequence[str], outputs: Sequence[str], constant: Collection[str] = ()
) -> LinearSystem:
    """The linear system about the present state of a run.

    Parameters
    ----------
    inputs: Real inputs ``component.variable``; of a connected one, what is added to its signal.
    outputs: Real outputs ``component.variable``.
    constant: components whose outputs are taken as constant.

    Raises
    ------
    UsageError: a name is unknown; a component that acts back provides no derivatives, or is no linear continuous
        system now; the connections have an algebraic loop without solution.
    """
    wanted = [_find(master, name, "input") for name in inputs], [_find(master, name, "output") for name in outputs]
    for name in constant:
        master.system.component(name)
    wires = {
        c.target: c.source
        for c in master.system.connections
        if _is_real(master, c.target) and _is_real(master, c.source)
    }
    members = [name for name, one in master.instances.items() if one.derives and name not in constant]
    _refuse_others(master, members, wires, wanted, constant)
    needed = {*wanted[1], *(source for target, source in wires.items() if target.component in members)}
    known = {*wanted[0], *(target for target, source in wires.items() if source.component in members)}
    parts = [
        _differentiate(
            master.instances[name], master.descriptions[name],
            [port for port in sorted(known) if port.component == name],
            [port for port in sorted(needed) if port.component == name], master.time,
        )
        for name in members
    ]  # fmt: skip
    for port in wanted[0]:
        if any(port in part.constant for part in parts):
            raise UsageError(f"inputs: {port}: its FMU provides no derivative by it; expected another input")
    return _connect(parts, wires, {t: c.factor for t, c in master.wiring.conversions.items()}, *wanted)


def _find(master: Master, name: str, causality: str) -> PortName:
    port = parse_port(name)
    master.system.component(port.component)
    variables = master.instances[port.component].variables
    if port.variable not in variables or variables[port.variable].causality != causality or not _is_real(master, port):
        raise UsageError(f"{causality}s: {name}: expected a Real {causality}, ps-fmu list shows them")
    return port


def _is_real(master: Master, port: PortName) -> bool:
    return master.instances[port.component].variables[port.variable].type == "Real"


def _refuse_others(
    master: Master, members: Sequence[str], wires: Mapping[PortName, PortName],
    wanted: tuple[Sequence[PortName], Sequence[PortName]], constant: Collection[str],
) -> None:  # fmt: skip
    """Refuse components without derivatives that lie between others, or that a wanted variable is of."""
    for name in master.instances:
        if name in members or name in constant:
            continue
        driven = any(target.component == name and source.component in members for target, source in wires.items())
        acts = any(source.component == name and target.component in members for target, source in wires.items())
        asked = any(port.component == name for ports in wanted for port in ports)
        if (driven and acts) or asked:
            source = master.system.component(name).source.name
            raise UsageError(
                f"{name} ({source}): it provides no directional derivatives, so the system is not linear with it; "
                f"expected providesDirectionalDerivative, or constant = [{name!r}], which takes its outputs as constant"
            )


def _differentiate(
    instance: FmuInstance, description: ModelDescription, inputs: list[PortName], outputs: list[PortName], time: float
) -> _Part:
    """The matrices of one component, a column for each state and input."""
    rates = [unknown.variable for unknown in description.derivatives]
    states = [rate.derivative.name for rate in rates]
    unknowns = [*(rate.name for rate in rates), *(port.variable for port in outputs)]
    columns: list[list[float]] = []
    used: list[PortName] = []
    constant: list[PortName] = []
    for name in (*states, *(port.variable for port in inputs)):
        try:
            found = instance.get_directional_derivative(unknowns, {name: 1.0}, time) if unknowns else []
        except SlaveError as error:
            if error.status != DISCARD:
                raise
            if name in states:
                raise UsageError(
                    f"{instance.name}: it is no linear continuous system now: {'; '.join(error.messages)}"
                ) from error
            constant.append(PortName(instance.name, name))
            continue
        columns.append(found)
        used += [] if name in states else [PortName(instance.name, name)]
    matrix = np.array(columns, dtype=np.float64).reshape(len(columns), len(unknowns)).T
    n = len(states)
    if not np.isfinite(matrix).all():
        raise UsageError(f"{instance.name}: its directional derivatives are not finite; expected numbers")
    matrices = matrix[:n, :n], matrix[:n, n:], matrix[n:, :n], matrix[n:, n:]
    return _Part(matrices, [f"{instance.name}.{name}" for name in states], used, outputs, constant)


def _connect(
    parts: Sequence[_Part], wires: Mapping[PortName, PortName], factors: Mapping[PortName, float],
    inputs: Sequence[PortName], outputs: Sequence[PortName],
) -> LinearSystem:  # fmt: skip
    """Close the connections of all parts."""
    A, B, C, D = (_join([part.matrices[k] for part in parts]) for k in range(4))
    sinks = [port for part in parts for port in part.inputs]
    sources = [port for part in parts for port in part.outputs]
    W, E = np.zeros((len(sinks), len(sources))), np.zeros((len(sinks), len(inputs)))
    S = np.zeros((len(outputs), len(sources)))
    for row, port in enumerate(sinks):
        if wires.get(port) in sources:
            W[row, sources.index(wires[port])] = factors.get(port, 1.0)
    for column, port in enumerate(inputs):
        E[sinks.index(port), column] = 1.0
    for row, port in enumerate(outputs):
        S[row, sources.index(port)] = 1.0
    loop = np.eye(len(sources)) - D @ W
    if len(loop) and not np.linalg.cond(loop) < WORST_LOOP:
        raise UsageError("the connections of the FMUs have an algebraic loop without a solution")
    from_states, from_inputs = np.linalg.solve(loop, C), np.linalg.solve(loop, D @ E)
    A, B = A + B @ W @ from_states, B @ (E + W @ from_inputs)
    C, D = S @ from_states, S @ from_inputs
    kept = np.flatnonzero(np.hstack([A, B]).any(axis=1) | np.vstack([A, C]).any(axis=0))
    states = [name for part in parts for name in part.states]
    constant = [str(port) for part in parts for port in part.constant if port in wires]
    return LinearSystem(
        A[np.ix_(kept, kept)], B[kept], C[:, kept], D, tuple(states[k] for k in kept), tuple(map(str, inputs)),
        tuple(map(str, outputs)), tuple(constant),
    )  # fmt: skip


def _join(blocks: Sequence[Array]) -> Array:
    joined = np.zeros(np.sum([block.shape for block in blocks], axis=0, dtype=int))
    row = column = 0
    for block in blocks:
        joined[row : row + block.shape[0], column : column + block.shape[1]] = block
        row, column = row + block.shape[0], column + block.shape[1]
    return joined
