"""Reaction of a free base to a slew, without a simulation.

The system starts at rest and no outer force acts, so total momentum stays zero.  At each pose this gives the twist of
the base for unit rates of the coarse legs; the turn of the base is its integral along the path, and contains no
vibration.  This is the reaction of a free-floating manipulator: Y. Umetani, K. Yoshida, IEEE Trans. Robot. Autom. 5(3),
1989.
"""

from __future__ import annotations

import numpy as np

from .dynamics import Dynamics, Pose
from .inverse_kinematics import inverse_kinematics
from .kinematics import jacobians
from .linear_model import Plant
from .quantities import Array
from .rotations import angular_velocity_map, rotation_from_vector, rotation_matrix, rotation_vector

#: Parts of the path, each with Gauss's two points.  Against 64 parts they leave 1e-8 of the reaction to 8.5 deg of
#: roll, and 4e-8 of that to (3, -4, 8) deg.
_PARTS = 8
_GAUSS = 0.5 - np.sqrt(3.0) / 6.0, 0.5 + np.sqrt(3.0) / 6.0


def find_reaction(plant: Plant, target: Array, *, held: bool) -> Array:
    """Rotation of the base by a slew from roll, pitch, yaw of zero to ``target`` (3,), rad.

    The angles go there along a straight line, as the commander's profile from rest does; how fast makes no difference.

    Parameters
    ----------
    held: False: the fine legs are at rest before and after, and the payload turns with the base.  True: the fine legs
        take up the rotation of the base, so that the payload has its nominal orientation in inertial space.  Momentum
        is then that of the nominal pose, without the elongation of the fine legs (1e-4 of their length).

    Returns
    -------
    (3,) rotation vector, rad, axes of B.

    Raises
    ------
    KinematicsError: the path has a pose that no Jacobian exists for.
    """
    target = np.asarray(target, dtype=float)
    turned = np.eye(3)
    for part in range(_PARTS):
        rates = [_find_turn(plant, (part + node) / _PARTS * target, target, held) for node in _GAUSS]
        turned = turned @ rotation_from_vector(0.5 * (rates[0] + rates[1]) / _PARTS)
    return rotation_vector(turned)


def _find_turn(plant: Plant, orientation: Array, rate: Array, held: bool) -> Array:
    """(3,) angular velocity of the base, rad/s, axes of B, for ``rate`` (3,), rad/s, of roll, pitch and yaw."""
    geometry, R = plant.manipulator.geometry, rotation_matrix(orientation)
    pose = Pose(inverse_kinematics(geometry, orientation).translation_B, R)
    J = jacobians(geometry, pose.translation_B, R)
    d = Dynamics.of(plant.mechanism, pose, J)
    q_b, d_f = d.slices["q_b"], d.slices["d_f"]
    of_base, of_fine = d.M[q_b, q_b], d.M[q_b, d_f]
    relative = d.m_c[q_b] @ np.linalg.solve(J.J_theta_c, angular_velocity_map(orientation) @ rate)
    if not held:
        return np.asarray(np.linalg.solve(of_base, -relative)[3:])
    # Also for the rates of the fine legs: what they turn the platform is the opposite of what the base turns.
    both = np.block([[of_base, of_fine], [np.zeros((3, 3)), np.eye(3), J.J_theta_f]])
    return np.asarray(np.linalg.solve(both, np.append(-relative, np.zeros(3)))[3:6])
