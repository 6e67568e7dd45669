"""FeedforwardIsolator: fine forces from measured base acceleration, the practical controller of eq (55)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from ps_fmu.control.isolator import MOST_AXIS_STATES, Isolator, UnreachableOrientationError
from ps_fmu.interface.ports import (
    CONTROL_PORTS,
    LONGEST_DELAY,
    ORIENTATION,
    differentiate,
    make_parameter_ports,
    refuse_delays,
    refuse_parameters,
)  # fmt: skip
from ps_fmu.mechanism.parameters import load
from ps_fmu.mechanism.quantities import take_values
from ps_fmu.numerics.library import find_function
from ps_fmu.slavekit.author.elements import Call, Delay, Element, Hold, Product, Sample, ring_size
from ps_fmu.slavekit.author.model import Matrices
from ps_fmu.slavekit.author.slave import ModelError, Slave
from ps_fmu.slavekit.author.terminals import Terminal
from ps_fmu.slavekit.author.variables import Port, numbered, vector

DEFAULT = Isolator.from_parameters(load())


class FeedforwardIsolator(Slave):
    """Cancels the base's vibration at the payload; has its own copy of what it must know of the plant."""

    model_description = "Feedforward vibration isolator: voice-coil forces from measured base acceleration"
    physics: ClassVar[type] = Isolator
    n_states: ClassVar[int] = 3 * MOST_AXIS_STATES  # of Isolator.axis_matrices, axis by axis; unused ones behind them
    n_auxiliary: ClassVar[int] = 6  # acceleration as last sampled, where the controller has a period of its own
    any_step: ClassVar[bool] = True
    provides_derivatives: ClassVar[bool] = True
    n_memory: ClassVar[int] = 3 + 1 + 1 + 3 + ring_size(3, LONGEST_DELAY)  # see the views in _build
    limit_flag: ClassVar[str] = "saturated"

    ports: ClassVar[tuple[Port, ...]] = (
        *vector(
            "base_acceleration", "xyz", "m/s2", "Measured acceleration of the origin of B, in B",
            causality="input", nominal=1e-3,
        ),
        *vector(
            "base_angular_acceleration", "xyz", "rad/s2", "Measured angular acceleration of B, in B",
            causality="input", nominal=1e-3,
        ),
        *ORIENTATION,
        Port(
            "enabled", "input", type="Boolean", start=True, event=False,
            description="False: the forces are zero; the filters still run, so that it can be switched on at any time",
        ),
        # At rest and strictly proper: the force is zero in initialisation mode whatever the inputs are.
        *numbered(
            "fine_force", 3, "N", "Force demanded of a fine actuator, positive extends the leg",
            causality="output", initially_depends_on=(), nominal=0.1,
        ),
        Port(
            "saturated", "output", type="Boolean", description="True: a force is at force_limit",
            initially_depends_on=(),
        ),
        *make_parameter_ports(DEFAULT),
        *CONTROL_PORTS,
    )  # fmt: skip

    terminals: ClassVar[tuple[Terminal, ...]] = (
        Terminal("fine_actuators", ("fine_force",), "Forces of the fine actuators"),
        Terminal(
            "measurements",
            ("base_acceleration", "base_angular_acceleration", "orientation"),
            "Accelerometers at the origin of B, and the nominal orientation of P",
        ),
    )

    @refuse_parameters
    def configure(self) -> None:
        """Take the present orientation, filters at rest: no force."""
        self.y[:] = self.x[:] = self.a[:] = self.memory[:] = 0.0
        self._build()
        self.kept[:] = self.values("orientation")
        try:
            self.isolator.controller(self.kept)
        except UnreachableOrientationError as error:
            raise ModelError(str(error)) from None

    def step_map(self, h: float) -> None:
        """Return None: C does all."""

    def before_map(self, h: float) -> Sequence[Element]:
        """Return the sample of the acceleration; gains, filters and forces; their hold and delay, and the switch."""
        force, words, elements = self.y[:3], self.words, list[Element]()
        acceleration, hold = self.u[:6], None
        if self.sample_time:
            acceleration, hold = self.a[:6], Hold(force, self.held_force, self.held, self.sample_time)
            elements.append(Sample(self.u[:6], acceleration, self.sampled, self.sample_time))
        words.acceleration = self.places(acceleration)[0]
        written = np.concatenate([self.places(view) for view in (self.kept, self.y, self.x)])
        elements.append(Call(find_function("control_isolate"), words, written))
        if hold:
            elements.append(hold)
        if self.delay:
            elements.append(Delay(force, self.ring, self.delay, hold))
        if hold or self.delay:  # disabled, at once, whatever is still on its way
            elements.append(Product(force, self.places(self.view("enabled"))[[0, 0, 0]], force))
        return elements

    def linearise(self) -> tuple[Matrices, NDArray[np.float64]]:
        """From acceleration and orientation to the forces, without their limit."""
        refuse_delays(sample_time=self.sample_time, delay=self.delay)
        A, B, C = self.isolator.linearise(self.view("orientation"))
        by_turn = differentiate(self.isolator.linearise, self.view("orientation"))
        nx, n, x, acceleration = self.n_states, len(A), self.x[: len(A)], self.u[:6]
        all_A, all_B, all_C, all_D = np.zeros((nx, nx)), np.zeros((nx, 9)), np.zeros((4, nx)), np.zeros((4, 9))
        all_A[:n, :n], all_B[:n, :6] = A, B
        all_B[:n, 6:] = np.column_stack([turned[1] @ acceleration for turned in by_turn])
        if self.value("enabled"):
            all_C[:3, :n], all_D[:3, 6:] = C, np.column_stack([turned[2] @ x for turned in by_turn])
        rates = np.zeros(nx)
        rates[:n] = A @ x + B @ acceleration
        return (all_A, all_B, all_C, all_D), rates

    def limits(self) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
        """The largest force of a fine actuator, either way."""
        limit = float(self.value("force_limit"))
        if not limit:
            return None
        upper = np.array([limit, limit, limit, np.inf])
        return -upper, upper

    @refuse_parameters
    def restore(self) -> None:
        """Rebuild what the parameters stand for."""
        self._build()

    def _build(self) -> None:
        values = self.parameters()
        self.isolator = take_values(DEFAULT, values)
        # Orientation of the gains, rad; parts of a period since a sample; force, N.
        self.kept, self.sampled, self.held, self.held_force, self.ring = np.split(self.memory, [3, 4, 5, 8])
        self.sample_time, self.delay = float(values["sample_time"]), float(values["delay"])  # s
        places = {"orientation": self.view("orientation"), "kept_orientation": self.kept, "states": self.x,
                  "enabled": self.view("enabled"), "forces": self.y}  # fmt: skip
        self.words = self.isolator.pack(**{name: int(self.places(view)[0]) for name, view in places.items()})
