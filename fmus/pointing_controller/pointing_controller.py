"""PointingController: fine forces from the line-of-sight error, beside those of the isolator."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from ps_fmu.control.isolator import UnreachableOrientationError
from ps_fmu.control.pointing import N_STATES, PointingLaw
from ps_fmu.interface.ports import (
    LONGEST_DELAY,
    ORIENTATION,
    SAME_ORIENTATION,
    make_control_ports,
    make_parameter_ports,
    refuse_parameters,
)  # fmt: skip
from ps_fmu.mechanism.parameters import load
from ps_fmu.mechanism.quantities import take_values
from ps_fmu.slavekit.author.elements import Clip, Delay, Element, Excess, Hold, Sample, Watch, ring_size
from ps_fmu.slavekit.author.slave import ModelError, Slave
from ps_fmu.slavekit.author.terminals import Terminal
from ps_fmu.slavekit.author.variables import Port, numbered, vector

DEFAULT = PointingLaw.from_parameters(load())

# Places in x: states of the controller, forces before the limit.  In a: the error as sampled, the excess of the forces.
CONTROLLER, UNLIMITED = slice(0, N_STATES), slice(N_STATES, N_STATES + 3)
SAMPLED, EXCESS = slice(0, 3), slice(3, 6)


class PointingController(Slave):
    """Keeps the payload on its target below the frequency where the isolator takes over."""

    model_description = "Pointing controller: voice-coil forces from the line-of-sight error"
    physics: ClassVar[type] = PointingLaw
    n_states: ClassVar[int] = UNLIMITED.stop
    n_auxiliary: ClassVar[int] = EXCESS.stop
    n_memory: ClassVar[int] = 11 + ring_size(3, LONGEST_DELAY)  # see the views made in _build

    ports: ClassVar[tuple[Port, ...]] = (
        *vector(
            "line_of_sight_error", "xyz", "rad", "Measured small rotation from the payload to its target, in P",
            causality="input", display_unit="urad", nominal=1e-6,
        ),
        *ORIENTATION,
        Port(
            "locked", "input", type="Boolean", start=True,
            description="False: the error is not used, and the forces stay constant",
        ),
        Port(
            "enabled", "input", type="Boolean", start=True,
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
        *make_control_ports(
            turn="Change of orientation after which the gains are computed again, as they are at rest",
            resolution=1e-3,
        ),
    )  # fmt: skip

    terminals: ClassVar[tuple[Terminal, ...]] = (
        Terminal("pointing_error", ("line_of_sight_error", "locked"), "What the line-of-sight sensor measures"),
    )

    @refuse_parameters
    def configure(self) -> None:
        """Build the controller for the present orientation, at rest."""
        self.x[:] = self.a[:] = self.memory[:] = 0.0
        self._build()
        self.last_orientation[:] = self.values("orientation")
        self._use(self.last_orientation)

    def output_map(self) -> NDArray[np.float64]:
        """Outputs at the start: no force."""
        return np.zeros((4, 0))

    def before_map(self, h: float) -> Sequence[Element]:
        """New gains when the platform has turned; the sample; what the limit cut off in the last step."""
        turn = Watch(
            self.view("orientation"), self.gain_orientation, self.resolution, self.last_orientation, SAME_ORIENTATION
        )
        sample = Sample(self.view("line_of_sight_error"), self.a[SAMPLED], self.sample_clock, self.sample_time or h)
        if not self.limit:
            return turn, sample
        return turn, sample, Excess(self.x[UNLIMITED], -self.limit, self.limit, self.a[EXCESS])

    def step_map(self, h: float) -> NDArray[np.float64]:
        """[y; x] at the end of a step from [x; u; a] at its start."""
        step = np.zeros((4 + self.n_states, self.n_states + self.u.size + self.a.size))
        if not self.value("enabled"):
            return step
        Ad, Bd = self.controller.hold(h, frozen=not self.value("locked"))
        force = self.controller.output_map()
        inputs = step[:, self.n_states + self.u.size :]
        states = slice(4, 4 + N_STATES)
        for rows, by in ((slice(0, 3), force), (states, np.eye(N_STATES)), (slice(states.stop, None), force)):
            step[rows, CONTROLLER], inputs[rows] = by @ Ad, by @ Bd
        return step

    def after_map(self, h: float) -> Sequence[Element]:
        """Limit, hold and delay of the forces."""
        force, enabled = self.view("fine_force"), bool(self.value("enabled"))
        elements: list[Element] = []
        if self.limit:
            elements.append(Clip(force, -self.limit, self.limit, "saturated"))
        hold = Hold(force, self.held, self.hold_clock, self.sample_time) if self.sample_time else None
        if hold:
            elements.append(hold)
        if self.delay:
            elements.append(Delay(force, self.ring, self.delay, hold))
        if not enabled:  # at once, whatever is still on its way
            elements.append(Clip(force, 0.0, 0.0))
        return elements

    def event(self, t: float, h: float) -> bool:
        """The platform has turned, lock is won or lost, or the controller is switched."""
        self._use(self.view("orientation"))
        return False

    @refuse_parameters
    def restore(self) -> None:
        """Rebuild the controller that the restored memory stands for."""
        self._build()
        self._use(self.gain_orientation.copy())

    def _build(self) -> None:
        values = self.parameters()
        self.law = take_values(DEFAULT, values)
        self.resolution = max(float(values["orientation_resolution"]), SAME_ORIENTATION)
        self.limit, self.delay, self.sample_time = (
            float(values[name]) for name in ("force_limit", "delay", "sample_time")
        )
        memory = self.memory
        self.gain_orientation, self.last_orientation, self.held = memory[0:3], memory[3:6], memory[6:9]
        self.sample_clock, self.hold_clock, self.ring = memory[9:10], memory[10:11], memory[11:]

    def _use(self, orientation: NDArray[np.float64]) -> None:
        """The controller for an orientation, from the next step on."""
        try:
            self.controller = self.law.controller(orientation)
        except UnreachableOrientationError as error:
            raise ModelError(f"orientation: {error}") from None
        self.gain_orientation[:] = orientation
        self.remap()
