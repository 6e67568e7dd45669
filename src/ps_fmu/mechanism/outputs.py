"""What the plant puts out: ``y = C x + D u``, each output with its value and first derivatives at the centre.

Outputs that are not linear in the state have the value at the centre, and change with the distance from it to first
order.  The *nominal* pose of the payload is that of the coarse legs alone, the *present* one has the fine legs too.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .centre import Centre
from .dynamics import Dynamics, Pose
from .kinematics import Jacobians
from .parameters import Optics
from .quantities import Array
from .quaternions import from_rotation_matrix, multiply, small_turns
from .rotations import orientation_rate_map, roll_pitch_yaw, rotation_vector, skew
from .signals import N_INPUTS, N_OUTPUTS, count_states, output_slices, servo_slices

_PLACE = output_slices()
_EYE = np.eye(3)
_ONE = N_INPUTS - 1  # place of the constant in the input


@dataclass(frozen=True, eq=False)
class Nominal:
    """Where the coarse legs alone put the platform; one pose or many."""

    pose: Pose
    jacobians: Jacobians
    rpy: Array  # (..., 3) roll, pitch, yaw, rad


def find_state(centre: Centre, d: Dynamics) -> Array:
    """The state at a centre, as far as outputs depend on it: positions."""
    x = np.zeros((*centre.coarse.shape[:-1], count_states(d.n)))
    t_b, r_b = d.base_places()
    x[..., d.slices["d_f"]], x[..., t_b], x[..., r_b] = centre.fine, centre.position_B, centre.rotation_B
    x[..., servo_slices(d.n)[0]] = centre.coarse
    return x


def make_output_matrices(
    d: Dynamics, nominal: Nominal, centre: Centre, optics: Optics, acceleration: tuple[Array, Array]
) -> tuple[Array, Array]:
    """C and D about k centres, (k, outputs, states) and (k, outputs, inputs).

    Parameters
    ----------
    d: at the present poses of the centres.
    nominal: their nominal poses, those of ``d`` where the fine legs are undeformed.
    centre: stacked, see :meth:`.centre.Centre.stack`.
    acceleration: rows of accelerations of all coordinates from ``x`` and from ``u``; those of the base inertial, in B.
    """
    n, k = d.n, len(centre.coarse)
    C, D = np.zeros((k, N_OUTPUTS, count_states(n))), np.zeros((k, N_OUTPUTS, N_INPUTS))
    t_b, r_b = d.base_places()
    d_f, e_c, s = d.slices["d_f"], d.slices["e_c"], servo_slices(n)[0]
    values: list[tuple[slice, Array]] = []

    def put(name: str, *columns: tuple[slice, Array], value: Array | None = None) -> None:
        """Columns of an output, and its value at the centre where it is not linear."""
        rows = _PLACE[name]
        for where, column in columns:
            C[:, rows, where] = column
        if value is not None:
            values.append((rows, value))

    for name, places in (("base_acceleration", t_b), ("base_angular_acceleration", r_b)):
        C[:, _PLACE[name]], D[:, _PLACE[name]] = acceleration[0][:, places], acceleration[1][:, places]
    put("base_velocity", (slice(n + t_b.start, n + t_b.stop), _EYE))
    put("base_angular_velocity", (slice(n + r_b.start, n + r_b.stop), _EYE))
    put("base_position", (t_b, _EYE))
    put("base_rotation", (r_b, _EYE))
    put("fine_displacement", (d_f, _EYE))
    put("fine_velocity", (slice(n + d_f.start, n + d_f.stop), _EYE))
    put("coarse_displacement", (s, _EYE))

    J, J_n, R = d.jacobians, nominal.jacobians, d.pose.rotation_BP
    rods = d.active[e_c].astype(float)
    R_PB = nominal.pose.rotation_BP.mT
    to_rates = orientation_rate_map(nominal.rpy)  # rates of roll, pitch, yaw from the angular velocity, axes of B
    put("orientation", (s, to_rates @ J_n.J_theta_c), value=nominal.rpy)
    # Vibration turns P from its nominal pose by the rotation vector ``turn``, and the base by ``rotation_B``.
    rpy, turn, to_turn = nominal.rpy, np.zeros((k, 3)), R_PB
    if d.pose is not nominal.pose:
        apart = centre.fine.any(axis=-1, keepdims=True)  # elsewhere no rounding may make it turn
        rpy, turn = roll_pitch_yaw(R), np.where(apart, rotation_vector(R_PB @ R), 0.0)
        to_rates, across = orientation_rate_map(rpy), skew(turn)
        to_turn = (_EYE - 0.5 * across + across @ across / 12.0) @ R_PB
    by_coarse, by_fine = to_rates @ J.J_theta_c, to_rates @ J.J_theta_f
    put("relative_orientation", (s, by_coarse), (d_f, by_fine), (e_c, by_coarse * rods), value=rpy)

    t, theta = d.pose.translation_B, centre.rotation_B
    across_theta, across_t = skew(theta), skew(t)
    by_coarse = to_turn @ J.J_theta_c
    with_base = R_PB @ across_theta @ J_n.J_theta_c
    put(
        "payload_rotation",
        (r_b, R_PB), (d_f, to_turn @ J.J_theta_f), (e_c, by_coarse * rods),
        (s, by_coarse - to_turn @ J_n.J_theta_c + with_base),
        value=_apply(R_PB, theta) + turn,
    )  # fmt: skip
    turned = _EYE + across_theta
    by_coarse = turned @ J.J_tc
    put(
        "payload_position",
        (t_b, _EYE), (r_b, -across_t), (d_f, turned @ J.J_tf), (e_c, by_coarse * rods),
        (s, by_coarse - J_n.J_tc),
        value=centre.position_B + _apply(turned, t) - nominal.pose.translation_B,
    )  # fmt: skip
    put("base_attitude", (r_b, small_turns(centre.attitude)), value=centre.attitude)
    attitude = multiply(centre.attitude, from_rotation_matrix(R))
    to_attitude = small_turns(attitude) @ R.mT
    by_coarse, by_fine = to_attitude @ J.J_theta_c, to_attitude @ J.J_theta_f
    put("payload_attitude", (r_b, to_attitude), (s, by_coarse), (d_f, by_fine), (e_c, by_coarse * rods), value=attitude)
    at_centre = _apply(C, find_state(centre, d))
    for place, value in values:
        D[:, place, _ONE] = value - at_centre[:, place]

    # A small rotation th turns the boresight z by th x z = (th_y, -th_x, 0).
    jitter = _PLACE["payload_rotation"]
    for rows in (C, D):
        x, y = rows[:, jitter.start], rows[:, jitter.start + 1]
        image = _PLACE["los"].start
        rows[:, image], rows[:, image + 1] = optics.focal_length * y, -optics.focal_length * x
        rows[:, _PLACE["line_of_sight"]] = rows[:, jitter.start : jitter.start + 2]
    C[:, _PLACE["line_of_sight"], d.slices["x_t"]] += optics.truss_sensitivity * d.truss_turns_P[:2]
    return C, D


def _apply(matrices: Array, vectors: Array) -> Array:
    """(k, m) products of matrices (k, m, n) with one vector each, (k, n)."""
    return np.asarray((matrices @ vectors[..., None])[..., 0])
