"""Outputs of the plant that are not linear in its state, for :mod:`.derivation`: angles, turns and quaternions.

With ``+ - * /`` and square roots only: an angle is halved until a short series has all its digits.
"""

from __future__ import annotations

from typing import Any

import casadi as ca

from .equations import SX, count, cross, dot, make, split

#: Terms of asin(s) / s in powers of s**2, which is below 0.039: the first that is left out is 3e-18 of it.
_TERMS = 12


def sum_arcsine(square: SX) -> SX:
    """``asin(s) / s`` from the square of s."""
    factor, factors = 1.0, []
    for k in range(_TERMS):
        factors.append(factor / (2 * k + 1))
        factor *= (2 * k + 1) / (2 * k + 2)
    total: Any = SX(factors[-1])
    for each in reversed(factors[:-1]):
        total = total * square + each
    return total


def find_angle(c: SX, s: SX) -> SX:
    """Angle with this cosine and sine, rad, within (-pi, pi): halved four times, then asin's series."""
    for _ in range(4):
        c = ca.sqrt((1 + c) / 2)
        s = s / (2 * c)
    total = sum_arcsine(s * s)
    return 16 * s * total


def find_rotation_vector(Q: SX) -> SX:
    """Rotation vector of a turn of less than half a revolution: halved four times, then asin's series."""
    q = find_quaternion(Q)
    c, v = q[0], q[1:]
    for _ in range(3):
        c = ca.sqrt((1 + c) / 2)
        v = v / (2 * c)
    ratio = sum_arcsine(dot(v, v))
    return 16 * v * ratio


def find_quaternion(Q: SX) -> SX:
    """(4,) quaternion, scalar first and positive, of a turn of less than half a revolution."""
    w = ca.sqrt(1 + Q[0, 0] + Q[1, 1] + Q[2, 2]) / 2
    return ca.vertcat(w, ca.vertcat(Q[2, 1] - Q[1, 2], Q[0, 2] - Q[2, 0], Q[1, 0] - Q[0, 1]) / (4 * w))


def find_angles(R: SX) -> SX:
    """(3,) roll, pitch, yaw, eq (14), rad."""
    level = ca.sqrt(R[0, 0] ** 2 + R[1, 0] ** 2)
    return ca.vertcat(
        find_angle(R[2, 2] / level, R[2, 1] / level), find_angle(level, -R[2, 0]),
        find_angle(R[0, 0] / level, R[1, 0] / level),
    )  # fmt: skip


def multiply(a: SX, b: SX) -> SX:
    """(4,) product of quaternions."""
    return ca.vertcat(a[0] * b[0] - dot(a[1:], b[1:]), a[0] * b[1:] + b[0] * a[1:] + cross(a[1:], b[1:]))


#: What the outputs that are not linear depend on.
PLACE = (
    ("translation", (3,), "m", "origin of P, in B"),
    ("rotation", (3, 3), "1", "P to B"),
    ("nominal_translation", (3,), "m", "the same by the coarse legs alone"),
    ("nominal_rotation", (3, 3), "1", "the same by the coarse legs alone"),
    ("attitude", (4,), "1", "quaternion of B, scalar first"),
    ("base_position", (3,), "m", "of the origin of B since the start, in B"),
    ("base_rotation", (3,), "rad", "integral of the angular velocity of B, in B"),
)


def find_outputs(place: dict[str, SX]) -> SX:
    """(16,) payload position and rotation, orientation, relative orientation, attitude of the payload."""
    t, R, t_n, R_n = (place[name] for name, *_ in PLACE[:4])
    turn = place["base_rotation"]
    position = place["base_position"] + t + cross(turn, t) - t_n
    rotation = R_n.T @ turn + find_rotation_vector(R_n.T @ R)
    attitude = multiply(place["attitude"], find_quaternion(R))
    return ca.vertcat(position, rotation, find_angles(R_n), find_angles(R), attitude)


def derive_outputs() -> ca.Function:
    """Outputs that are not linear in the state."""
    place = SX.sym("place", sum(count(shape) for _, shape, *_ in PLACE))
    return make("outputs", {"place": place}, {"y": find_outputs(split(place, PLACE))})


def derive_outputs_change() -> ca.Function:
    """Their derivative along a direction."""
    place = SX.sym("place", sum(count(shape) for _, shape, *_ in PLACE))
    change = SX.sym("change", place.numel())
    dy = ca.jtimes(find_outputs(split(place, PLACE)), place, change)
    return make("outputs_change", {"place": place, "change": change}, {"dy": dy})
