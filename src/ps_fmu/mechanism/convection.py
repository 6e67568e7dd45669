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
from .quantities import Array
from .rotations import cross, skew

#: Numbers in ``v``.
N_SPEEDS = 9
FINE, TURN, COARSE = slice(0, 3), slice(3, 6), slice(6, 9)

_UNIT = np.eye(N_SPEEDS)
_EYE = np.eye(3)


def convective_forces(system: FlexibleSystem, d: Dynamics, speeds: Array) -> Array:
    """``C(v, e_k)``, (n, 9): generalised convective forces of ``v`` together with each unit speed ``e_k``.

    ``c(v) = C(v, v)`` is the result times ``v``; its derivative by ``v`` is twice the result.

    Parameters
    ----------
    system, d: bodies, and their dynamics at the pose, fine legs at their present length.
    speeds: (9,) ``v``: m/s, rad/s, m/s.
    """
    geometry, pose, J, lines = system.manipulator.geometry, d.pose, d.jacobians, d.jacobians.legs
    rates = np.concatenate([_UNIT, speeds[None]])  # the last row is v itself; (10, 9)
    turn = rates[:, TURN]
    legs_rate = np.concatenate([rates[:, COARSE], rates[:, FINE]], axis=1)
    twist = legs_rate @ J.J_pl.T  # of the platform relative to B, (10, 6)
    moving, spinning = twist[:, :3], twist[:, 3:]
    across_turn = skew(turn)  # (10, 3, 3)

    joints_B, n_B, length = lines.arms_B, lines.n_B, lines.length[:, None]  # (6, 3), (6, 3), (6, 1)

    # The platform relative to B: legs that keep their rates turn, and so pull at their joints, eq (6) differentiated.
    joints_moving = (twist @ lines.platform_points.T).reshape(-1, 6, 3)
    across = joints_moving - n_B * _dot(joints_moving, n_B)
    around = joints_B @ _centripetal(spinning)  # (9, 6, 3)
    bias = -_dot(n_B, around) - _dot(across[:-1], across[-1]) / length
    relative = bias[..., 0] @ J.J_pl.T
    turning = relative[:, 3:] + 0.5 * (across_turn[:-1] @ spinning[-1] - spinning[:-1] @ across_turn[-1])
    origin = relative[:, :3] + across_turn[:-1] @ moving[-1] - moving[:-1] @ across_turn[-1]  # 2 w x r', symmetric

    # Accelerations of points on the base and on the platform: legs' joints, centre of mass, masses of the truss.
    payload, bus, R = system.payload, system.bus, pose.rotation_BP
    mass, position_B, direction_B = system.truss_at(R)
    com_B = R @ payload.com_P
    by_turn, whole = _centripetal(turn), turn + spinning  # angular velocity of the platform in inertial space
    on_base = np.concatenate([geometry.base_joints_B, [bus.com_B, pose.translation_B]]) @ by_turn
    origin = origin + on_base[:, 7]
    on_platform = np.concatenate([joints_B, com_B[None], position_B]) @ (_centripetal(whole) - skew(turning))
    on_platform += origin[:, None]
    at_base, at_platform = on_base[:, :6], on_platform[:, :6]

    # Legs, by the accelerations of their ends.
    apart = joints_moving - lines.vectors_B @ across_turn  # velocity of the upper end relative to the lower one
    along = _dot(apart, n_B)
    swing = (apart - n_B * along) / length  # rate of the leg's direction
    swinging = (
        _across(at_platform - at_base, n_B) / length
        - n_B * _dot(swing[:-1], swing[-1])
        - (along[:-1] * swing[-1] + along[-1] * swing[:-1]) / length
    )  # second derivative of the leg's direction
    (m_u, m_l), (first_u, first_l), second = system.leg_moments
    turned = _across(first_l * at_base - first_u * at_platform + second * swinging, n_B) / length
    upper = m_u * at_platform - first_u * swinging + turned
    lower = m_l * at_base + first_l * swinging - turned

    wrench = upper.reshape(N_SPEEDS, -1) @ lines.platform_points
    wrench += _rigid_body(payload.mass * on_platform[:, 6], com_B, R @ payload.inertia_P @ R.T, turning, whole)
    forces = d.platform_rows().T @ wrench.T
    wrench = lower.reshape(N_SPEEDS, -1) @ geometry.base_points
    wrench += _rigid_body(bus.mass * on_base[:, 6], bus.com_B, bus.inertia_B, np.zeros((N_SPEEDS, 3)), turn)
    forces[d.slices["q_b"]] += wrench.T
    forces[d.slices["x_t"]] = mass[:, None] * np.sum(on_platform[:, 7:] * direction_B, axis=-1).T
    return np.asarray(forces)


def _dot(a: Array, b: Array) -> Array:
    """(..., 1) products of vectors."""
    return np.asarray(np.add.reduce(a * b, axis=-1, keepdims=True))


def _across(vectors: Array, n_B: Array) -> Array:
    """(..., 6, 3): what is left of vectors at right angles to the legs."""
    return vectors - n_B * _dot(vectors, n_B)


def _centripetal(turn: Array) -> Array:
    """(9, 3, 3) symmetric form of ``w x (w x r)`` as matrices: each of (9 + 1, 3) angular velocities with the last.

    ``a x (b x r) = (b a' - a'b) r``; matrices are symmetric, so that they may multiply rows of arms from the right.
    """
    products = 0.5 * turn[:-1, :, None] * turn[-1]
    return np.asarray(products + products.mT - 2.0 * np.trace(products, axis1=1, axis2=2)[:, None, None] * _EYE)


def _rigid_body(force: Array, com_B: Array, inertia_B: Array, turning: Array, turn: Array) -> Array:
    """(9, 6) force and torque about the body's origin: ``force`` (9, 3) at the centre of mass, torque for turning.

    ``inertia_B`` is about the centre of mass.
    """
    spin = turn @ inertia_B
    gyroscopic = 0.5 * (cross(turn[:-1], spin[-1]) + cross(turn[-1], spin[:-1]))
    torque = force @ -skew(com_B) + turning @ inertia_B + gyroscopic
    return np.concatenate([force, torque], axis=1)
