"""What the plant puts out: ``y = C x + D u``, each output with its value and first derivatives at the centre.

Outputs that are not linear in the state have the value at the centre, and change with the distance from it to first
order.  The *nominal* pose of the payload is that of the coarse legs alone, the *present* one has the fine legs too.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from .centre import Centre
from .dynamics import Dynamics, Pose
from .parameters import Optics
from .quantities import Array
from .quaternions import from_rotation_matrix, multiply, small_turns
from .rotations import orientation_rate_map, roll_pitch_yaw, rotation_vector, skew
from .signals import N_INPUTS, N_OUTPUTS, count_states, output_slices, servo_slices

_PLACE = output_slices()
_EYE = np.eye(3)
_ONE = N_INPUTS - 1  # place of the constant in the input


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
    acceleration: tuple[Array, Array],
) -> tuple[Array, Array]:
    """C and D about k centres, (k, outputs, states) and (k, outputs, inputs).

    Parameters
    ----------
    d, orientation: at the present poses of the centres.
    nominal: their nominal poses, those of ``d`` where the fine legs are undeformed.
    centre: stacked, see :meth:`.centre.Centre.stack`.
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
    J_theta_c, J_theta_f, J_tc, J_tf = J.J_theta_c, J.J_theta_f, J.J_tc, J.J_tf
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
        np.subtract(value, at_centre[:, place], out=D[:, place, _ONE])

    # A small rotation th turns the boresight z by th x z = (th_y, -th_x, 0).
    jitter, image = _PLACE["payload_rotation"].start, _PLACE["los"].start
    for rows in (C, D):
        np.multiply(rows[:, jitter + 1], optics.focal_length, out=rows[:, image])
        np.multiply(rows[:, jitter], -optics.focal_length, out=rows[:, image + 1])
        rows[:, _PLACE["line_of_sight"]] = rows[:, jitter : jitter + 2]
    C[:, _PLACE["line_of_sight"], d.slices["x_t"]] += optics.truss_sensitivity * d.truss_turns_P[:2]
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
