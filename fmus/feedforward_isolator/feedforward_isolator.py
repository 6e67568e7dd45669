"""FeedforwardIsolator: fine forces from measured base acceleration, the practical controller of eq (55)."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from ps_fmu.control.feedforward import count_states
from ps_fmu.control.isolator import HALF_WAY, Isolator, Turn, UnreachableOrientationError
from ps_fmu.interface.ports import (
    LONGEST_DELAY,
    ORIENTATION,
    SAME_ORIENTATION,
    make_control_ports,
    make_parameter_ports,
    refuse_parameters,
)  # fmt: skip
from ps_fmu.mechanism.parameters import LARGEST_ORDER, load
from ps_fmu.mechanism.quantities import take_values
from ps_fmu.slavekit.author.elements import (
    Clip,
    Delay,
    Element,
    Hold,
    Linear,
    Product,
    Sample,
    Watch,
    ring_size,
)
from ps_fmu.slavekit.author.slave import ModelError, Slave
from ps_fmu.slavekit.author.terminals import Terminal
from ps_fmu.slavekit.author.variables import Port, numbered, vector

DEFAULT = Isolator.from_parameters(load())


class FeedforwardIsolator(Slave):
    """Cancels the base's vibration at the payload; has its own copy of what it must know of the plant."""

    model_description = "Feedforward vibration isolator: voice-coil forces from measured base acceleration"
    physics: ClassVar[type] = Isolator
    n_states: ClassVar[int] = count_states(LARGEST_ORDER)
    # Acceleration as last sampled, where the controller has a period of its own; what only a turning controller takes.
    n_auxiliary: ClassVar[int] = 6 + 18
    n_memory: ClassVar[int] = 3 + 3 + 3 + 4 + 4 + 1 + 1 + 3 + ring_size(3, LONGEST_DELAY)  # see the views in _build
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
            "enabled", "input", type="Boolean", start=True,
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
        *make_control_ports(
            turn="Change of orientation whose effect on the gains is neglected; at rest the gains are exact",
            resolution=1e-4,
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
        self.half_way[:] = HALF_WAY
        self.last_orientation[:] = self.values("orientation")
        self._use(Turn(self.last_orientation, self.last_orientation))

    def output_map(self) -> NDArray[np.float64]:
        """Outputs from [x; u; a] at the same instant."""
        return self._framed(self.controller.output_map(), False)

    def step_map(self, h: float) -> NDArray[np.float64]:
        """[y; x] at the end of a step from [x; u; a] at its start."""
        controller = self.controller if self.turning is None else self.turning
        return self._framed(controller.step_map(h), True)

    def before_map(self, h: float) -> list[Element]:
        """Renew the gains when the platform leaves its way or has come to rest; sample the measured acceleration."""
        return self._list_elements(h)[0]

    def after_map(self, h: float) -> list[Element]:
        """Hold and delay the forces."""
        return self._list_elements(h)[1]

    def event(self, t: float, h: float) -> bool:
        """The platform has turned, or the isolator is switched."""
        orientation, turn = self.orientation.copy(), self._read_turn()
        if (orientation == self.last_orientation).all():
            if np.abs(orientation - turn.start).max() > SAME_ORIENTATION:
                self._use(Turn(orientation, orientation))
        elif turn.is_left(orientation, self.resolution):
            self._use(Turn.ahead(orientation, self.last_orientation, self.resolution))
        if self.switch[0] != self.enabled:
            self._use(self._read_turn())
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
        self._use(self._read_turn())

    def _build(self) -> None:
        values = self.parameters()
        self.isolator = take_values(DEFAULT, values)
        self.resolution = max(float(values["orientation_resolution"]), SAME_ORIENTATION)
        self.orientation, self.switch = self.view("orientation"), self.view("enabled")
        # Way that the gains are linear on, orientation after the last step, rad; progress on the way, and its middle.
        self.gain_orientation, self.gain_end, self.last_orientation = (self.memory[k : k + 3] for k in (0, 3, 6))
        self.progress, self.half_way = self.memory[9:13], self.memory[13:17]
        self.sampled, self.held = self.memory[17:18], self.memory[18:19]  # parts of a period since then
        self.held_force, self.ring = self.memory[19:22], self.memory[22:]  # N
        self.sample_time, self.delay = float(values["sample_time"]), float(values["delay"])  # s
        self.listed: tuple[tuple[float, bool], list[Element], list[Element]] = ((0.0, False), [], [])

    def _list_elements(self, h: float) -> tuple[list[Element], list[Element]]:
        """What a step does before and after the map: the same lists until the gains change."""
        if self.listed[0] != (h, self.enabled):
            force, after = self.y[:3], list[Element]()
            rests, acceleration = (self.last_orientation, SAME_ORIENTATION), self.places(self.u[:6])
            before: list[Element] = []
            hold = Hold(force, self.held_force, self.held, self.sample_time) if self.sample_time else None
            if hold:
                before.append(Sample(self.u[:6], self.a[:6], self.sampled, self.sample_time))
                after.append(hold)
                acceleration = self.places(self.a[:6])
            if self.turning is None:
                before.append(Watch(self.orientation, self.gain_orientation, self.resolution, *rests))
            else:
                ends = np.concatenate([self.places(self.orientation), self.places(self.gain_orientation)])
                changing = np.concatenate([self.places(self.x[:12]), acceleration])
                before += [
                    Linear(ends, self.turn.progress, self.progress),
                    Watch(self.progress, self.half_way, self.turn.allowed(self.resolution)),
                    Watch(self.orientation, self.gain_orientation, np.inf, *rests),
                    Product(self.places(self.progress)[[0] * 18], changing, self.a[6:]),
                ]
            if self.delay:
                after.append(Delay(force, self.ring, self.delay, hold))
            if not self.enabled:  # at once, whatever is still on its way
                after.append(Clip(force, 0.0, 0.0))
            self.listed = ((h, self.enabled), before, after)
        return self.listed[1:]

    def _use(self, turn: Turn) -> None:
        """The controller for a way, or for an orientation, from the next step on."""
        try:
            self.turning = self.isolator.turning_controller(turn) if turn.length else None
            self.controller = self.turning.first if self.turning else self.isolator.controller(turn.start)
        except UnreachableOrientationError as error:
            raise ModelError(f"orientation: {error}") from None
        self.turn = turn if self.turning else Turn(turn.start, turn.start)
        self.gain_orientation[:], self.gain_end[:] = self.turn.start, self.turn.end
        self.enabled = bool(self.value("enabled"))
        self.listed = ((0.0, False), [], [])
        self.remap()

    def _read_turn(self) -> Turn:
        return Turn(self.gain_orientation.copy(), self.gain_end.copy())

    def _framed(self, matrix: NDArray[np.float64], with_states: bool) -> NDArray[np.float64]:
        """The controller's map in the FMU's shape: room for `saturated`, unused states, sampled inputs."""
        n, acceleration = self.controller.n_states, self.n_states + (9 if self.sample_time else 0)
        # In the FMU, u is acceleration and orientation, and a begins with the acceleration as sampled.
        columns = np.r_[0:n, acceleration : acceleration + 6, self.n_states + 15 : self.n_states + 33]
        framed = np.zeros((4 + (self.n_states if with_states else 0), columns[matrix.shape[1] - 1] + 1))
        rows = np.r_[0:3, 4 : 4 + len(matrix) - 3]
        framed[np.ix_(rows, columns[: matrix.shape[1]])] = matrix
        if not self.enabled:
            framed[:3] = 0.0
        return framed
