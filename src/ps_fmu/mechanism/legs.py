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


@dataclass(frozen=True, eq=False)
class LegMass:
    """The blocks of eq (21) and (A16), each (..., 6, 6), for twists (translation, rotation) in B axes.

    Twice the kinetic energy of the legs is ``vp' alpha vp + 2 vp' alpha_beta vb + vb' beta vb`` with ``vp`` the
    twist of P at its origin and ``vb`` that of B at its origin.
    """

    alpha: Array
    alpha_beta: Array
    beta: Array

    def __getitem__(self, k: int) -> LegMass:
        """At one pose of many."""
        return LegMass(self.alpha[k], self.alpha_beta[k], self.beta[k])


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
    (m_u, m_l), (first_u, first_l), second = leg_moments(legs)
    length = lines.length[..., None]
    turning = second / length**2
    m_alpha = turning - 2.0 * first_u / length  # (A19)
    m_beta = turning - 2.0 * first_l / length  # (A22)
    m_alpha_beta = turning - (first_u + first_l) / length  # (A25)
    at_platform, at_base = lines.platform_points, geometry.base_points  # J_p and J_b of (A5)

    def each_point(mass: Array) -> Array:
        return np.repeat(mass, 3, axis=-2)

    alpha = at_platform.mT @ (each_point(m_u + m_alpha) * at_platform) - J_lp.mT @ (m_alpha * J_lp)  # (A17)
    beta = at_base.T @ (each_point(m_l + m_beta) * at_base) - J_lb.mT @ (m_beta * J_lb)  # (A20)
    alpha_beta = J_lp.mT @ (m_alpha_beta * J_lb) - at_platform.mT @ (each_point(m_alpha_beta) * at_base)  # (A23)
    return LegMass(alpha, alpha_beta, beta)
