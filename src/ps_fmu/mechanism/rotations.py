"""Rotations: roll, pitch and yaw of eq (14), ``R = Rz(yaw) Ry(pitch) Rx(roll)``, P to B; vectors; quaternions.

Every function is vectorised: any leading dimensions of an argument are those of the result.  An
``orientation`` is (roll, pitch, yaw) in rad.  Equation (14) as printed is this matrix; its transpose would
misplace the platform by centimetres.

Unit quaternions have the scalar first: ``q = (w, x, y, z)`` turns components in a body's axes to those outside.
``v_N = q (0, v_B) q*`` for the attitude of B in N.  A further turn by an angle ``a`` about ``n`` in the body's own axes
multiplies from the right: ``q (cos a/2, n sin a/2)``.  Source: J. Diebel, Representing Attitude, Stanford University,
2006, section 6.
"""

from __future__ import annotations

import math

import numpy as np

from .quantities import Array

# Below this cosine of the pitch (6e-5 deg from +-90 deg) roll and yaw have lost half of their digits.
SMALLEST_COS_PITCH = 1e-6

_MANY = 100  # numbers
_SMALLEST = 1e-150  # rad; sin(a)/a is 1 there, too
_SKEW = np.array([[0, 0, 0, 0, 0, -1, 0, 1, 0], [0, 0, 1, 0, 0, 0, -1, 0, 0], [0, -1, 0, 1, 0, 0, 0, 0, 0]], float)
_NEXT, _LAST = np.array([1, 2, 0]), np.array([2, 0, 1])  # axes after and before x, y, z, cyclically
_BELOW, _ABOVE = 3 * _LAST + _NEXT, 3 * _NEXT + _LAST  # places in a matrix, row by row


class GimbalLockError(ValueError):
    """Pitch is so close to +-90 deg that roll and yaw cannot be told apart."""


def rotation_matrix(orientation: Array) -> Array:
    """Rotation matrix of eq (14), components in P to components in B.

    Parameters
    ----------
    orientation: (..., 3), roll, pitch and yaw, rad.

    Returns
    -------
    (..., 3, 3)
    """
    orientation = np.asarray(orientation, dtype=float)
    (sr, sp, sy), (cr, cp, cy) = (np.moveaxis(f(orientation), -1, 0) for f in (np.sin, np.cos))
    R = np.empty((*orientation.shape, 3))
    R[..., 0, 0], R[..., 0, 1], R[..., 0, 2] = cp * cy, cy * sr * sp - cr * sy, cr * cy * sp + sr * sy
    R[..., 1, 0], R[..., 1, 1], R[..., 1, 2] = cp * sy, cr * cy + sr * sp * sy, cr * sp * sy - cy * sr
    R[..., 2, 0], R[..., 2, 1], R[..., 2, 2] = -sp, cp * sr, cr * cp
    return R


def roll_pitch_yaw(R: Array) -> Array:
    """Roll, pitch and yaw of rotation matrices, pitch within +-90 deg: inverse of :func:`rotation_matrix`.

    Parameters
    ----------
    R: (..., 3, 3), proper orthogonal.

    Returns
    -------
    (..., 3), rad.

    Raises
    ------
    GimbalLockError: pitch is within 6e-5 deg of +-90 deg.
    """
    R = np.asarray(R, dtype=float)
    cos_pitch = np.hypot(R[..., 0, 0], R[..., 1, 0])
    _refuse_gimbal_lock(cos_pitch)
    roll = np.arctan2(R[..., 2, 1], R[..., 2, 2])
    pitch = np.arctan2(-R[..., 2, 0], cos_pitch)
    yaw = np.arctan2(R[..., 1, 0], R[..., 0, 0])
    return np.stack([roll, pitch, yaw], axis=-1)


def skew(v: Array) -> Array:
    """Cross-product matrices: ``skew(a) @ b = a x b``; (..., 3) to (..., 3, 3).

    A product with a constant: in half of the time that six assignments take, and exact as these.
    """
    v = np.asarray(v, dtype=float)
    return np.asarray((v @ _SKEW).reshape(*v.shape, 3))


