"""A host's rigid hub that carries the manipulator, stepped beside it with forces held over a step."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ps_fmu.mechanism.dynamics import Dynamics, rigid_body_mass
from ps_fmu.mechanism.parameters import Bus
from ps_fmu.mechanism.rotations import skew
from ps_fmu.mechanism.signals import N_OUTPUTS
from ps_fmu.mechanism.stepping import Memory

from .models import Host

Array = NDArray[np.float64]


UPPER = np.triu_indices(3)


@dataclass(frozen=True, eq=False)
class LockedMass:
    """Legs and payload as one rigid body at a pose."""

    mass: float  # kg
    com_B: Array  # (3,) m
    inertia_B: Array  # (3, 3) kg.m2, about the origin of B

    @classmethod
    @np.errstate(over="raise", divide="raise", invalid="raise")
    def of(cls, dynamics: Dynamics) -> LockedMass:
        """Of the payload on the legs of ``dynamics``."""
        M = dynamics.locked
        mass = float(M[0, 0])
        moment = 0.5 * (M[3:, :3] - M[:3, 3:])  # m skew(com)
        return cls(mass, np.array([moment[2, 1], moment[0, 2], moment[1, 0]]) / mass, 0.5 * (M[3:, 3:] + M[3:, 3:].T))

    @property
    def matrix(self) -> Array:
        """(6, 6) mass matrix, B axes at the origin of B."""
        rho = skew(self.com_B)
        return rigid_body_mass(self.mass, self.com_B, self.inertia_B + self.mass * rho @ rho)

    @property
    def numbers(self) -> Array:
        """(10,) mass, centre of mass x, y, z, inertia xx, xy, xz, yy, yz, zz."""
        return np.concatenate([[self.mass], self.com_B, self.inertia_B[UPPER]])


def gyroscopic_rates(mass: Array, turn_B: Array) -> Array:
    """(6, 3): derivative by the angular velocity of the force and torque that a rigid body needs to turn steadily.

    ``[w x (w x S); w x (I w)]`` with first moment S and inertia I about the origin, from its mass matrix (6, 6), at
    ``turn_B`` (3,), rad/s.
    """
    moment = mass[3:, :3]  # skew(S)
    first, inertia = np.array([moment[2, 1], moment[0, 2], moment[1, 0]]), mass[3:, 3:]
    across = skew(turn_B)
    by_force = -across @ moment - skew(np.cross(turn_B, first))
    return np.vstack([by_force, across @ inertia - skew(inertia @ turn_B)])


def cube(mass: float) -> Bus:
    """A homogeneous cube of 150 kg/m3 with the manipulator on the middle of a face."""
    side = (mass / 150.0) ** (1.0 / 3.0)  # m
    return Bus(mass, np.array([0.0, 0.0, -0.5 * side]), mass * side**2 / 6.0 * np.eye(3), ())


def push(t: float) -> Array:
    """Force and torque on the hub at time t (s), (6,), N and N.m: two smooth pulses in a sixth of a second each."""
    return np.array([0.1, 0.05, -0.03, 0.02, 0.01, 0.03]) * (np.sin(6.0 * np.pi * t) ** 2 if t < 1.0 / 3.0 else 0.0)


class Hub:
    """A free rigid body, stepped by the midpoint rule: of second order, as the exchange is.

    With ``turn_B``, its angular velocity at the start (3,), rad/s, it turns freely.  Else its motion is small, and what
    is quadratic in its rates is left out.
    """

    def __init__(self, bus: Bus, turn_B: Array | None = None) -> None:
        self.mass = rigid_body_mass(bus.mass, bus.com_B, bus.inertia_B)
        self.small = turn_B is None
        self.turn_B = np.zeros(3) if turn_B is None else np.array(turn_B)  # rad/s
        self.impulse = np.zeros(6)  # N.s, N.m.s: what its acceleration adds up to, in B

    def step(self, locked: LockedMass, wrench: Array, h: float) -> Array:
        """Steps under ``wrench``, and returns acceleration and rate, means over the step, (9,), as the plant wants."""
        whole = self.mass + locked.matrix
        middle = self.turn_B
        for _ in range(1 if self.small else 3):
            needed = np.zeros(6) if self.small else 0.5 * gyroscopic_rates(whole, middle) @ middle
            acceleration = np.linalg.solve(whole, wrench - needed)
            middle = self.turn_B + 0.5 * h * acceleration[3:]
        self.turn_B = self.turn_B + h * acceleration[3:]
        self.impulse += h * whole @ acceleration
        return np.concatenate([acceleration, middle])


def fly(step: Callable[[Array], Array], locked: Callable[[], LockedMass], hub: Hub, h: float, n: int) -> None:
    """n steps of hub and manipulator, the hub first: ``step(motion)`` is the manipulator's and returns its reaction."""
    reaction = np.zeros(6)
    for k in range(n):
        reaction = step(hub.step(locked(), reaction + push((k + 0.5) * h), h))


class Mounted:
    """The plant FMU at rest on the base of a host, as a Python object.

    ``start``: parameters and inputs at the start.  The bus has no modes.
    """

    REACTION = slice(N_OUTPUTS, N_OUTPUTS + 6)
    MOTION = slice(18, 27)
    """Of the inputs."""

    def __init__(self, **start: float) -> None:
        rigid = {f"bus__mode_{i}__frequency": 0.0 for i in range(1, 7)}
        self.slave = Host("manipulator_plant", base="prescribed", **rigid, **start).run_mode().slave
        self.n = self.slave.step.mechanism.n
        self.memory = Memory.from_buffer(self.slave.memory)

    def step(self, h: float, motion: Array, forces: Array | None = None) -> Array:
        """Outputs after a step with motion (9,) of the base and forces (18,)."""
        self.slave.u[self.MOTION] = motion
        self.slave.u[:18] = 0.0 if forces is None else forces
        self.slave.do_step(self.slave.time, h)
        return self.slave.y.copy()

    @property
    def locked(self) -> LockedMass:
        """As the outputs state it."""
        mass, *numbers = self.slave.y[N_OUTPUTS + 6 :]
        inertia = np.zeros((3, 3))
        inertia[UPPER] = numbers[3:]
        return LockedMass(mass, np.array(numbers[:3]), inertia + np.triu(inertia, 1).T)
