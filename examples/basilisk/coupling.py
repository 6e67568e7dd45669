"""The manipulator as a module of Basilisk: plant and isolator step beside the spacecraft, after it, in its task.

In each step of the task::

    ExtForceTorque   reads the reaction that the last step left
    Spacecraft       integrates from t to t + h with it
    Manipulator      reads the spacecraft's mean accelerations over that step, makes the same step, leaves a reaction

So give them descending priorities in this order.  The hub has to carry the locked mass of the mechanism:
:meth:`Manipulator.load_hub` gives it, and keeps it right while the coarse legs move.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from Basilisk.architecture import messaging, sysModel
from Basilisk.simulation import spacecraft
from fmu import Array, Fmu, name_vector

NANOSECOND = 1e-9  # s
FINE_FORCES = [f"fine_force_{i}" for i in (1, 2, 3)]
# Places of what is read from the plant in each step.
REACTION, LOCKED, MEASURED, RECORDED = slice(0, 6), slice(6, 16), slice(16, 25), slice(25, None)


@dataclass(frozen=True)
class Body:
    """A rigid body in the axes of some frame."""

    mass: float  # kg
    com: Array  # (3,) m
    inertia: Array  # (3, 3) kg.m2, about the centre of mass

    def __add__(self, other: Body) -> Body:
        """Both as one body."""
        mass = self.mass + other.mass
        com = (self.mass * self.com + other.mass * other.com) / mass
        inertia = sum(body.inertia + body.mass * about(body.com - com) for body in (self, other))
        return Body(mass, com, np.asarray(inertia))


@dataclass(frozen=True)
class Mounting:
    """Where the manipulator's base frame B sits on the hub, whose body frame is H."""

    origin_H: Array = field(default_factory=lambda: np.zeros(3))  # m
    rotation_HB: Array = field(default_factory=lambda: np.eye(3))  # maps components in B to components in H

    def move_wrench(self, wrench_B: Array) -> tuple[Array, Array]:
        """Force and torque about the origin of H, in H, of a wrench (6,) in B at its origin."""
        force = self.rotation_HB @ wrench_B[:3]
        return force, self.rotation_HB @ wrench_B[3:] + self.lever_H @ force

    @cached_property
    def lever_H(self) -> Array:
        """(3, 3), m: times a vector gives the cross product ``origin x vector``."""
        x, y, z = self.origin_H
        return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def about(arm: Array) -> Array:
    """Inertia of 1 kg at ``arm`` (3,), m, (3, 3) kg.m2."""
    return np.asarray(arm @ arm * np.eye(3) - np.outer(arm, arm))


