"""Convective inertial forces: what moving bodies need in order to keep their speeds while the mechanism changes shape.

In ``M q'' + c = Q`` all speeds are those of B's own axes: rates of the legs, and the angular velocity of B.  The
acceleration of B's origin is the inertial one, so that its velocity does not come in (Galileo).  ``c`` is quadratic::

    c(v) = C(v, v),    C(v, w) symmetric
    v = (d_f', w_b, s')    rates of the fine legs, angular velocity of B, rates of the coarse legs

It is found as a multibody program finds it: accelerations of all bodies while no speed changes (Newton and Euler),
then the generalised forces that these accelerations need (d'Alembert's principle; J. Wittenburg, Dynamics of Multibody
Systems, 2nd ed., Springer 2008).  A leg is two slender parts on one line, as in :mod:`.legs`; platform and payload are
one body with all of the truss on it.
"""

from __future__ import annotations

import numpy as np

from .dynamics import Dynamics, FlexibleSystem
from .kinematics import leg_vectors, platform_joints_B
from .quantities import Array
from .rotations import cross

#: Numbers in ``v``.
N_SPEEDS = 9
FINE, TURN, COARSE = slice(0, 3), slice(3, 6), slice(6, 9)


def convective_forces(system: FlexibleSystem, d: Dynamics, speeds: Array) -> Array:
    """``C(v, e_k)``, (n, 9): generalised convective forces of ``v`` together with each unit speed ``e_k``.

    ``c(v) = C(v, v)`` is the result times ``v``; its derivative by ``v`` is twice the result.

    Parameters
    ----------
    system, d: bodies, and their dynamics at the pose, fine legs at their present length.
    speeds: (9,) ``v``: m/s, rad/s, m/s.
    """
    geometry, pose, J = system.manipulator.geometry, d.pose, d.jacobians
    unit = np.eye(N_SPEEDS)
    rates = np.vstack([unit, speeds])  # the last row is v itself; (10, 9)
    turn = rates[:, TURN]
    legs_rate = np.concatenate([rates[:, COARSE], rates[:, FINE]], axis=1)
    twist = legs_rate @ J.J_pl.T  # of the platform relative to B, (10, 6)
    moving, spinning = twist[:, :3], twist[:, 3:]

    joints_B = platform_joints_B(geometry, pose.rotation_BP)  # (6, 3)
    legs_B = leg_vectors(geometry, pose.translation_B, pose.rotation_BP)
    length = np.linalg.norm(legs_B, axis=-1)
    n_B = legs_B / length[:, None]

    # The platform relative to B: legs that keep their rates turn, and so pull at their joints, eq (6) differentiated.
    joints_moving = moving[:, None] + cross(spinning[:, None], joints_B)  # (10, 6, 3)
    across = _across(joints_moving, n_B)
    around = _centripetal(spinning, joints_B)  # (9, 6, 3)
    bias = -np.sum(n_B * around, axis=-1) - np.sum(across[:-1] * across[-1], axis=-1) / length
    relative = bias @ J.J_pl.T
    t_B = pose.translation_B
    platform = relative[:, :3] + _coriolis(turn, moving) + _centripetal(turn, t_B[None])[:, 0]
    turning = relative[:, 3:] + 0.5 * (cross(turn[:-1], spinning[-1]) + cross(turn[-1], spinning[:-1]))
    whole = turn + spinning  # angular velocity of the platform in inertial space

    payload, bus = system.payload, system.bus
    R = pose.rotation_BP
    on_platform = _rigid_body(payload.mass, R @ payload.com_P, R @ payload.inertia_P @ R.T, platform, turning, whole)
    still = np.zeros((N_SPEEDS, 3))
    on_base = _rigid_body(bus.mass, bus.com_B, bus.inertia_B, still, still, turn)

    # Legs, by the accelerations of their ends.
    base_joints_B = geometry.base_joints_B
    at_base = _centripetal(turn, base_joints_B)
    at_platform = platform[:, None] + cross(turning[:, None], joints_B) + _centripetal(whole, joints_B)
    apart = joints_moving + cross(turn[:, None], legs_B)  # velocity of the upper end relative to the lower one
    along = np.sum(apart * n_B, axis=-1)
    swing = _across(apart, n_B) / length[:, None]  # rate of the leg's direction
    swinging = (
        _across(at_platform - at_base, n_B) / length[:, None]
        - n_B * np.sum(swing[:-1] * swing[-1], axis=-1)[..., None]
        - (along[:-1, :, None] * swing[-1] + along[-1][:, None] * swing[:-1]) / length[:, None]
    )  # second derivative of the leg's direction
    (m_u, m_l), (first_u, first_l), second = system.leg_moments
    turned = _across(first_l * at_base - first_u * at_platform + second * swinging, n_B) / length[:, None]
    upper = m_u * at_platform - first_u * swinging + turned
    lower = m_l * at_base + first_l * swinging - turned
    on_platform[:, :3] += upper.sum(axis=1)
    on_platform[:, 3:] += cross(joints_B, upper).sum(axis=1)
    on_base[:, :3] += lower.sum(axis=1)
    on_base[:, 3:] += cross(base_joints_B, lower).sum(axis=1)

    forces = d.platform_rows().T @ on_platform.T
    forces[d.slices["q_b"]] += on_base.T
    mass, position_B, direction_B = system.truss_at(R)
    for k, place in enumerate(range(d.slices["x_t"].start, d.slices["x_t"].stop)):
        at_mass = platform + cross(turning, position_B[k]) + _centripetal(whole, position_B[k][None])[:, 0]
        forces[place] = mass[k] * (at_mass @ direction_B[k])
    return np.asarray(forces)


def _across(vectors: Array, n_B: Array) -> Array:
    """(..., 6, 3): what is left of vectors at right angles to the legs."""
    return vectors - n_B * np.sum(vectors * n_B, axis=-1)[..., None]


def _centripetal(turn: Array, arms: Array) -> Array:
    """(9, k, 3) symmetric form of ``w x (w x r)``: each of (9 + 1, 3) angular velocities with the last; arms (k, 3)."""
    with_unit, with_v = cross(turn[:-1, None], arms), cross(turn[-1], arms)
    return np.asarray(0.5 * (cross(turn[:-1, None], with_v) + cross(turn[-1], with_unit)))


def _coriolis(turn: Array, moving: Array) -> Array:
    """(9, 3) symmetric form of ``2 w x r'``."""
    return cross(turn[:-1], moving[-1]) + cross(turn[-1], moving[:-1])


def _rigid_body(mass: float, com_B: Array, inertia_B: Array, origin: Array, turning: Array, turn: Array) -> Array:
    """(9, 6) force and torque about the body's origin that its acceleration needs; inertia about the centre of mass."""
    force = mass * (origin + cross(turning, com_B) + _centripetal(turn, com_B[None])[:, 0])
    spin = turn @ inertia_B
    gyroscopic = 0.5 * (cross(turn[:-1], spin[-1]) + cross(turn[-1], spin[:-1]))
    return np.concatenate([force, cross(com_B, force) + turning @ inertia_B + gyroscopic], axis=1)
