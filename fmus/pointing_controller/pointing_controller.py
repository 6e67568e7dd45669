"""PointingController: fine forces from the line-of-sight error, beside those of the isolator."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from ps_fmu.control.isolator import UnreachableOrientationError
from ps_fmu.control.pointing import N_STATES, PointingLaw
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
from ps_fmu.slavekit.author.elements import Call, Clip, Delay, Element, Hold, Product, Sample, ring_size
from ps_fmu.slavekit.author.model import Matrices
from ps_fmu.slavekit.author.slave import ModelError, Slave
from ps_fmu.slavekit.author.terminals import Terminal
from ps_fmu.slavekit.author.variables import Port, numbered, vector

DEFAULT = PointingLaw.from_parameters(load())


class PointingController(Slave):
    """Keeps the payload on its target below the frequency where the isolator takes over."""

    model_description = "Pointing controller: voice-coil forces from the line-of-sight error"
    physics: ClassVar[type] = PointingLaw
    n_states: ClassVar[int] = N_STATES
    n_auxiliary: ClassVar[int] = 3  # the error as last sampled
    any_step: ClassVar[bool] = True
    provides_derivatives: ClassVar[bool] = True
    n_memory: ClassVar[int] = 3 + 3 + 3 + 1 + 1 + ring_size(3, LONGEST_DELAY)  # see the views in _build

    ports: ClassVar[tuple[Port, ...]] = (
        *vector(
            "line_of_sight_error", "xyz", "rad", "Measured small rotation from the payload to its target, in P",
            causality="input", display_unit="urad", nominal=1e-6,
        ),
        *ORIENTATION,
        Port(
            "locked", "input", type="Boolean", start=True, event=False,
            description="False: the error is not used, and the forces stay constant",
        ),
        Port(
            "enabled", "input", type="Boolean", start=True, event=False,
            description="False: the forces are zero, and the integrators are reset",
        ),
        *numbered(
            "fine_force", 3, "N", "Force demanded of a fine actuator, added to the isolator's",
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
        Terminal("pointing_error", ("line_of_sight_error", "locked"), "What the line-of-sight sensor measures"),
    )

    @refuse_parameters
    def configure(self) -> None:
        """Take the present orientation, at rest: no force."""
        self.y[:] = self.x[:] = self.a[:] = self.memory[:] = 0.0
        self._build()
        self.kept[:] = self.values("orientation")
        try:
            self.law.controller(self.kept)
        except UnreachableOrientationError as error:
            raise ModelError(str(error)) from None

    def step_map(self, h: float) -> None:
        """Return None: C does all."""

    def before_map(self, h: float) -> Sequence[Element]:
        """Return the sample of the error; gains, filter and forces; their limit, hold and delay, and the switch."""
        error, hold, words, elements = self.view("line_of_sight_error"), None, self.words, list[Element]()
        force = self.view("fine_force")
        if self.sample_time:
            elements.append(Sample(error, self.a, self.sample_clock, self.sample_time))
            error, hold = self.a, Hold(force, self.held, self.hold_clock, self.sample_time)
        words.error = self.places(error)[0]
        written = np.concatenate([self.places(view) for view in (self.kept, self.y, self.x, self.unlimited)])
        elements.append(Call(find_function("control_point"), words, written))
        if words.limit < np.inf:
            elements.append(Clip(force, -words.limit, words.limit, "saturated"))
        if hold:
            elements.append(hold)
        if self.delay:
            elements.append(Delay(force, self.ring, self.delay, hold))
        if hold or self.delay:  # disabled, at once, whatever is still on its way
            elements.append(Product(force, self.places(self.view("enabled"))[[0, 0, 0]], force))
        return elements

    def linearise(self) -> tuple[Matrices, NDArray[np.float64]]:
        """From error and orientation to the forces, without their limit."""
        refuse_delays(sample_time=self.sample_time, delay=self.delay)
        law, x, error = self.law, self.x, self.view("line_of_sight_error")
        A, B, C = law.controller(self.view("orientation")).matrices()
        locked, enabled = bool(self.value("locked")), bool(self.value("enabled"))
        A, B = enabled * A, enabled * locked * B[:, :3]
        A[3:6, :3] *= locked
        outputs, through = np.zeros((4, N_STATES)), np.zeros((4, 6))
        if enabled:
            by_turn = differentiate(lambda at: law.controller(at).matrices(), self.view("orientation"))
            outputs[:3], through[:3, 3:] = C, np.column_stack([turned[2] @ x for turned in by_turn])
        return (A, np.hstack([B, np.zeros((N_STATES, 3))]), outputs, through), A @ x + B @ error

    @refuse_parameters
    def restore(self) -> None:
        """Rebuild what the parameters stand for."""
        self._build()

    def _build(self) -> None:
        values = self.parameters()
        self.law = take_values(DEFAULT, values)
        self.delay, self.sample_time = float(values["delay"]), float(values["sample_time"])  # s
        # Orientation of the gains, rad; forces before their limit and as held, N; parts of a period since a sample.
        self.kept, self.unlimited, self.held, self.sample_clock, self.hold_clock, self.ring = np.split(
            self.memory, [3, 6, 9, 10, 11]
        )
        places = {"orientation": self.view("orientation"), "kept_orientation": self.kept, "states": self.x,
                  "unlimited": self.unlimited, "locked": self.view("locked"), "enabled": self.view("enabled"),
                  "forces": self.y}  # fmt: skip
        limit = float(values["force_limit"]) or np.inf
        self.words = self.law.pack(limit, **{name: int(self.places(view)[0]) for name, view in places.items()})
