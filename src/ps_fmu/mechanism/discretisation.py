"""Exact discretisation of a linear system whose inputs are held over a step."""

from __future__ import annotations

import numpy as np

from .quantities import Array


def zero_order_hold(A: Array, B: Array, h: float) -> tuple[Array, Array]:
    """``x(t + h) = Ad x(t) + Bd u`` for ``x' = A x + B u`` with ``u`` constant over the step.

    Both come from one exponential of the augmented matrix (C. Van Loan, IEEE Trans. Autom. Control 23(3), 1978),
    which needs no inverse of A: a free spacecraft has none.

    Parameters
    ----------
    A: (n, n).  B: (n, m).  h: step, s.

    Where the step is far too long for the system, elements of the result are not finite.
    """
    from scipy.linalg import expm  # here, because an FMU pays for the import only when it builds a model

    n, m = B.shape
    augmented = np.zeros((n + m, n + m))
    augmented[:n, :n], augmented[:n, n:] = A * h, B * h
    with np.errstate(over="ignore", invalid="ignore"):
        exponential = expm(augmented)
    return exponential[:n, :n], exponential[:n, n:]


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
