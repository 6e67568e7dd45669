"""FeedforwardIsolator: fine forces from measured base acceleration, the practical controller of eq (55)."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from ps_fmu.control.feedforward import count_states
from ps_fmu.control.isolator import Isolator, UnreachableOrientationError
from ps_fmu.interface.ports import make_parameter_ports, refuse_parameters
from ps_fmu.mechanism.parameters import LARGEST_ORDER, load
from ps_fmu.mechanism.quantities import take_values
from ps_fmu.slavekit.author.elements import Clip, Delay, Element, Hold, Sample, Watch, count_steps, ring_size
from ps_fmu.slavekit.author.slave import ModelError, Slave
from ps_fmu.slavekit.author.terminals import Terminal
from ps_fmu.slavekit.author.variables import Port, numbered, vector

DEFAULT = Isolator.from_parameters(load())
#: An orientation this close (rad) is the same: a plant at rest varies it by rounding.
SAME_ORIENTATION = 1e-12
#: Longest delay in communication steps; 0.1 s at 1e-4 s.
LONGEST_DELAY = 1000


class FeedforwardIsolator(Slave):
    """Cancels the base's vibration at the payload; has its own copy of what it must know of the plant."""

    model_description = "Feedforward vibration isolator: voice-coil forces from measured base acceleration"
    physics: ClassVar[type] = Isolator
    n_states: ClassVar[int] = count_states(LARGEST_ORDER)
    n_auxiliary: ClassVar[int] = 6  # acceleration as last sampled, where the controller has a period of its own
    n_memory: ClassVar[int] = 3 + 3 + 1 + 1 + 3 + ring_size(3, LONGEST_DELAY)  # see the views made in _build
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
        *vector(
            "orientation", ("roll", "pitch", "yaw"), "rad", "Nominal orientation of P in B, for the gains",
            causality="input", display_unit="deg", nominal=0.1,
        ),
        Port(
            "enabled", "input", type="Boolean", start=True,
            description="False: no force; the filters go on measuring, so that it can be switched on at any time",
        ),
        # At rest and strictly proper: the force is zero in initialisation mode whatever the inputs are.
        *numbered(
            "fine_force", 3, "N", "Force demanded of a fine actuator, positive extends the leg",
            causality="output", initially_depends_on=(), nominal=0.1,
        ),
        Port("saturated", "output", type="Boolean", description="A force is at force_limit", initially_depends_on=()),
        *make_parameter_ports(DEFAULT),
        Port("force_limit", "parameter", "N", "Largest force of a fine actuator; 0 = no limit", min=0.0),
        Port(
            "delay", "parameter", "s", "Pure delay of the forces, a multiple of the step, at most 1000 steps",
            min=0.0, display_unit="ms",
        ),
        Port(
            "sample_time", "parameter", "s", "Period of a digital controller, a multiple of the step; 0 = every step",
            min=0.0, display_unit="ms",
        ),
        Port(
            "orientation_resolution", "parameter", "rad",
            "Turn after which the gains are renewed; they are also when the orientation has come to rest",
            start=1e-4, min=0.0, display_unit="deg",
        ),
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
        """Build the controller for the present orientation, filters at rest."""
        self.x[:] = self.a[:] = self.memory[:] = 0.0
        self._build()
        self.last_orientation[:] = self.values("orientation")
        self._use(self.last_orientation)

    def output_map(self) -> NDArray[np.float64]:
        """Outputs from [x; u; a] at the same instant."""
        return self._framed(self.controller.output_map(), 0)

    def step_map(self, h: float) -> NDArray[np.float64]:
        """[y; x] at the end of a step from [x; u; a] at its start."""
        return self._framed(self.controller.step_map(h), self.controller.n_states)

    def before_map(self, h: float) -> list[Element]:
        """Renew the gains when the platform has turned or has come to rest; sample the measured acceleration."""
        return self._list_elements(h)[0]

    def after_map(self, h: float) -> list[Element]:
        """Hold and delay the forces."""
        return self._list_elements(h)[1]

    def event(self, t: float, h: float) -> bool:
        """The platform has turned, or the isolator is switched."""
        orientation = self.orientation.copy()
        turn = np.abs(orientation - self.gain_orientation).max()
        at_rest = (orientation == self.last_orientation).all()
        if turn > self.resolution or (at_rest and turn > SAME_ORIENTATION):
            self._use(orientation)
        if self.switch[0] != self.enabled:
            self._use(self.gain_orientation.copy())
        return False

    def limits(self) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
        """The largest force of a fine actuator, either way."""
        limit = float(self.value("force_limit"))
        if not limit:
            return None
        upper = np.array([limit, limit, limit, np.inf])
        return -upper, upper

    @refuse_parameters
    def restore(self) -> None:
        """Rebuild the controller that the restored memory stands for."""
        self._build()
        self._use(self.gain_orientation.copy())

    def _build(self) -> None:
        values = self.parameters()
        self.isolator = take_values(DEFAULT, values)
        self.resolution = max(float(values["orientation_resolution"]), SAME_ORIENTATION)
        self.orientation, self.switch = self.view("orientation"), self.view("enabled")
        self.gain_orientation, self.last_orientation = self.memory[0:3], self.memory[3:6]  # rad
        self.sampled, self.held = self.memory[6:7], self.memory[7:8]  # steps since then
        self.held_force, self.ring = self.memory[8:11], self.memory[11:]  # N
        self.sample_time, self.delay = float(values["sample_time"]), float(values["delay"])  # s
        self.listed: tuple[tuple[float, bool], list[Element], list[Element]] = ((0.0, False), [], [])

    def _list_elements(self, h: float) -> tuple[list[Element], list[Element]]:
        """What a step does before and after the map: the same lists in all steps of a slew."""
        if self.listed[0] != (h, self.enabled):
            force, after = self.y[:3], list[Element]()
            turn = Watch(
                self.orientation, self.gain_orientation, self.resolution, self.last_orientation, SAME_ORIENTATION
            )
            before: list[Element] = [turn]
            if self.sample_time:
                every = count_steps("sample_time", self.sample_time, h)
                before.append(Sample(self.u[:6], self.a, self.sampled, every))
                after.append(Hold(force, self.held_force, self.held, every))
            if self.delay:
                after.append(Delay(force, self.ring, count_steps("delay", self.delay, h, LONGEST_DELAY)))
            if not self.enabled:  # at once, whatever is still on its way
                after.append(Clip(force, 0.0, 0.0))
            self.listed = ((h, self.enabled), before, after)
        return self.listed[1:]

    def _use(self, orientation: NDArray[np.float64]) -> None:
        """The controller for an orientation, from the next step on."""
        try:
            self.controller = self.isolator.controller(orientation)
        except UnreachableOrientationError as error:
            raise ModelError(f"orientation: {error}") from None
        self.gain_orientation[:] = orientation
        self.enabled = bool(self.value("enabled"))
        self.remap()

    def _framed(self, matrix: NDArray[np.float64], n_states: int) -> NDArray[np.float64]:
        """The controller's map in the FMU's shape: room for `saturated`, unused states, sampled inputs."""
        first = self.n_states + (9 if self.sample_time else 0)  # u is acceleration and orientation
        framed = np.zeros((4 + (self.n_states if n_states else 0), first + 6))
        n = self.controller.n_states
        for rows, own in ((slice(0, 3), slice(0, 3)), (slice(4, 4 + n_states), slice(3, 3 + n_states))):
            framed[rows, :n], framed[rows, first : first + 6] = matrix[own, :n], matrix[own, n:]
        if not self.enabled:
            framed[:3] = 0.0
        return framed
