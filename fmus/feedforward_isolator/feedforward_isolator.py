"""FeedforwardIsolator: fine forces from measured base acceleration, the practical controller of eq (55)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from ps_fmu.control.feedforward import count_states, make_filters
from ps_fmu.control.isolator import Isolator, UnreachableOrientationError
from ps_fmu.interface.ports import (
    CONTROL_PORTS,
    LONGEST_DELAY,
    ORIENTATION,
    make_parameter_ports,
    refuse_delays,
    refuse_parameters,
)  # fmt: skip
from ps_fmu.mechanism.parameters import LARGEST_ORDER, load
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
    # High-passed rotation of the base and its rate (its translation has no gain there); low-pass of the forces.
    n_states: ClassVar[int] = count_states(LARGEST_ORDER) - 6
    # Acceleration as last sampled, where the controller has a period of its own; forces that the low-pass filters.
    n_auxiliary: ClassVar[int] = 6 + 3
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
        """Take the present orientation, filters at rest."""
        self.x[:] = self.a[:] = self.memory[:] = 0.0
        self._build()
        self.kept[:] = self.values("orientation")
        try:
            self.isolator.controller(self.kept)
        except UnreachableOrientationError as error:
            raise ModelError(str(error)) from None

    def continuous(self) -> Matrices:
        """The filters: of the base's acceleration, and of the forces that its gains make of it."""
        A, B = make_filters(self.isolator.lowpass, self.isolator.filters)
        used = self._find_used(len(A))
        n, inputs = len(used), self.u.size + self.a.size
        first = self.u.size if self.sample_time else 0
        all_A, all_B = np.zeros((self.n_states, self.n_states)), np.zeros((self.n_states, inputs))
        all_A[:n, :n] = A[np.ix_(used, used)]
        all_B[:n, np.r_[first : first + 6, inputs - 3 : inputs]] = B[used]
        C, low = np.zeros((self.y.size, self.n_states)), self.isolator.lowpass
        C[:3, 6 : 6 + 3 * low.order] = np.kron(np.eye(3), low.c)
        return all_A, all_B, C, np.zeros((self.y.size, inputs))

    def linearise(self) -> tuple[Matrices, NDArray[np.float64]]:
        """At the orientation of the gains, which is no input of it, within the force limit."""
        refuse_delays(sample_time=self.sample_time, delay=self.delay)
        A, B, C, D = self.isolator.controller(self.kept).matrices()
        used = self._find_used(len(A))
        n, on = len(used), float(bool(self.value("enabled")))
        all_A, all_C = np.zeros((self.n_states, self.n_states)), np.zeros((self.y.size, self.n_states))
        all_B, all_D = (np.zeros((rows, self.u.size)) for rows in (self.n_states, self.y.size))
        all_A[:n, :n], all_B[:n, :6] = A[np.ix_(used, used)], B[used]
        all_C[:3, :n], all_D[:3, :6] = on * C[:, used], on * D
        all_B[:, 6:], all_D[:, 6:] = np.nan, np.nan
        return (all_A, all_B, all_C, all_D), all_A @ self.x + all_B[:, :6] @ self.u[:6]

    def _find_used(self, n: int) -> NDArray[np.int64]:
        """Those of n states of the filters that are states here."""
        return np.r_[3:6, 9:n]

    def before_map(self, h: float) -> Sequence[Element]:
        """Return the sample of the acceleration, and the gains of the orientation."""
        acceleration, words = self.u[:6], self.words
        elements: list[Element] = []
        if self.sample_time:
            acceleration = self.a[:6]
            elements.append(Sample(self.u[:6], acceleration, self.sampled, self.sample_time))
        words.acceleration = self.places(acceleration)[0]
        driven = np.concatenate([self.places(self.kept), self.places(self.a[6:])])
        return *elements, Call(find_function("control_drive_isolator"), words, driven)

    def after_map(self, h: float) -> Sequence[Element]:
        """Return the gains of the filtered motion of the base, hold and delay of the forces, and the switch."""
        force = self.y[:3]
        elements: list[Element] = [Call(find_function("control_add_isolator"), self.words, force)]
        hold = Hold(force, self.held_force, self.held, self.sample_time) if self.sample_time else None
        if hold:
            elements.append(hold)
        if self.delay:
            elements.append(Delay(force, self.ring, self.delay, hold))
        if hold or self.delay:  # disabled, at once, whatever is still on its way
            elements.append(Product(force, self.places(self.view("enabled"))[[0, 0, 0]], force))
        return elements

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
        places = {"orientation": self.view("orientation"), "kept_orientation": self.kept, "driven": self.a[6:],
                  "filtered": self.x, "forces": self.y, "enabled": self.view("enabled")}  # fmt: skip
        self.words = self.isolator.pack(**{name: int(self.places(view)[0]) for name, view in places.items()})
