"""Matrices of the plant about centres: ``x' = A x + B u``, ``y = C x + D u``; see :mod:`.linear_model` for x and u.

Outputs that are not linear in the state have the value at the centre, and change with the distance from it to first
order.  The *nominal* pose of the payload is that of the coarse legs alone, the *present* one has the fine legs too.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from .centre import Centre
from .convection import COARSE, FINE, TURN
from .dynamics import Dynamics, Pose
from .parameters import CoarseServo, Optics
from .quantities import Array
from .rotations import (
    from_rotation_matrix,
    multiply,
    orientation_rate_map,
    roll_pitch_yaw,
    rotation_vector,
    skew,
    small_turns,
)
from .signals import ADDED, N_INPUTS, N_OUTPUTS, PAYLOAD, RATE, count_states, output_slices, servo_slices

_ONE = slice(N_INPUTS - 1, N_INPUTS)  # place of the constant in the input
_EYE = np.eye(3)
_PLACE = output_slices()


def make_rate_matrices(
    d: Dynamics, centre: Centre, convection: Array | None, servo: CoarseServo
) -> tuple[Array, Array]:
    """A and B about k centres, (k, states, states) and (k, states, inputs), where B does not turn yet.

    So accelerations of the base are inertial ones; :func:`turn_base` is what is left to do.

    Parameters
    ----------
    d: at the poses of the centres.
    centre: stacked, see :meth:`.centre.Centre.stack`.
    convection: (k, n, 9) of :func:`.convection.convective_forces`; None: all centres are at rest.
    """
    n, k, n_states = d.n, len(d.M), count_states(d.n)
    A, B = np.empty((k, n_states, n_states)), np.zeros((k, n_states, N_INPUTS))
    dq, r = slice(n, 2 * n), servo_slices(n)[2]
    follow, A[:] = _make_fixed_rates(d.active.tobytes(), servo)
    B[:, r, RATE] = _EYE

    # M q'' = - K q - C q' + [f_f + f_a; w_b; 0] + (platform's motion)' w_p - m_c s'' - c
    mobility = _find_mobility(d)
    A[:, dq, :n] = -mobility @ d.K
    A[:, dq, dq] = -mobility @ d.C
    A[:, dq, 2 * n :] = -(mobility @ d.m_c) @ follow
    B[:, dq, 0:9] = mobility[..., d.slices["d_f"].start : d.slices["q_b"].stop]  # they stand side by side
    B[:, dq, ADDED] = B[:, dq, 0:3]
    to_platform, R_BP = mobility @ d.platform_rows().mT, d.pose.rotation_BP
    of_payload = PAYLOAD.start + 3
    B[:, dq, PAYLOAD.start : of_payload] = to_platform[..., :3] @ R_BP
    B[:, dq, of_payload : PAYLOAD.stop] = to_platform[..., 3:] @ R_BP
    if convection is not None:
        _add_convection(A, B, d, centre, mobility @ convection)
    return A, B


@lru_cache(maxsize=8)
def _make_fixed_rates(active: bytes, servo: CoarseServo) -> tuple[Array, Array]:
    """(3, 9): accelerations of the coarse actuators from ``[s, s', r]``; (states, states): what all poses have of A.

    ``active``: of :class:`.dynamics.Dynamics`.
    """
    on = np.flatnonzero(np.frombuffer(active, dtype=bool))
    n = len(active)
    s, ds, _ = servo_slices(n)
    omega = 2.0 * np.pi * servo.frequency
    follow = np.hstack([-(omega**2) * _EYE, -2.0 * servo.damping_ratio * omega * _EYE, omega**2 * _EYE])
    A = np.zeros((count_states(n), count_states(n)))
    A[on, n + on] = 1.0  # q' = dq, for what can move
    A[s, ds] = _EYE
    A[ds, 2 * n :] = follow
    for shared in (follow, A):
        shared.setflags(write=False)
    return follow, A


def _find_mobility(d: Dynamics) -> Array:
    """(k, n, n) inverse of the masses; zero for what cannot move."""
    if d.active.all():
        return np.asarray(np.linalg.inv(d.M))
    on = np.flatnonzero(d.active)
    mobility, pick = np.zeros_like(d.M), (slice(None), on[:, None], on)
    mobility[pick] = np.linalg.inv(d.M[pick])
    return mobility


def _add_convection(A: Array, B: Array, d: Dynamics, centre: Centre, C: Array) -> None:
    """Accelerations ``- c(v)`` about v0: ``- 2 C(v0, v) + C(v0, v0)``; C (k, n, 9): of them, not of forces."""
    n, (_, r_b) = d.n, d.base_places()
    twice = 2.0 * C
    legs = d.slices["d_f"], d.slices["e_c"]
    for places, speeds in ((legs[0], FINE), (r_b, TURN), (legs[1], COARSE)):
        A[:, n : 2 * n, n + places.start : n + places.stop] -= twice[..., speeds]
    A[:, n : 2 * n, servo_slices(n)[1]] -= twice[..., COARSE]
    B[:, n : 2 * n, _ONE] += C @ centre.speeds[..., None]


def turn_base(A: Array, B: Array, d: Dynamics, centre: Centre) -> None:
    """Have B turn in A and B: ``v' = a - w x v`` and ``p' = v - w x p`` to first order about the centres."""
    n, (t_b, r_b) = d.n, d.base_places()
    about = slice(n + r_b.start, n + r_b.stop)
    across_turn = skew(centre.speeds[..., TURN])
    for shift, moving in ((0, centre.position_B), (n, centre.velocity_B)):
        rows = slice(shift + t_b.start, shift + t_b.stop)
        A[:, rows, rows] -= across_turn
        A[:, rows, about] += skew(moving)
        B[:, rows, _ONE] += across_turn @ moving[..., None]


class Orientation(NamedTuple):
    """Of the platform relative to B; one pose or many."""

    rpy: Array
    """(..., 3) roll, pitch, yaw, rad."""
    to_rates: Array
    """(..., 3, 3) rates of these from the angular velocity, axes of B."""

    @classmethod
    def of(cls, rotation_BP: Array) -> Orientation:
        """Of rotation matrices (..., 3, 3)."""
        rpy = roll_pitch_yaw(rotation_BP)
        return cls(rpy, orientation_rate_map(rpy))

    def take(self, k: slice | list[int]) -> Orientation:
        """At some of many poses."""
        return Orientation(self.rpy[k], self.to_rates[k])


class Nominal(NamedTuple):
    """Where the coarse legs alone put the platform, at many poses."""

    pose: Pose
    J_pc: Array
    """(k, 6, 3), see :attr:`.kinematics.Jacobians.J_pc`."""
    orientation: Orientation


def find_state(centre: Centre, d: Dynamics) -> Array:
    """The state at a centre, as far as outputs depend on it: positions."""
    x = np.zeros((*centre.coarse.shape[:-1], count_states(d.n)))
    t_b, r_b = d.base_places()
    x[..., d.slices["d_f"]], x[..., t_b], x[..., r_b] = centre.fine, centre.position_B, centre.rotation_B
    x[..., servo_slices(d.n)[0]] = centre.coarse
    return x


def make_output_matrices(
    d: Dynamics,
    orientation: Orientation,
    nominal: Nominal,
    centre: Centre,
    optics: Optics,
    turns_P: Array,
    acceleration: tuple[Array, Array],
) -> tuple[Array, Array]:
    """C and D about k centres, (k, outputs, states) and (k, outputs, inputs).

    Parameters
    ----------
    d, orientation: at the present poses of the centres.
    nominal: their nominal poses, those of ``d`` where the fine legs are undeformed.
    centre: stacked, see :meth:`.centre.Centre.stack`.
    turns_P: (2, n) of the line of sight by the modes of the payload, see :meth:`.dynamics.FlexibleSystem.find_turns`.
    acceleration: rows of accelerations of all coordinates from ``x`` and from ``u``; those of the base inertial, in B.
    """
    n, k = d.n, len(centre.coarse)
    C, D = np.empty((k, N_OUTPUTS, count_states(n))), np.zeros((k, N_OUTPUTS, N_INPUTS))
    t_b, r_b = d.base_places()
    d_f, e_c, s = d.slices["d_f"], d.slices["e_c"], servo_slices(n)[0]
    C[:] = _list_states(n, d_f.start, t_b.start)
    values: list[tuple[slice, Array]] = []

    def put(name: str, *columns: tuple[slice, Array], value: Array) -> None:
        """Columns of an output that is not linear, and its value at the centre."""
        rows = C[:, _PLACE[name]]
        for where, column in columns:
            rows[..., where] = column
        values.append((_PLACE[name], value))

    for name, places in (("base_acceleration", t_b), ("base_angular_acceleration", r_b)):
        C[:, _PLACE[name]], D[:, _PLACE[name]] = acceleration[0][:, places], acceleration[1][:, places]

    J, R = d.jacobians, d.pose.rotation_BP
    J_theta_c, J_theta_f, J_tc, J_tf = J.J_theta_c, J.J_theta_f, J.J_pc[:, :3], J.J_pf[:, :3]
    nominal_tc, nominal_theta_c = nominal.J_pc[:, :3], nominal.J_pc[:, 3:]
    rods = d.active[e_c].astype(float)
    R_PB = nominal.pose.rotation_BP.mT
    put("orientation", (s, nominal.orientation.to_rates @ nominal_theta_c), value=nominal.orientation.rpy)
    # Vibration turns P from its nominal pose by the rotation vector ``turn``, and the base by ``rotation_B``.
    turn, to_turn = np.zeros((k, 3)), R_PB
    if d.pose is not nominal.pose:
        apart = centre.fine.any(axis=-1, keepdims=True)  # elsewhere no rounding may make it turn
        turn = np.where(apart, rotation_vector(R_PB @ R), 0.0)
        across = skew(turn)
        to_turn = (_EYE - 0.5 * across + across @ across / 12.0) @ R_PB
    by_coarse, by_fine = orientation.to_rates @ J_theta_c, orientation.to_rates @ J_theta_f
    put("relative_orientation", (s, by_coarse), (d_f, by_fine), (e_c, by_coarse * rods), value=orientation.rpy)

    t, theta = d.pose.translation_B, centre.rotation_B
    across_theta, across_t = skew(theta), skew(t)
    by_coarse = to_turn @ J_theta_c
    with_base = R_PB @ across_theta @ nominal_theta_c
    put(
        "payload_rotation",
        (r_b, R_PB), (d_f, to_turn @ J_theta_f), (e_c, by_coarse * rods),
        (s, by_coarse - to_turn @ nominal_theta_c + with_base),
        value=_apply(R_PB, theta) + turn,
    )  # fmt: skip
    turned = _EYE + across_theta
    by_coarse = turned @ J_tc
    put(
        "payload_position",
        (t_b, _EYE), (r_b, -across_t), (d_f, turned @ J_tf), (e_c, by_coarse * rods),
        (s, by_coarse - nominal_tc),
        value=centre.position_B + _apply(turned, t) - nominal.pose.translation_B,
    )  # fmt: skip
    put("base_attitude", (r_b, small_turns(centre.attitude)), value=centre.attitude)
    attitude = multiply(centre.attitude, from_rotation_matrix(R))
    to_attitude = small_turns(attitude) @ R.mT
    by_coarse, by_fine = to_attitude @ J_theta_c, to_attitude @ J_theta_f
    put("payload_attitude", (r_b, to_attitude), (s, by_coarse), (d_f, by_fine), (e_c, by_coarse * rods), value=attitude)
    at_centre = _apply(C, find_state(centre, d))
    for place, value in values:
        np.subtract(value, at_centre[:, place], out=D[:, place, _ONE.start])

    # A small rotation th turns the boresight z by th x z = (th_y, -th_x, 0).
    jitter, image = _PLACE["payload_rotation"].start, _PLACE["los"].start
    for rows in (C, D):
        np.multiply(rows[:, jitter + 1], optics.focal_length, out=rows[:, image])
        np.multiply(rows[:, jitter], -optics.focal_length, out=rows[:, image + 1])
        rows[:, _PLACE["line_of_sight"]] = rows[:, jitter : jitter + 2]
    C[:, _PLACE["line_of_sight"], d.slices["x_t"]] += turns_P
    return C, D


@lru_cache(maxsize=8)
def _list_states(n: int, fine: int, base: int) -> Array:
    """(outputs, states) of the outputs that are states, for n coordinates; first places of fine legs and base."""
    C = np.zeros((N_OUTPUTS, count_states(n)))
    for name, first in (
        ("base_velocity", n + base), ("base_angular_velocity", n + base + 3),
        ("base_position", base), ("base_rotation", base + 3),
        ("fine_displacement", fine), ("fine_velocity", n + fine), ("coarse_displacement", servo_slices(n)[0].start),
    ):  # fmt: skip
        C[_PLACE[name], first : first + 3] = _EYE
    C.setflags(write=False)
    return C


def _apply(matrices: Array, vectors: Array) -> Array:
    """(k, m) products of matrices (k, m, n) with one vector each, (k, n)."""
    return np.asarray((matrices @ vectors[..., None])[..., 0])
