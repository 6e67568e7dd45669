"""Flexible modes as bodies on springs and dampers: what a multibody program can be given instead of modal numbers.

A bus mode is known by its *participation*: the linear momentum ``a`` and the angular momentum ``b`` about the origin of
the bus that it has when its velocity is such that its kinetic energy is 1/2 J.  Two bodies have such momenta:

- a point mass that slides along ``n`` through ``r`` at 1/sqrt(m) m/s: ``a = sqrt(m) n``, ``b = r x a``, at right
  angles to ``a``;
- a wheel that turns about ``n`` at 1/sqrt(I) rad/s: ``a = 0``, ``b = sqrt(I) n``.

So the body follows from the mode: for the arrays, 6.8 kg at 4.5 m to either side that slides along x or along z, and a
wheel of 3 kg.m2 that turns about y.  A truss mode is given as a point mass from the start.  Which of its coordinates
the plant uses, how they couple and what the bus or payload keeps: none of that comes in.  The masses are part of the
body that carries them, and are taken from it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ps_fmu.mechanism.modes import BusMode, TrussMode

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Oscillator:
    """A point mass that slides, or a wheel without mass that turns, on a spring and a damper; in axes of its carrier.

    One of ``mass`` and ``inertia`` is zero.
    """

    axis: Array  # (3,), unit vector: of sliding or turning
    position: Array  # (3,) m, of the point mass at rest
    mass: float  # kg, of the point
    inertia: float  # kg.m2, of the wheel about its axis
    frequency: float  # Hz, of the undamped oscillation while the carrier is held
    damping_ratio: float

    @property
    def slides(self) -> bool:
        """Whether it is the point mass."""
        return self.mass > 0.0

    @property
    def stiffness(self) -> float:
        """Of the spring, N/m or N.m/rad."""
        return self._angular_frequency**2 * (self.mass + self.inertia)

    @property
    def damping(self) -> float:
        """Of the damper, N.s/m or N.m.s/rad."""
        return 2.0 * self.damping_ratio * self._angular_frequency * (self.mass + self.inertia)

    @property
    def _angular_frequency(self) -> float:
        return 2.0 * np.pi * self.frequency


def of_bus_mode(mode: BusMode) -> Oscillator:
    """The body that has the momenta of a bus mode; in axes of B, at its origin.

    Raises
    ------
    ValueError: linear and angular momentum are not at right angles: no single body on an axis does that.
    """
    linear, angular = mode.participation_B[:3], mode.participation_B[3:]
    mass = float(linear @ linear)
    if mass == 0.0:
        inertia = float(angular @ angular)
        return Oscillator(angular / np.sqrt(inertia), np.zeros(3), 0.0, inertia, mode.frequency, mode.damping_ratio)
    if abs(linear @ angular) > 1e-9 * np.linalg.norm(linear) * np.linalg.norm(angular):
        raise ValueError(
            f"participation {mode.participation_B}: translations and rotations must be at right angles for a point mass"
        )
    # The foot of the perpendicular from the origin: any point on the line of motion has the same momenta.
    position = np.cross(linear, angular) / mass
    return Oscillator(linear / np.sqrt(mass), position, mass, 0.0, mode.frequency, mode.damping_ratio)


def of_truss_mode(mode: TrussMode) -> Oscillator:
    """The point mass of a truss mode; in axes of P, at its origin."""
    axis = mode.direction_P / np.linalg.norm(mode.direction_P)
    return Oscillator(axis, mode.position_P, mode.mass, 0.0, mode.frequency, mode.damping_ratio)
