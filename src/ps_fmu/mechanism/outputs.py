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
_ONE = N_INPUTS - 1  # place of the constant in the input


@dataclass(frozen=True, eq=False)
class Nominal:
    """Where the coarse legs alone put the platform."""

    pose: Pose
    jacobians: Jacobians
    rpy: Array  # (3,) roll, pitch, yaw, rad


def find_state(centre: Centre, d: Dynamics) -> Array:
    """The state at a centre, as far as outputs depend on it: positions."""
    x = np.zeros(count_states(d.n))
    t_b, r_b = d.base_places()
    x[d.slices["d_f"]], x[t_b], x[r_b] = centre.fine, centre.position_B, centre.rotation_B
    x[servo_slices(d.n)[0]] = centre.coarse
    return x


def make_output_matrices(
    d: Dynamics, nominal: Nominal, centre: Centre, optics: Optics, acceleration: tuple[Array, Array]
) -> tuple[Array, Array]:
    """C and D.

    Parameters
    ----------
    d: at the present pose of the centre.
    acceleration: rows of accelerations of all coordinates from ``x`` and from ``u``; those of the base inertial, in B.
    """
    n = d.n
    C, D = np.zeros((N_OUTPUTS, count_states(n))), np.zeros((N_OUTPUTS, N_INPUTS))
    t_b, r_b = d.base_places()
    d_f, e_c, s = d.slices["d_f"], d.slices["e_c"], servo_slices(n)[0]
    at_centre = find_state(centre, d)

    def put(name: str, *columns: tuple[slice, Array], value: Array | None = None) -> None:
        """Columns of an output, and its value at the centre where it is not linear."""
        rows = _PLACE[name]
        for where, column in columns:
            C[rows, where] = column
        if value is not None:
            D[rows, _ONE] = value - C[rows] @ at_centre

    one = np.eye(3)
    for name, places in (("base_acceleration", t_b), ("base_angular_acceleration", r_b)):
        C[_PLACE[name]], D[_PLACE[name]] = acceleration[0][places], acceleration[1][places]
    put("base_velocity", (slice(n + t_b.start, n + t_b.stop), one))
    put("base_angular_velocity", (slice(n + r_b.start, n + r_b.stop), one))
    put("base_position", (t_b, one))
    put("base_rotation", (r_b, one))
    put("fine_displacement", (d_f, one))
    put("fine_velocity", (slice(n + d_f.start, n + d_f.stop), one))
    put("coarse_displacement", (s, one))

    J, J_n = d.jacobians, nominal.jacobians
    rods = d.active[e_c].astype(float)
    R_PB = nominal.pose.rotation_BP.T
    to_rates = orientation_rate_map(nominal.rpy)  # rates of roll, pitch, yaw from the angular velocity, axes of B
    put("orientation", (s, to_rates @ J_n.J_theta_c), value=nominal.rpy)
    rpy = roll_pitch_yaw(d.pose.rotation_BP)
    to_rates = orientation_rate_map(rpy)
    by_coarse, by_fine = to_rates @ J.J_theta_c, to_rates @ J.J_theta_f
    put("relative_orientation", (s, by_coarse), (d_f, by_fine), (e_c, by_coarse * rods), value=rpy)

    # Vibration turns P from its nominal pose by the rotation vector ``turn``, and the base by ``rotation_B``.
    t, theta = d.pose.translation_B, centre.rotation_B
    turn = rotation_vector(R_PB @ d.pose.rotation_BP)
    across = skew(turn)
    to_turn = (one - 0.5 * across + across @ across / 12.0) @ R_PB
    with_base = R_PB @ skew(theta) @ J_n.J_theta_c
    put(
        "payload_rotation",
        (r_b, R_PB), (d_f, to_turn @ J.J_theta_f), (e_c, to_turn @ J.J_theta_c * rods),
        (s, to_turn @ (J.J_theta_c - J_n.J_theta_c) + with_base),
        value=R_PB @ theta + turn,
    )  # fmt: skip
    turned = one + skew(theta)
    put(
        "payload_position",
        (t_b, one), (r_b, -skew(t)), (d_f, turned @ J.J_tf), (e_c, turned @ J.J_tc * rods),
        (s, turned @ J.J_tc - J_n.J_tc),
        value=centre.position_B + turned @ t - nominal.pose.translation_B,
    )  # fmt: skip
    # A small rotation th turns the boresight z by th x z = (th_y, -th_x, 0).
    jitter = _PLACE["payload_rotation"]
    for rows in (C, D):
        x, y, _ = rows[jitter]
        rows[_PLACE["los"]] = optics.focal_length * np.array([y, -x])
        rows[_PLACE["line_of_sight"]] = x, y
    C[_PLACE["line_of_sight"], d.slices["x_t"]] += optics.truss_sensitivity * d.truss_turns_P[:2]

    put("base_attitude", (r_b, small_turns(centre.attitude)), value=centre.attitude)
    attitude = multiply(centre.attitude, from_rotation_matrix(d.pose.rotation_BP))
    to_attitude = small_turns(attitude) @ d.pose.rotation_BP.T
    by_coarse, by_fine = to_attitude @ J.J_theta_c, to_attitude @ J.J_theta_f
    put("payload_attitude", (r_b, to_attitude), (s, by_coarse), (d_f, by_fine), (e_c, by_coarse * rods), value=attitude)
    return C, D
