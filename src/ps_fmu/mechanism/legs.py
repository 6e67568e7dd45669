"""Kinetic energy of the six legs in terms of platform and base motion (Appendix A).

Each leg is two slender parts on one line, joined by the actuator: the upper part hangs from the platform joint,
the lower part from the base joint, and both turn with the leg.  Written for the telescoping leg, equations
(A17)-(A25) serve all six: for a coarse leg, whose actuator is locked, the velocities of its ends along the leg are
equal, and the expressions become the paper's for one rigid body whose centre of mass and inertia follow from the
two parts at the leg's CURRENT length (the printed, constant values are off by 3-13 % near resonance when a
coarse leg extends).  The same expressions stay right when a coarse rod stretches.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from .geometry import Geometry
from .kinematics import Jacobians, LegLines, find_leg_lines, leg_rows
from .parameters import CoarseLeg
from .quantities import Array

Legs = tuple[CoarseLeg, ...]

_SIGNS = np.array([[1.0, -1.0], [-1.0, 1.0]])


@dataclass(frozen=True, eq=False)
class LegMass:
    """The blocks of eq (21) and (A16), each (..., 6, 6), for twists (translation, rotation) in B axes.

    Twice the kinetic energy of the legs is ``vp' alpha vp + 2 vp' alpha_beta vb + vb' beta vb`` with ``vp`` the
    twist of P at its origin and ``vb`` that of B at its origin.
    """

    alpha: Array
    alpha_beta: Array
    beta: Array
    points: Array
    """(..., 36, 12): velocities of both ends of each leg, platform joint first, from ``[vp, vb]``; eq (A5)."""
    forces: Array
    """(..., 36, 12): generalised forces by accelerations of these points that leave the legs' directions at rest.

    ``points' @ forces`` are the blocks together.
    """

    def __getitem__(self, k: int) -> LegMass:
        """At one pose of many."""
        return LegMass(self.alpha[k], self.alpha_beta[k], self.beta[k], self.points[k], self.forces[k])


@lru_cache(maxsize=8)
def leg_moments(legs: Legs) -> tuple[tuple[Array, Array], tuple[Array, Array], Array]:
    """Mass (kg) and first moment from its own joint (kg.m) of upper and lower parts, second moment of both (kg.m2).

    All (legs, 1), along the leg; read-only.
    """
    upper, lower = (
        np.array([[part.mass, part.com_distance, part.radial_inertia] for part in parts]).T[..., None]
        for parts in ([leg.upper for leg in legs], [leg.lower for leg in legs])
    )
    second = np.asarray(sum(inertia + mass * com**2 for mass, com, inertia in (upper, lower)))
    moments = (upper[0], lower[0]), (upper[0] * upper[1], lower[0] * lower[1]), second
    for array in (upper, lower, *moments[1], second):
        array.setflags(write=False)
    return moments


def leg_mass(legs: Legs, geometry: Geometry, translation_B: Array, rotation_BP: Array) -> LegMass:
    """Mass blocks of the legs at a pose, eqs (A17)-(A25).

    Parameters
    ----------
    legs: the six legs, coarse 1..3 then fine 1..3.
    geometry: their joints.
    translation_B, rotation_BP: the pose, (3,) m and (3, 3).
    """
    lines = find_leg_lines(geometry, translation_B, rotation_BP)
    rows = leg_rows(lines.arms_B, lines.n_B), leg_rows(geometry.base_joints_B, lines.n_B)
    return _leg_mass(legs, geometry, lines, *rows)


def leg_mass_on(legs: Legs, geometry: Geometry, J: Jacobians) -> LegMass:
    """As :func:`leg_mass`, at the pose of Jacobians."""
    return _leg_mass(legs, geometry, J.legs, J.J_lp, J.J_lb)


def _leg_mass(legs: Legs, geometry: Geometry, lines: LegLines, J_lp: Array, J_lb: Array) -> LegMass:
    """The projection at right angles to a leg (A8) is the identity without ``n n'``; ``n' J_p`` is a row of J_lp."""
    _, _, second = leg_moments(legs)
    length, batch = lines.length, lines.length.shape[:-1]
    turning = (second[:, 0] / length**2)[..., None, None]
    # Masses of the two ends, what is at right angles to the leg alone: (A19), (A22), and minus (A25) beside them.
    across = _SIGNS * (turning - _add_moments(legs) / length[..., None, None])
    whole = across + _place_masses(legs)
    points, along = np.zeros((*batch, 6, 2, 3, 12)), np.zeros((*batch, 6, 2, 12))
    points[..., 0, :, :6] = lines.platform_points.reshape(*batch, 6, 3, 6)  # J_p and J_b of (A5)
    points[..., 1, :, 6:] = geometry.base_points.reshape(6, 3, 6)
    along[..., 0, :6], along[..., 1, 6:] = J_lp, J_lb
    forces = (whole @ points.reshape(*batch, 6, 2, 36)).reshape(points.shape)
    forces -= lines.n_B[..., None, :, None] * (across @ along)[..., None, :]
    points, forces = points.reshape(*batch, 36, 12), forces.reshape(*batch, 36, 12)
    blocks = points.mT @ forces
    return LegMass(blocks[..., :6, :6], blocks[..., :6, 6:], blocks[..., 6:, 6:], points, forces)  # (A17), (A23), (A20)


@lru_cache(maxsize=8)
def _add_moments(legs: Legs) -> Array:
    """(legs, 2, 2) kg.m: sums of the first moments of the parts at two ends, the upper one first."""
    _, first, _ = leg_moments(legs)
    upper, lower = (moment[:, 0] for moment in first)
    return np.array([[2.0 * upper, upper + lower], [upper + lower, 2.0 * lower]]).transpose(2, 0, 1)


@lru_cache(maxsize=8)
def _place_masses(legs: Legs) -> Array:
    """(legs, 2, 2) kg: the parts as points at their joints, the upper one first."""
    return np.array([np.diag(masses) for masses in np.hstack(leg_moments(legs)[0])])
