"""Unit quaternions, scalar first: ``q = (w, x, y, z)`` turns components in a body's axes to those outside.

``v_N = q (0, v_B) q*`` for the attitude of B in N.  A further turn by an angle ``a`` about ``n`` in the body's own axes
multiplies from the right: ``q (cos a/2, n sin a/2)``.  Source: J. Diebel, Representing Attitude, Stanford University,
2006, section 6.
"""

from __future__ import annotations

import math

import numpy as np

from .quantities import Array
from .rotations import cross

#: No turn at all.
IDENTITY = np.array([1.0, 0.0, 0.0, 0.0])
IDENTITY.setflags(write=False)

# Columns of the products with (0, e_k): which part of a quaternion, and its sign.
_TURNED = np.array([[1, 2, 3], [0, 3, 2], [3, 0, 1], [2, 1, 0]])
_SIGNS = np.array([[-1.0, -1.0, -1.0], [1.0, -1.0, 1.0], [1.0, 1.0, -1.0], [-1.0, 1.0, 1.0]])


def multiply(p: Array, q: Array) -> Array:
    """Product of quaternions, (..., 4) each: first the turn ``q``, then ``p``, both in axes outside."""
    if p.ndim == q.ndim == 1:  # 1 us instead of 9, to the same bits
        w, x, y, z = p.tolist()
        s, a, b, c = q.tolist()
        return np.array(
            (
                w * s - (x * a + y * b + z * c),
                w * a + s * x + (y * c - z * b),
                w * b + s * y + (z * a - x * c),
                w * c + s * z + (x * b - y * a),
            )
        )
    product = np.empty(np.broadcast_shapes(p.shape, q.shape))
    scalar, v, other, u = p[..., :1], p[..., 1:], q[..., :1], q[..., 1:]
    product[..., :1] = scalar * other - np.sum(v * u, axis=-1, keepdims=True)
    product[..., 1:] = scalar * u + other * v + cross(v, u)
    return product


def conjugate(q: Array) -> Array:
    """The turn back, (..., 4)."""
    return q * np.array([1.0, -1.0, -1.0, -1.0])


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


def to_rotation_matrix(q: Array) -> Array:
    """The rotation matrix of a unit quaternion, (..., 4) to (..., 3, 3): body axes to those outside."""
    w, x, y, z = np.moveaxis(q, -1, 0)
    R = np.empty((*q.shape[:-1], 3, 3))
    R[..., 0, 0], R[..., 0, 1], R[..., 0, 2] = 1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)
    R[..., 1, 0], R[..., 1, 1], R[..., 1, 2] = 2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)
    R[..., 2, 0], R[..., 2, 1], R[..., 2, 2] = 2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)
    return R


def small_turns(q: Array) -> Array:
    """(..., 4, 3): how ``q`` (..., 4) changes by a small turn (rad) in the body's own axes, ``q (0, e_k) / 2``."""
    return np.asarray((0.5 * q).take(_TURNED, -1) * _SIGNS)


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
