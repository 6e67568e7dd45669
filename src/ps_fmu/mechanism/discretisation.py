"""Exact discretisation of a linear system whose inputs are held over a step."""

from __future__ import annotations

from math import factorial

import numpy as np

from .quantities import Array

#: Largest norm of A h, balanced, up to which the series below has all digits: its first missing term is 8e-17.
_SHORT = 0.8
#: Factors of phi(X) = (exp(X) - 1) / X up to X**15, in rows of four (M. Paterson and L. Stockmeyer, SIAM J. Comput. 2,
#: 1973).
_FACTORS = np.array([1.0 / factorial(k + 1) for k in range(16)]).reshape(4, 4)


def zero_order_hold(A: Array, B: Array, h: float) -> tuple[Array, Array]:
    """``x(t + h) = Ad x(t) + Bd u`` for ``x' = A x + B u`` with ``u`` constant over the step.

    ``Ad = exp(A h)`` and ``Bd = h phi(A h) B`` need no inverse of A: a free spacecraft has none.  A step that is
    short against all that A contains has a series for phi: for the plant in half of the time of the exponential.  Else,
    both come from one exponential of the augmented matrix (C. Van Loan, IEEE Trans. Autom. Control 23(3), 1978).

    Parameters
    ----------
    A: (n, n).  B: (n, m).  h: step, s.

    Where the step is far too long for the system, elements of the result are not finite.
    """
    from scipy.linalg import expm  # here, because an FMU pays for the import only when it builds a model
    from scipy.linalg.lapack import dgebal

    n, m = B.shape
    with np.errstate(over="ignore", invalid="ignore"):
        if n and np.isfinite(A).all():
            X, _, _, scale, _ = dgebal(A * h, scale=1, permute=0)  # balanced with powers of 2: exactly
            if np.abs(X).sum(axis=0).max() <= _SHORT:
                return _sum_series(X, scale, B * h)
        augmented = np.zeros((n + m, n + m))
        augmented[:n, :n], augmented[:n, n:] = A * h, B * h
        exponential = expm(augmented)
    return exponential[:n, :n], exponential[:n, n:]


def _sum_series(X: Array, scale: Array, B: Array) -> tuple[Array, Array]:
    """(exp(Y), phi(Y) B) for ``Y = S X S**-1`` with the diagonal ``scale`` of S and a small X."""
    n = len(X)
    powers = np.empty((4, n, n))
    powers[0], powers[1], powers[2] = np.eye(n), X, X @ X
    powers[3] = powers[2] @ X
    fourth = powers[2] @ powers[2]
    rows = (_FACTORS @ powers.reshape(4, -1)).reshape(4, n, n)
    phi = rows[3]
    for row in rows[2::-1]:
        phi = phi @ fourth + row
    exponential = powers[0] + X @ phi
    return exponential * scale[:, None] / scale, phi @ (B / scale[:, None]) * scale[:, None]


def step_map(A: Array, B: Array, C: Array, D: Array, h: float) -> Array:
    """One step as one matrix: ``[y; x](t + h) = M @ [x; u](t)``, shape (p + n, n + m).

    See :func:`make_held_step_map`.
    """
    return make_held_step_map(*zero_order_hold(A, B, h), C, D)


def make_held_step_map(Ad: Array, Bd: Array, C: Array, D: Array) -> Array:
    """As :func:`step_map`, from the exponential (Ad, Bd).

    The output is that of the end of the step, with the input that was held during it:
    ``y = C x(t + h) + D u(t)``.
    """
    (p, n), m = C.shape, Bd.shape[1]
    step = np.empty((p + n, n + m))
    with np.errstate(over="ignore", invalid="ignore"):
        step[:p, :n], step[:p, n:] = C @ Ad, C @ Bd + D
    step[p:, :n], step[p:, n:] = Ad, Bd
    return step
