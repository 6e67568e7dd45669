"""A host's rigid hub that carries the manipulator, stepped beside it with forces held over a step."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ps_fmu.mechanism.dynamics import rigid_body_mass
from ps_fmu.mechanism.mounted import LockedMass, gyroscopic_rates
from ps_fmu.mechanism.parameters import Bus

Array = NDArray[np.float64]


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