def cross(a: Array, b: Array) -> Array:
    """Cross products ``a x b``, (..., 3) each; one takes 0.7 us and a few 2, where numpy takes 12, to the same bits."""
    if a.ndim == b.ndim == 1:
        (x, y, z), (u, v, w) = a.tolist(), b.tolist()
        return np.array((y * w - z * v, z * u - x * w, x * v - y * u))
    return a.take(_NEXT, -1) * b.take(_LAST, -1) - a.take(_LAST, -1) * b.take(_NEXT, -1)


def dot(a: Array, b: Array) -> Array:
    """Products of vectors, (..., 3) each to (...).

    For many vectors component by component, a quarter of the time of a sum over so short an axis, to the same bits.
    """
    if a.size < _MANY and b.size < _MANY:
        return np.asarray(np.add.reduce(a * b, axis=-1))
    return np.asarray(a[..., 0] * b[..., 0] + a[..., 1] * b[..., 1] + a[..., 2] * b[..., 2])


def lengths(vectors: Array) -> Array:
    """Euclidean lengths, (..., 3) to (...): as numpy's norm to the bit, for a few vectors in half of its time."""
    return np.asarray(np.sqrt(dot(vectors, vectors)))


def angular_velocity_map(orientation: Array) -> Array:
    """E with ``omega_B = E d(orientation)/dt``: angular velocity of P relative to B, components in B.

    The columns are the axes of the three elementary rotations: Rz Ry e_x, Rz e_y and e_z.

    Parameters
    ----------
    orientation: (..., 3), rad.

    Returns
    -------
    (..., 3, 3)
    """
    sp, sy, cp, cy = _sines_cosines(orientation)
    E = np.zeros((*np.shape(orientation), 3))
    E[..., 0, 0], E[..., 0, 1] = cp * cy, -sy
    E[..., 1, 0], E[..., 1, 1] = cp * sy, cy
    E[..., 2, 0], E[..., 2, 2] = -sp, 1.0
    return E


def orientation_rate_map(orientation: Array) -> Array:
    """Inverse of :func:`angular_velocity_map`: ``d(orientation)/dt = E^-1 omega_B``; (..., 3) to (..., 3, 3).

    Raises
    ------
    GimbalLockError: pitch is within 6e-5 deg of +-90 deg.
    """
    sp, sy, cp, cy = _sines_cosines(orientation)
    _refuse_gimbal_lock(np.abs(cp))
    E_inverse = np.zeros((*np.shape(orientation), 3))
    E_inverse[..., 0, 0], E_inverse[..., 0, 1] = cy / cp, sy / cp
    E_inverse[..., 1, 0], E_inverse[..., 1, 1] = -sy, cy
    E_inverse[..., 2, 0], E_inverse[..., 2, 1], E_inverse[..., 2, 2] = cy * sp / cp, sy * sp / cp, 1.0
    return E_inverse


def rotation_from_vector(vector: Array) -> Array:
    """Rotation by the angle ``|vector|`` (rad) about ``vector`` (Rodrigues); (..., 3) to (..., 3, 3)."""
    squares = vector * vector
    angle = np.maximum(np.sqrt(squares[..., 0] + squares[..., 1] + squares[..., 2]), _SMALLEST)[..., None]
    sine, half = np.sin(angle) / angle, np.sin(0.5 * angle) / angle
    one_less = 2.0 * half * half  # (1 - cos a) / a**2
    R = one_less[..., None] * (vector[..., :, None] * vector[..., None, :])
    R += skew(sine * vector)
    R.reshape(*vector.shape[:-1], 9)[..., ::4] = 1.0 - one_less * (squares.take(_NEXT, -1) + squares.take(_LAST, -1))
    return np.asarray(R)


