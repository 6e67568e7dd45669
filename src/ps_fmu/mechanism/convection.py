"""Convective inertial forces: what moving bodies need in order to keep their speeds while the mechanism changes shape.

In ``M q'' + c = Q`` all speeds are those of B's own axes: rates of the legs, and the angular velocity of B.  The
acceleration of B's origin is the inertial one, so that its velocity does not come in (Galileo).  ``c`` is quadratic::

    c(v) = C(v, v),    C(v, w) symmetric
    v = (d_f', w_b, s')    rates of the fine legs, angular velocity of B, rates of the coarse legs

It is found as a multibody program finds it: accelerations of all bodies while no speed changes (Newton and Euler),
then the generalised forces that these accelerations need (d'Alembert's principle; J. Wittenburg, Dynamics of Multibody
Systems, 2nd ed., Springer 2008).  A leg is two slender parts on one line, as in :mod:`.dynamics`; platform and payload
are one body with all of the truss on it.
"""

from __future__ import annotations

import numpy as np

from .dynamics import Dynamics, FlexibleSystem
from .quantities import Array
from .rotations import skew

#: Numbers in ``v``.
N_SPEEDS = 9
FINE, TURN, COARSE = slice(0, 3), slice(3, 6), slice(6, 9)

_UNIT = np.eye(N_SPEEDS)
_UNIT_LEGS, _UNIT_TURN = np.hstack([_UNIT[:, COARSE], _UNIT[:, FINE]]), _UNIT[:, TURN]
_TWICE = 2.0 * np.eye(3)


def convective_forces(system: FlexibleSystem, d: Dynamics, speeds: Array) -> Array:
    """``C(v, e_k)``, (..., n, 9): generalised convective forces of ``v`` together with each unit speed ``e_k``.

    ``c(v) = C(v, v)`` is the result times ``v``; its derivative by ``v`` is twice the result.

    Parameters
    ----------
    system, d: bodies, and their dynamics at the pose, fine legs at their present length; or at many poses.
    speeds: (..., 9) ``v`` at each pose: m/s, rad/s, m/s.
    """
    geometry, pose, J, lines = system.manipulator.geometry, d.pose, d.jacobians, d.jacobians.legs
    payload, bus, R = system.payload, system.bus, pose.rotation_BP
    batch = speeds.shape[:-1]
    # Of each unit speed; the last row is of v itself.
    legs_rate, turns = np.empty((*batch, N_SPEEDS + 1, 6)), np.empty((3, *batch, N_SPEEDS + 1, 3))
    legs_rate[..., :-1, :] = _UNIT_LEGS
    legs_rate[..., -1, :3], legs_rate[..., -1, 3:] = speeds[..., COARSE], speeds[..., FINE]
    twist = legs_rate @ J.J_pl.mT  # of the platform relative to B, (..., 10, 6)
    moving, spinning, turn = twist[..., :3], twist[..., 3:], turns[1]
    turn[..., :-1, :], turn[..., -1, :] = _UNIT_TURN, speeds[..., TURN]
    # Angular velocities of the platform relative to B, of B, and of the platform in inertial space.
    turns[0] = spinning
    np.add(spinning, turn, out=turns[2])
    centripetal, across_last = _centripetal(turns), skew(turns[..., -1, :])
    across_spin, across_turn, _ = across_last
    units_turn, units_spin = turn[..., :-1, :], spinning[..., :-1, :]

    # (..., 1, 6, 3), (..., 1, 6, 3), (..., 1, 6, 1)
    joints_B, n_B, length = (each[..., None, :, :] for each in (lines.arms_B, lines.n_B, lines.length[..., None]))

    # The platform relative to B: legs that keep their rates turn, and so pull at their joints, eq (6) differentiated.
    # Joints move along the legs as these get longer, and at right angles to them as they turn.
    along = legs_rate[..., None]
    joints_moving = (twist @ lines.platform_points.mT).reshape(*batch, N_SPEEDS + 1, 6, 3)
    swing = (joints_moving - n_B * along) / length  # rate of the leg's direction, relative to B
    around = joints_B @ centripetal[0]  # (..., 9, 6, 3)
    bias = -_dot(n_B, around) - length * _with_last(swing)
    relative = bias[..., 0] @ J.J_pl.mT
    turning = relative[..., 3:] + 0.5 * (units_turn @ across_spin - units_spin @ across_turn)
    # 2 w x r', symmetric
    origin = relative[..., :3] + units_turn @ skew(moving[..., -1, :]) - moving[..., :-1, :] @ across_turn

    # Accelerations of points on the platform and on the base: legs' joints, centre of mass, masses of the modes.
    mass, position_B, direction_B, moment_B = system.modes_at(R)
    com_B = R @ payload.com_P
    base_points = np.empty((*batch, 1, 8, 3))
    base_points[..., 0, :6, :], base_points[..., 0, 6, :] = geometry.base_joints_B, bus.com_B
    base_points[..., 0, 7, :] = pose.translation_B
    on_base = base_points @ centripetal[1]
    origin += on_base[..., 7, :]
    platform_points = np.concatenate([lines.arms_B, com_B[..., None, :], position_B], axis=-2)[..., None, :, :]
    on_platform = platform_points @ (centripetal[2] - skew(turning))
    on_platform += origin[..., None, :]

    # Legs: accelerations of their ends, and those that turn them while their ends keep their speeds.
    swing -= (turn @ skew(lines.n_B).reshape(*batch, 18, 3).mT).reshape(swing.shape)  # in inertial space
    ends = np.empty((*batch, N_SPEEDS, 6, 2, 3))  # of each leg, the upper one first
    ends[..., 0, :], ends[..., 1, :] = on_platform[..., :6, :], on_base[..., :6, :]
    last_along, last_swing = along[..., -1:, :, :], swing[..., -1:, :, :]
    apart = (along[..., :-1, :, :] * last_swing + last_along * swing[..., :-1, :, :]) / length
    inward = apart + n_B * _with_last(swing)
    _, (first_u, first_l), second = system.leg_moments
    at_ends = np.empty_like(ends)
    pull = (second / length) * apart
    np.subtract(first_u * inward, pull, out=at_ends[..., 0, :])
    np.subtract(pull, first_l * inward, out=at_ends[..., 1, :])
    flat = (*batch, N_SPEEDS, 36)
    wrenches = ends.reshape(flat) @ d.legs.forces + at_ends.reshape(flat) @ d.legs.points

    # Bus and platform, as rigid bodies.
    coms_B, inertias_B, force = np.empty((2, *batch, 3)), np.empty((2, *batch, 3, 3)), np.empty((2, *origin.shape))
    coms_B[0], coms_B[1] = bus.com_B, com_B
    inertias_B[0] = bus.inertia_B
    np.matmul(R @ payload.inertia_P, R.mT, out=inertias_B[1])
    np.multiply(bus.mass, on_base[..., 6, :], out=force[0])
    np.multiply(payload.mass, on_platform[..., 6, :], out=force[1])
    torque = _find_torques(force, coms_B, inertias_B, turns[1:])
    torque[1] += turning @ inertias_B[1]
    wrenches[..., :3] += force[1]
    wrenches[..., 3:6] += torque[1]
    wrenches[..., 6:9] += force[0]
    wrenches[..., 9:] += torque[0]
    forces = d.platform_rows().mT @ wrenches[..., :6].mT
    forces[..., d.slices["q_b"], :] += wrenches[..., 6:].mT
    along_modes = np.vecdot(on_platform[..., 7:, :], direction_B[..., None, :, :])
    along_modes += turning @ moment_B.mT
    forces[..., d.slices["x_t"], :] = mass[:, None] * along_modes.mT
    return np.asarray(forces)


