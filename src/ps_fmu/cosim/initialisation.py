"""Bring all FMUs of a system to their first communication point, with initial values that agree; and to their end."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Collection, Mapping, Sequence

import numpy as np
from fmpy.model_description import ModelDescription

from .errors import SlaveError
from .fmu_instance import FmuInstance, InstancePhase
from .graph import Wiring
from .rows import InputSignal, Rows
from .schemes.initial import InitialBus, solve_initial_loop
from .schemes.scheme import Iteration
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
