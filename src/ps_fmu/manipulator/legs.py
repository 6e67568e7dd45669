"""Kinetic energy of the six legs in terms of platform and base motion (Appendix A).

Each leg is two slender parts on one line, joined by the actuator: the upper part hangs from the platform joint,
the lower part from the base joint, and both turn with the leg.  Written for the telescoping leg, equations
(A17)-(A25) serve all six: for a coarse leg, whose actuator is locked, the velocities of its ends along the leg are
equal, and the expressions become the paper's for one rigid body whose centre of mass and inertia follow from the
two parts at the leg's CURRENT length (the printed, constant values are off by 3-13 % near resonance when a
coarse leg extends).  The same expressions stay right when a coarse rod stretches.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .kinematics import leg_vectors, platform_joints_B
from .parameters import CoarseLeg, Geometry
from .rotations import skew

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class LegMass:
    """The blocks of eq (21) and (A16), each (6, 6), for twists (translation, rotation) in B axes.

    Twice the kinetic energy of the legs is ``vp' alpha vp + 2 vp' alpha_beta vb + vb' beta vb`` with ``vp`` the
    twist of P at its origin and ``vb`` that of B at its origin.
    """

    alpha: Array
    alpha_beta: Array
    beta: Array


def leg_mass(legs: Sequence[CoarseLeg], geometry: Geometry, translation_B: Array, rotation_BP: Array) -> LegMass:
    """Mass blocks of the legs at a pose, eqs (A17)-(A25).

    Parameters
    ----------
    legs: the six legs, coarse 1..3 then fine 1..3.
    geometry: their joints.
    translation_B, rotation_BP: the pose, (3,) m and (3, 3).
    """
    vectors_B = leg_vectors(geometry, translation_B, rotation_BP)
    arms_B = platform_joints_B(geometry, rotation_BP)
    alpha, alpha_beta, beta = np.zeros((6, 6)), np.zeros((6, 6)), np.zeros((6, 6))
    for i, leg in enumerate(legs):
        length = float(np.linalg.norm(vectors_B[i]))
        n_B = vectors_B[i] / length
        across = np.eye(3) - np.outer(n_B, n_B)  # P-perpendicular of (A8)
        at_platform = _point_jacobian(arms_B[i])  # J_p of (A5)
        at_base = _point_jacobian(geometry.base_joints_B[i])  # J_b of (A5)
        up, low = leg.upper, leg.lower
        turning = (
            up.radial_inertia + up.mass * up.com_distance**2 + low.radial_inertia + low.mass * low.com_distance**2
        ) / length**2
        m_alpha = turning - 2.0 * up.mass * up.com_distance / length  # (A19)
        m_beta = turning - 2.0 * low.mass * low.com_distance / length  # (A22)
        m_alpha_beta = turning - (up.mass * up.com_distance + low.mass * low.com_distance) / length  # (A25)
        alpha += at_platform.T @ (up.mass * np.eye(3) + m_alpha * across) @ at_platform  # (A17)
        beta += at_base.T @ (low.mass * np.eye(3) + m_beta * across) @ at_base  # (A20)
        alpha_beta -= m_alpha_beta * at_platform.T @ across @ at_base  # (A23)
    return LegMass(alpha, alpha_beta, beta)


def _point_jacobian(arm_B: Array) -> Array:
    """(3, 6): velocity of a point at ``arm_B`` from the twist of its body, eq (A5)."""
    return np.hstack([np.eye(3), -skew(arm_B)])
