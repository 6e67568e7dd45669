"""Bring all FMUs of a system to their first communication point, with initial values that agree; and to their end."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Collection, Mapping, Sequence

import numpy as np
from fmpy.model_description import ModelDescription

from .errors import ConvergenceError, SlaveError
from .fmu_instance import FmuInstance, InstancePhase
from .graph import Wiring
from .rows import Array, InputSignal, Rows
from .schemes.scheme import Iteration
from .schemes.solver import InterfaceSolver, Link, NotConverged, derive, make_links
from .structure import Component, PortName, System, Value

log = logging.getLogger("ps_fmu.cosim")

SETTLED = 1e-9
"""A value of a loop that changes less in the last pass, absolutely or relatively, has settled."""


def load(
    system: System,
    descriptions: Mapping[str, ModelDescription],
    instances: dict[str, FmuInstance],
    make: Callable[[Component, ModelDescription], FmuInstance] = FmuInstance,
) -> None:
    """Unpack and instantiate each component; what is loaded is in ``instances`` also when a later one fails.

    ``make`` loads one.

    Raises :class:`SystemFileError` or :class:`SlaveError`.
    """
    with system.name_members():
        for component in system.components:
            instances[component.name] = make(component, descriptions[component.name])


def initialise(
    instances: Mapping[str, FmuInstance],
    system: System,
    wiring: Wiring,
    given: Mapping[PortName, Value],
    start: float,
    iteration: Iteration | None = None,
) -> None:
    """Set start values, and pass the initial values along the connections.

    ``given`` are values that the user has set: they outrank those of the system, and a connected input among
    them is left alone.  With ``iteration`` loops are solved so, else their values go round as often as there are FMUs.
    Raises :class:`SlaveError` or :class:`ConvergenceError`.
    """
    for component in system.components:
        values = dict(wiring.starts[component.name])
        values |= {port.variable: value for port, value in given.items() if port.component == component.name}
        instance = instances[component.name]
        instance.set_up(start)
        instance.set(values, start)
        instance.enter_initialisation(start)
    _propagate(instances, wiring, given.keys(), start, iteration)
    for instance in instances.values():
        instance.exit_initialisation(start)


def read_first_row(
    instances: Mapping[str, FmuInstance],
    rows: Rows,
    start: float,
    signals: Sequence[InputSignal] = (),
    step: float = 0.0,
) -> None:
    """Read all outputs into the first row of the block, and the inputs of the run.  Raises :class:`SlaveError`."""
    for kind in (rows.real, rows.discrete):
        for port, place in kind.places.items():
            if port.component:
                kind.values[place] = instances[port.component].get([port.variable], start)[port.variable]
    for signal in signals:
        values, place = rows.find_place(signal.port)
        values[place] = signal.sample(np.array([start]), step)[0]
    rows.store_latest()


def _propagate(
    instances: Mapping[str, FmuInstance],
    wiring: Wiring,
    cut: Collection[PortName],
    start: float,
    iteration: Iteration | None,
) -> None:
    """In the order that the FMUs' dependencies give; round a loop as often as there are FMUs, or until it is solved."""
    bus = InitialBus(instances, wiring, cut, start)
    for group in wiring.order:
        if group.passes > 1 and iteration is not None:
            solve_initial_loop(bus, group.outputs, iteration)
            continue
        values: dict[PortName, Value] = {}
        before = values
        for _ in range(group.passes):
            before = values
            values = bus.read(group.outputs)
            if values == before:  # to the last bit: another pass would set what the inputs have already
                break
            bus.pass_on(values)
        moving = [str(p) for p, value in values.items() if p in before and not _is_settled(value, before[p])]
        if moving:
            log.warning("initial values in a loop still change after %d passes: %s", group.passes, ", ".join(moving))


def _is_settled(value: Value, other: Value) -> bool:
    if isinstance(value, str) or isinstance(other, str):
        return value == other
    return math.isclose(value, other, rel_tol=SETTLED, abs_tol=SETTLED)


# ---- the end --------------------------------------------------------------------------------------------------------


def end_all(instances: Collection[FmuInstance], time: float) -> list[SlaveError]:
    """Terminate all at ``time`` [s], then free all; returns what failed."""
    failures = []
    _silence_fatal(instances)
    for instance in instances:
        try:
            instance.terminate(time)
        except SlaveError as error:
            failures.append(error)
    _silence_fatal(instances)
    for instance in instances:
        try:
            instance.free()
        except SlaveError as error:
            failures.append(error)
    return failures