class Manipulator(sysModel.SysModel):
    """Plant FMU with ``base = prescribed``, and if there is one the isolator FMU, on the hub of a spacecraft.

    Parameters
    ----------
    plant, isolator: initialised.
    mounting: of the plant's base frame on the hub.
    recorded: names of Reals of the plant; :attr:`rows` gets their values after each step.
    """

    def __init__(
        self, plant: Fmu, isolator: Fmu | None, mounting: Mounting | None = None, recorded: tuple[str, ...] = ()
    ) -> None:
        super().__init__()
        self.ModelTag = "manipulator"
        self.scStateInMsg = messaging.SCStatesMsgReader()
        self.forceOutMsg = messaging.CmdForceBodyMsg()
        self.torqueOutMsg = messaging.CmdTorqueBodyMsg()
        self.times: list[float] = []
        self.rows: list[Array] = []
        self.omega_H: list[list[float]] = []  # rad/s, of the hub
        self.sigma: list[list[float]] = []  # MRP of the hub
        self.velocity_N: list[list[float]] = []  # m/s, of the hub's origin, inertial axes
        self._plant, self._isolator = plant, isolator
        self._mounting = Mounting() if mounting is None else mounting
        self._spacecraft: spacecraft.Spacecraft | None = None
        self._hub: Body | None = None
        motion = "acceleration", "angular_acceleration", "angular_velocity"
        self._motion = plant.find([name for kind in motion for name in name_vector(f"prescribed_{kind}")])
        reaction = name_vector("bus_force") + name_vector("bus_torque")
        inertia = name_vector("locked_inertia", ("xx", "xy", "xz", "yy", "yz", "zz"))
        locked = ["locked_mass", *name_vector("locked_com"), *inertia]
        measured = name_vector("base_acceleration") + name_vector("base_angular_acceleration")
        measured += name_vector("orientation", ("roll", "pitch", "yaw"))
        # All outputs are read in one call: reaction, locked mass, what the isolator measures, what is recorded.
        self._outputs = plant.find([*reaction, *locked, *measured, *recorded])
        self._fine_forces = plant.find(FINE_FORCES)
        if isolator is not None:
            self._estimates, self._commands = isolator.find(measured), isolator.find(FINE_FORCES)
        self._last = 0  # ns
        self._values = plant.get(self._outputs)
        self._force, self._torque = messaging.CmdForceBodyMsgPayload(), messaging.CmdTorqueBodyMsgPayload()

    @property
    def motion(self) -> tuple[list[list[float]], list[list[float]], list[list[float]]]:
        """Of the hub, recorded: MRP, velocity of its origin, angular velocity."""
        return self.sigma, self.velocity_N, self.omega_H

    def load_hub(self, craft: spacecraft.Spacecraft, hub: Body) -> None:
        """Give the spacecraft the mass of its hub and of the locked mechanism; to be kept while the legs move."""
        self._spacecraft, self._hub = craft, hub
        self._write_hub()

    def locked_H(self) -> Body:
        """The mechanism as one rigid body, as it stands, in H."""
        numbers, at = self._values[LOCKED], self._mounting
        mass, com_B = numbers[0], numbers[1:4]
        inertia_B = np.zeros((3, 3))
        inertia_B[np.triu_indices(3)] = numbers[4:]
        inertia_B += np.triu(inertia_B, 1).T
        inertia_B -= mass * about(com_B)
        turn = at.rotation_HB
        return Body(float(mass), at.origin_H + turn @ com_B, turn @ inertia_B @ turn.T)

    def Reset(self, CurrentSimNanos: int) -> None:
        """Basilisk's, at the start."""
        self._last = CurrentSimNanos
        self._write_reaction(np.zeros(6), CurrentSimNanos)

    def UpdateState(self, CurrentSimNanos: int) -> None:
        """Basilisk's, in each step of the task."""
        h = (CurrentSimNanos - self._last) * NANOSECOND
        state = self.scStateInMsg()
        if h > 0.0:
            self._last = CurrentSimNanos
            self._step(state, h)
            locked, self._values = self._values[LOCKED], self._plant.get(self._outputs)
            self._write_reaction(self._values[REACTION], CurrentSimNanos)
            if not np.array_equal(locked, self._values[LOCKED]):
                self._write_hub()
        self.times.append(CurrentSimNanos * NANOSECOND)
        self.rows.append(self._values[RECORDED])
        self.omega_H.append(state.omega_BN_B)
        self.sigma.append(state.sigma_BN)
        self.velocity_N.append(state.v_BN_N)

    def _step(self, state: messaging.SCStatesMsgPayload, h: float) -> None:
        """The step that the spacecraft has made just now."""
        at = self._mounting
        # These two are means over the spacecraft's last step; gravity, which pulls at all alike, is left out.
        acceleration, turning = np.array(state.nonConservativeAccelpntB_B), np.array(state.omegaDot_BN_B)
        omega = np.array(state.omega_BN_B) - 0.5 * h * turning  # rad/s, mean over the step
        acceleration += omega * (omega @ at.origin_H) - at.origin_H * (omega @ omega) - at.lever_H @ turning
        motion_H = np.array([acceleration, turning, omega])
        self._plant.set(self._motion, (motion_H @ at.rotation_HB).ravel())
        if self._isolator is not None:
            self._plant.set(self._fine_forces, self._isolator.get(self._commands))
            self._isolator.set(self._estimates, self._values[MEASURED])
            self._isolator.step(h)
        self._plant.step(h)

    def _write_reaction(self, wrench_B: Array, now: int) -> None:
        force_H, torque_H = self._mounting.move_wrench(wrench_B)
        self._force.forceRequestBody, self._torque.torqueRequestBody = force_H.tolist(), torque_H.tolist()
        self.forceOutMsg.write(self._force, now, self.moduleID)
        self.torqueOutMsg.write(self._torque, now, self.moduleID)

    def _write_hub(self) -> None:
        if self._spacecraft is not None and self._hub is not None:
            whole = self._hub + self.locked_H()
            hub = self._spacecraft.hub
            hub.mHub, hub.r_BcB_B = whole.mass, whole.com.reshape(3, 1).tolist()
            hub.IHubPntBc_B = whole.inertia.tolist()