def _dot(a: Array, b: Array) -> Array:
    """(..., 1) products of vectors; for the legs of three poses half the time of a sum over so short an axis."""
    return np.asarray(np.vecdot(a, b)[..., None])


def _with_last(vectors: Array) -> Array:
    """(..., 9, 6, 1) products of the vectors of each unit speed with those of the last row, ``v``."""
    return _dot(vectors[..., :-1, :, :], vectors[..., -1:, :, :])


def _centripetal(turn: Array) -> Array:
    """(..., 9, 3, 3) symmetric form of ``w x (w x r)`` as matrices: each of (..., 9 + 1, 3) velocities with the last.

    ``a x (b x r) = (b a' - a'b) r``; matrices are symmetric, so that they may multiply rows of arms from the right.
    """
    half, last = 0.5 * turn[..., :-1, :], turn[..., -1:, :]
    products = half[..., None] * last[..., None, :]
    return np.asarray(products + products.mT - _dot(half, last)[..., None] * _TWICE)


def _find_torques(force: Array, com_B: Array, inertia_B: Array, turn: Array) -> Array:
    """(..., 9, 3) torques about the origins of rigid bodies, whose angular velocities do not change.

    ``force`` acts at the centre of mass, ``inertia_B`` is about it.
    """
    spin = turn @ inertia_B
    torque = 0.5 * (turn[..., :-1, :] @ skew(spin[..., -1, :]) - spin[..., :-1, :] @ skew(turn[..., -1, :]))
    torque -= force @ skew(com_B)
    return np.asarray(torque)
