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

from .geometry import Geometry
from .kinematics import leg_vectors, platform_joints_B
from .parameters import CoarseLeg
from .quantities import Array
from .rotations import skew


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
    length = np.linalg.norm(vectors_B, axis=-1)
    n_B = vectors_B / length[:, None]
    across = np.eye(3) - n_B[:, :, None] * n_B[:, None, :]  # P-perpendicular of (A8), (6, 3, 3)
    at_platform = _point_jacobian(platform_joints_B(geometry, rotation_BP))  # J_p of (A5)
    at_base = _point_jacobian(geometry.base_joints_B)  # J_b of (A5)
    (m_u, m_l), (c_u, c_l), (I_u, I_l) = np.array(
        [
            [[part.mass, part.com_distance, part.radial_inertia] for part in (leg.upper, leg.lower)]
            for leg in legs
        ]
    ).T
    turning = (I_u + m_u * c_u**2 + I_l + m_l * c_l**2) / length**2
    m_alpha = turning - 2.0 * m_u * c_u / length  # (A19)
    m_beta = turning - 2.0 * m_l * c_l / length  # (A22)
    m_alpha_beta = turning - (m_u * c_u + m_l * c_l) / length  # (A25)
    to_platform, to_base = at_platform.transpose(0, 2, 1), at_base.transpose(0, 2, 1)
    alpha = to_platform @ (_isotropic(m_u) + m_alpha[:, None, None] * across) @ at_platform  # (A17)
    beta = to_base @ (_isotropic(m_l) + m_beta[:, None, None] * across) @ at_base  # (A20)
    alpha_beta = -to_platform @ (m_alpha_beta[:, None, None] * across) @ at_base  # (A23)
    return LegMass(alpha.sum(axis=0), alpha_beta.sum(axis=0), beta.sum(axis=0))


def _isotropic(mass: Array) -> Array:
    """(n, 3, 3) from (n,): the mass in all directions."""
    return np.asarray(mass[:, None, None] * np.eye(3))


def _point_jacobian(arms_B: Array) -> Array:
    """(n, 3, 6) from (n, 3): velocities of points at ``arms_B`` from the twist of their body, eq (A5)."""
    jacobian = np.zeros((len(arms_B), 3, 6))
    jacobian[:, :, :3] = np.eye(3)
    jacobian[:, :, 3:] = -skew(arms_B)
    return jacobian
