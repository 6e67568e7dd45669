"""Robust stability of the nominal internal loop by the small-gain theorem (eqs 58-64).

With ``C' = (E + Delta) C`` the loop of the optimal controller stays stable if ``sigma(Delta) sigma(T) < 1`` at every
frequency (62).  For a pure delay tau alone, ``|Delta| = |exp(-s tau) - 1|``.  The paper's equations have no damping in
the modes of the bus; T is then infinite at the free modes of the arrays, and (62) holds for no delay.  So the
functions take the nominal system either way: as :class:`.Nominal`, without, or as :class:`.Practical`, with damping.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..mechanism.dynamics import Dynamics
from ..mechanism.quantities import Array, Complex
from .transfer_matrices import Nominal, Practical

_BASE_AT_REST = 0.1  # rad/s: roots below are those of the free base, zero but for rounding; arrays begin at 2.8


def nominal_complement(nominal: Nominal | Practical, s: ArrayLike) -> Complex:
    """T(s) = E - S(s) of the optimal controller on the nominal plant, eq (63), (..., 6, 6)."""
    return np.asarray(_mobile_base(nominal, s) @ nominal.G_P(s))


def nominal_complement_bound(nominal: Nominal | Practical, s: ArrayLike) -> Array:
    """Right-hand side of (64): product of the largest singular values of the two factors of T, (...)."""
    return np.asarray(largest_singular_value(_mobile_base(nominal, s)) * largest_singular_value(nominal.G_P(s)))


def delay_uncertainty(frequency: ArrayLike, delay: float) -> Array:
    """|Delta| of eq (58) for a pure delay, ``|exp(-s tau) - 1|``, (...); frequency in Hz, delay in s."""
    return np.asarray(np.abs(2.0 * np.sin(np.pi * np.asarray(frequency) * delay)))


def nominal_loop_poles(d: Dynamics) -> Complex:
    """Poles of S and T with the optimal controller, (n,), rad/s, with the damping that the system has.

    Roots of (57), and the free modes of the arrays: base and modes, with fine legs that keep the payload from turning.
    """
    d_f, q_b, x_m = (d.slices[name] for name in ("d_f", "q_b", "x_m"))
    both = np.arange(q_b.start, x_m.stop)[d.active[q_b.start : x_m.stop]]
    block = np.ix_(both, both)
    M = d.M[block].copy()
    M[:6, :6] -= d.M[q_b, d_f] @ np.linalg.solve(d.jacobians.J_theta_f, d.jacobians.J_theta_b)
    suspension = quadratic_roots(d.M[d_f, d_f], d.C[d_f, d_f], d.K[d_f, d_f])
    arrays = quadratic_roots(M, d.C[block], d.K[block])
    return np.concatenate([suspension, arrays[np.abs(arrays) > _BASE_AT_REST]])


def largest_singular_value(matrix: NDArray[np.inexact[Any]]) -> Array:
    """Of each matrix, (..., rows, columns) to (...)."""
    return np.asarray(np.linalg.svd(matrix, compute_uv=False)[..., 0])


def _mobile_base(nominal: Nominal | Practical, s: ArrayLike) -> Complex:
    """``(E - Y J_thf^-1 J_thb)^-1 (-Y J_thf^-1)`` of (63), (..., 6, 3)."""
    J = nominal.dynamics.jacobians
    follow = np.linalg.solve(J.J_theta_f, J.J_theta_b)
    Y = nominal.Y(s)
    return np.asarray(np.linalg.solve(np.eye(6) - Y @ follow, -Y @ np.linalg.inv(J.J_theta_f)))


def quadratic_roots(M: Array, C: Array, K: Array) -> Complex:
    """Roots of det(s^2 M + s C + K) = 0, (2 n,), of matrices (n, n)."""
    n = len(M)
    A = np.block([[np.zeros((n, n)), np.eye(n)], [-np.linalg.solve(M, K), -np.linalg.solve(M, C)]])
    return np.asarray(np.linalg.eigvals(A).astype(complex))
