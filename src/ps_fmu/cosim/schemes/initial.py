"""Initial values: passed along connections, and loops among them solved."""

from __future__ import annotations

import logging
from collections.abc import Collection, Mapping, Sequence

import numpy as np

from ..errors import ConvergenceError
from ..fmu_instance import FmuInstance
from ..graph import Wiring
from ..rows import Array
from ..structure import PortName, Value
from .scheme import Iteration
from .solver import InterfaceSolver, Link, NotConverged, derive, make_links

log = logging.getLogger("ps_fmu.cosim")


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
        f"loop of {', '.join(members)}: not solved at the start, t = {bus.start:.9g} s: {', '.join(map(str, moving))} "
        f"still change after {passes} passes",
        members=members, time=bus.start, variable=str(moving[0]), residual=float("inf"),
    )  # fmt: skip
