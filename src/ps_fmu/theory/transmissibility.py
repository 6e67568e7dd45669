"""What reaches the payload, in closed form: from base motion (Fig 8), and from a disturbance wrench.

With the practical plant and the controller of a :class:`.loop.Loop`, ``f = K_we s^2 exp(-s tau) q_b``::

    passive   theta_p = G_P q_b                              theta_p = B w_b
    active    theta_p = (G_P + (A - G_P C) F) q_b            theta_p = (B + A F (E - C F)^-1 D) w_b

with F the controller from base displacement to force.  All rotations are in axes of the platform P.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ..mechanism.quantities import Array, Complex
from .loop import Loop
from .transfer_matrices import Practical


def from_base(loop: Loop, s: ArrayLike, *, active: bool) -> Complex:
    """Transmissibility, base motion (m, rad; B) to payload rotation (rad; P), (..., 3, 6): Fig 8."""
    plant, s = Practical(loop.model.dynamics), np.asarray(s, dtype=complex)
    A, B, C, D = plant.all(s)
    G_P = B @ np.linalg.inv(D)
    if active:
        G_P = G_P + (A - G_P @ C) @ _force(loop, s)
    return np.asarray(_to_platform(loop) @ G_P)


def from_wrench(loop: Loop, s: ArrayLike, *, active: bool) -> Complex:
    """Disturbance wrench (N, N.m; in B at its origin) to payload rotation (rad; P), (..., 3, 6)."""
    plant, s = Practical(loop.model.dynamics), np.asarray(s, dtype=complex)
    A, B, C, D = plant.all(s)
    if active:
        F = _force(loop, s)
        B = B + A @ F @ np.linalg.solve(np.eye(6) - C @ F, D)
    return np.asarray(_to_platform(loop) @ B)


def singular_values_db(matrix: Complex) -> Array:
    """Singular values, largest first, (..., 3), dB; translations in m and rotations in rad count alike."""
    return np.asarray(20.0 * np.log10(np.linalg.svd(matrix, compute_uv=False)))


def _force(loop: Loop, s: Complex) -> Complex:
    """F(s): base displacement to fine force, (..., 3, 6)."""
    gain = s * s * np.exp(-s * loop.delay)
    return np.asarray(loop.controller.response(s) * gain[..., None, None])


def _to_platform(loop: Loop) -> Array:
    return loop.model.dynamics.pose.rotation_BP.T