def _silence_fatal(instances: Collection[FmuInstance]) -> None:
    """After fmi2Fatal all instances of that FMU are corrupt, not only one (FMI 2.0.4, section 2.1.3)."""
    shared = [instance for instance in instances if instance.shares_process]
    corrupt = {instance.source.resolve() for instance in shared if instance.phase is InstancePhase.FATAL}
    for instance in shared:
        if instance.source.resolve() in corrupt:
            instance.phase = InstancePhase.FATAL


# --- Values that are passed along connections, and loops among them ---------------------------------------------------


class InitialBus:
    """Carries values from outputs to inputs at the start [s]; inputs that are ``cut`` get none."""

    def __init__(
        self, instances: Mapping[str, FmuInstance], wiring: Wiring, cut: Collection[PortName], start: float
    ) -> None:
        self.instances, self.wiring, self.start = instances, wiring, start
        self.carried: dict[PortName, list[PortName]] = {}
        for connection in wiring.connections:
            if connection.target not in cut:
                self.carried.setdefault(connection.source, []).append(connection.target)

    def read(self, ports: Collection[PortName]) -> dict[PortName, Value]:
        """Outputs of some components, in as few calls as there are components: a ring of 64 is passed 64 times."""
        names: dict[str, list[str]] = {}
        for port in ports:
            names.setdefault(port.component, []).append(port.variable)
        found = {component: self.instances[component].get(own, self.start) for component, own in names.items()}
        return {port: found[port.component][port.variable] for port in ports}

    def pass_on(self, values: Mapping[PortName, Value]) -> None:
        """Set the inputs that these outputs are connected to."""
        passed: dict[str, dict[str, Value]] = {}
        for source, value in values.items():
            for target in self.carried.get(source, ()):
                conversion = self.wiring.conversions.get(target)
                value_there = value if conversion is None else conversion.apply(value)
                passed.setdefault(target.component, {})[target.variable] = value_there
        for name, inputs in passed.items():
            self.instances[name].set(inputs, self.start)

    def list_links(self, ports: Sequence[PortName]) -> list[Link]:
        """How components make these Real outputs from one another."""
        members = [self.instances[name] for name in dict.fromkeys(port.component for port in ports)]
        ways = {target: source for source in ports for target in self.carried.get(source, ())}
        return make_links(members, ways, ports, self.wiring.conversions)


def solve_initial_loop(bus: InitialBus, ports: Sequence[PortName], iteration: Iteration) -> None:
    """Find values of the outputs of a loop with which all inputs and outputs agree; inputs get them.

    What is no Real goes round until it stays.  Raises :class:`ConvergenceError` or :class:`SlaveError`.
    """
    values = bus.read(ports)
    reals = [port for port, value in values.items() if isinstance(value, float)]
    links = bus.list_links(reals)
    exact = all(link.instance.derives for link in links)

    def evaluate(z: Array) -> Array:
        bus.pass_on({**values, **dict(zip(reals, z.tolist(), strict=True))})
        values.update(bus.read(ports))
        return np.array([values[port] for port in reals], dtype=np.float64)

    def differentiate() -> Array | None:
        return derive(links, reals, bus.start, at_once=True) if exact else None

    nominal = [bus.instances[port.component].get_nominal(port.variable) for port in reals]
    solver = InterfaceSolver(iteration, np.array(nominal))
    members = tuple(dict.fromkeys(port.component for port in ports))
    passes = 0
    for _ in range(len(members) + 1):
        others = {port: values[port] for port in ports if port not in reals}
        try:
            found = solver.solve(evaluate, np.array([values[port] for port in reals], dtype=np.float64), differentiate)
        except NotConverged as failure:
            raise failure.explain("at the start,", members, reals, bus.start) from None
        passes += found.passes
        moving = [port for port, value in others.items() if values[port] != value]
        if not moving:
            log.info("initial loop of %s: solved after %d passes", ", ".join(members), passes)
            return
    raise ConvergenceError(
        f"loop of {', '.join(members)}: not solved at the start, t = {bus.start:.9g} s: after {passes} passes these "
        f"values still change: {', '.join(map(str, moving))}",
        members=members, time=bus.start, variable=str(moving[0]), residual=float("inf"),
    )  # fmt: skip