def rotation_vector(R: Array) -> Array:
    """Rotation vector, rad, of turns below 90 deg: inverse of :func:`rotation_from_vector`; (..., 3, 3) to (..., 3)."""
    numbers = R.reshape(*R.shape[:-2], 9)
    sine = 0.5 * (numbers.take(_BELOW, -1) - numbers.take(_ABOVE, -1))
    size = np.maximum(lengths(sine), 1e-8)  # so small, arcsin(a)/a is 1
    return np.asarray((np.arcsin(np.minimum(size, 1.0)) / size)[..., None] * sine)


def _sines_cosines(orientation: Array) -> tuple[Array, Array, Array, Array]:
    """Sine of pitch and yaw, cosine of pitch and yaw; the maps of rates do not depend on the roll."""
    orientation = np.asarray(orientation, dtype=float)
    pitch, yaw = orientation[..., 1], orientation[..., 2]
    return np.sin(pitch), np.sin(yaw), np.cos(pitch), np.cos(yaw)


def _refuse_gimbal_lock(cos_pitch: Array) -> None:
    smallest = float(cos_pitch.min(initial=1.0))
    if not smallest >= SMALLEST_COS_PITCH:
        raise GimbalLockError(
            f"pitch is {np.degrees(np.arccos(smallest)):.6f} deg in magnitude, too close to 90 deg to tell "
            "roll from yaw; use the rotation matrix itself there"
        )


#: No turn at all.
IDENTITY = np.array([1.0, 0.0, 0.0, 0.0])
IDENTITY.setflags(write=False)


def multiply(p: Array, q: Array) -> Array:
    """Product of quaternions, (..., 4) each: first the turn ``q``, then ``p``, both in axes outside."""
    product = np.empty(np.broadcast_shapes(p.shape, q.shape))
    scalar, v, other, u = p[..., :1], p[..., 1:], q[..., :1], q[..., 1:]
    product[..., :1] = scalar * other - np.sum(v * u, axis=-1, keepdims=True)
    product[..., 1:] = scalar * u + other * v + cross(v, u)
    return product


def from_rotation_vector(vector: Array) -> Array:
    """The turn by the angle ``|vector|`` (rad) about ``vector``; (..., 3) to (..., 4)."""
    if vector.ndim == 1:  # numbers instead of arrays: 3 us instead of 14
        x, y, z = vector.tolist()
        angle = 0.5 * math.sqrt(x * x + y * y + z * z)
        factor = 0.5 * float(np.sin(angle)) / angle if angle > 0.0 else 0.5
        return np.array((float(np.cos(angle)), factor * x, factor * y, factor * z))
    half = 0.5 * np.linalg.norm(vector, axis=-1)[..., None]
    return np.concatenate([np.cos(half), 0.5 * np.sinc(half / np.pi) * vector], axis=-1)


def from_rotation_matrix(R: Array) -> Array:
    """The quaternion of a rotation matrix, (..., 3, 3) to (..., 4), with a scalar that is not negative."""
    found = np.array([_find_quaternion(matrix) for matrix in R.reshape(-1, 3, 3).tolist()])
    return found.reshape(*R.shape[:-2], 4)


def _find_quaternion(R: list[list[float]]) -> list[float]:
    """Of four ways, the one with the largest divisor.  Numbers instead of arrays: 2 us instead of 11."""
    diagonal = R[0][0], R[1][1], R[2][2]
    trace = diagonal[0] + diagonal[1] + diagonal[2]
    if trace >= max(diagonal):
        q = [1.0 + trace, R[2][1] - R[1][2], R[0][2] - R[2][0], R[1][0] - R[0][1]]
    else:
        i = diagonal.index(max(diagonal))
        j, k = (i + 1) % 3, (i + 2) % 3
        q = [R[k][j] - R[j][k], 0.0, 0.0, 0.0]
        q[1 + i] = 1.0 + 2.0 * diagonal[i] - trace
        q[1 + j], q[1 + k] = R[i][j] + R[j][i], R[i][k] + R[k][i]
    size = math.copysign(math.sqrt(sum(part * part for part in q)), q[0])
    return [part / size for part in q]
