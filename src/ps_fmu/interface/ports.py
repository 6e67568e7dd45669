"""FMI variables made from the physics: parameters from the dataclasses, outputs from the model's own list."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterable
from typing import Any, TypeVar

import numpy as np

from ..mechanism.quantities import Array, ParameterError, Signal, list_entries
from ..slavekit.author.guard import ModelError
from ..slavekit.author.variables import Port, Type, vector

F = TypeVar("F", bound=Callable[..., Any])

#: Of a controller's forces in communication steps; 0.1 s at 1e-4 s.
LONGEST_DELAY = 1000
ORIENTATION = vector(
    "orientation", ("roll", "pitch", "yaw"), "rad", "Nominal orientation of P in B, from which the gains follow",
    causality="input", display_unit="deg", nominal=0.1,
)  # fmt: skip
_DISPLAY = {"rad": "deg"}
_TYPES: dict[type, Type] = {bool: "Boolean", int: "Integer", str: "String"}


def make_parameter_ports(component: Any) -> tuple[Port, ...]:
    """A parameter port for each scalar of a dataclass, of the type of its value, which is the start value."""
    ports = []
    for entry in list_entries(component):
        kind = _TYPES.get(type(entry.value), "Real")
        real = kind == "Real"
        ports.append(
            Port(
                entry.name,
                "parameter",
                entry.unit if real else "1",
                entry.description,
                type=kind,
                start=entry.value,
                min=entry.minimum,
                max=entry.maximum,
                display_unit=entry.display or _DISPLAY.get(entry.unit) if real else None,
            )
        )
    return tuple(ports)


def make_output_ports(signals: Iterable[Signal]) -> tuple[Port, ...]:
    """An output port for each component of the signals, in their order."""
    return tuple(
        Port(
            name,
            "output",
            signal.unit,
            f"{signal.description}, {component}",
            nominal=signal.nominal,
            display_unit=signal.display_unit,
            initially_depends_on=() if signal.starts_at_zero else None,
        )
        for signal in signals
        for name, component in zip(signal.names, signal.components, strict=True)
    )


#: Parameters of a digital controller of the fine forces.
CONTROL_PORTS = (
    Port("force_limit", "parameter", "N", "Largest force of a fine actuator; 0 = no limit", min=0.0),
    Port(
        "delay", "parameter", "s", f"Pure delay of the forces, of at most {LONGEST_DELAY} steps",
        min=0.0, display_unit="ms",
    ),
    Port(
        "sample_time", "parameter", "s", "Sample time of the controller; 0 = every communication step",
        min=0.0, display_unit="ms",
    ),
)  # fmt: skip


def refuse_parameters(method: F) -> F:
    """For methods of slaves: a ParameterError, which names the parameter, becomes a refusal, a ModelError."""

    @functools.wraps(method)
    def wrapper(self: Any, *args: Any) -> Any:
        try:
            return method(self, *args)
        except ParameterError as error:
            raise ModelError(str(error)) from None

    return wrapper  # type: ignore[return-value]


def differentiate(matrices: Callable[[Array], tuple[Array, ...]], at: Array) -> list[list[Array]]:
    """By each of three angles (rad): the derivatives of matrices that are functions of them, by central differences."""
    step = 1e-5  # rad; leaves 1e-10 of the matrices
    found = []
    for turn in step * np.eye(3):
        pairs = zip(matrices(at + turn), matrices(at - turn), strict=True)
        found.append([np.asarray(above - below) / (2.0 * step) for above, below in pairs])
    return found


def refuse_delays(**times: float) -> None:
    """Raise ModelError for a sample time or a delay, s, that is not 0: a linear continuous system has none."""
    for name, time in times.items():
        if time:
            raise ModelError(f"{name} = {time:g} s: expected 0, since a linear continuous system has no delay")
