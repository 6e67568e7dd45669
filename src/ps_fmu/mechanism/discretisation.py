"""Exact discretisation of a linear system whose inputs are held over a step."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from .quantities import Array

#: Largest norm of A h, balanced, up to which the series below has all digits: its first missing term is 8e-17.
_SHORT = 0.8
#: Factors of phi(X) = (exp(X) - 1) / X up to X**15, in rows of four (M. Paterson and L. Stockmeyer, SIAM J. Comput. 2,
#: 1973).
_FACTORS = np.array([1.0 / math.factorial(k + 1) for k in range(16)]).reshape(4, 4)
#: Each doubling costs a binary digit of what is slow: after so many, 1e-7 of it is left to chance.
_MOST_HALVINGS = 30
#: Of the balancing; the plant needs two.  Couplings of 1e300 in one direction only need ten.
_MOST_SWEEPS = 20
#: A scale that is given serves as it is where it leaves no more halvings than these.
_FEW_HALVINGS = 4
#: Part in the norm of A h, balanced, of what acts in one direction only.
_LITTLE = 0.01
_SMALLEST = float(np.finfo(np.float64).tiny)


def zero_order_hold(A: Array, B: Array, h: float, scale: Array | None = None) -> tuple[Array, Array]:
    """``x(t + h) = Ad x(t) + Bd u`` for ``x' = A x + B u`` with ``u`` constant over the step.

    ``Ad = exp(A h)`` and ``Bd = h phi(A h) B`` need no inverse of A: a free spacecraft has none.  A step that is
    short against all that A contains has a series for phi.  A longer one is halved until it is short, and doubled by
    ``phi(2 X) = phi(X) (exp(X) + 1) / 2`` (N. J. Higham, Functions of Matrices, SIAM 2008, sections 10.3 and 10.7.4).
    numpy is enough for that: ``scipy.linalg`` takes as long to import as an FMU to load.

    Parameters
    ----------
    A: (n, n).  B: (n, m).  h: step, s.
    scale: (n,) of :func:`find_scale` for a system like this one: most of the work for a scale is done then.  Where the
        step is short, the result has the same bits without it.

    Where the step is far too long for the system, so that few digits would be right, elements of the result are not
    finite.
    """
    n = len(A)
    if n == 0:
        return A.copy(), B.copy()
    with np.errstate(over="ignore", invalid="ignore"):
        scale, size = _balance(A, h, scale)  # of A that is not finite, no number
        if not size <= _SHORT * 2.0**_MOST_HALVINGS or not np.isfinite(B).all():
            return np.full_like(A, np.nan), np.full_like(B, np.nan)
        # Powers of two: the order of products with them makes no difference.
        back = 1.0 / scale
        to_scale, from_scale = back[:, None], scale[:, None]
        halvings = int(np.ceil(np.log2(size / _SHORT))) if size > _SHORT else 0
        X = A * (h * 0.5**halvings * scale)
        X *= to_scale
        exponential, phi = _sum_series(X)
        for _ in range(halvings):
            phi = 0.5 * (phi @ exponential + phi)
            exponential = exponential @ exponential
        exponential *= from_scale
        exponential *= back
        held = phi @ (B * (h * to_scale))
        held *= from_scale
        return exponential, held


def find_scale(A: Array, h: float) -> Array:
    """(n,) powers of two that balance A for steps of h, s, and systems like this one: see :func:`zero_order_hold`."""
    with np.errstate(over="ignore", invalid="ignore"):
        return _balance(A, h, None)[0]


def _balance(A: Array, h: float, scale: Array | None) -> tuple[Array, float]:
    """Diagonal ``s`` (n,) for which ``A s / s[:, None]`` has rows and columns of about the same size (E. E. Osborne,
    J. ACM 7, 1960); and no less than the largest sum of a column then, times h.

    Powers of two, so that nothing is rounded: what is computed with them has the same bits whatever they are.  All rows
    and columns are balanced at once, each by half of what it lacks: with all of it, two that share an element would
    swap their sizes for ever.  It ends where the norm is small enough for the series, or once no factor is larger than
    two: further ones hardly change the norm, and take several times as long.  Where a row is zero, its column may be
    scaled at will and comes to a little, and likewise a row whose column is zero.  It begins with ``scale``.
    """
    sizes, little = np.abs(A), _LITTLE / h
    if scale is not None:
        size = h * float((((1.0 / scale) @ sizes) * scale).max())
        if size <= _SHORT * 2.0**_FEW_HALVINGS:
            return scale, size
    if not np.isfinite(sizes).all():
        return np.ones(len(A)), math.nan
    own = sizes.diagonal().copy()
    np.fill_diagonal(sizes, 0.0)
    # Sums of elements as small as 1e-300 may underflow to zero, which has no logarithm.
    no_row, no_column = (np.where(sizes.any(axis=axis), _SMALLEST, little) for axis in (1, 0))
    scale = np.ones(len(A)) if scale is None else scale.copy()
    largest, size = math.inf, math.inf
    for _ in range(_MOST_SWEEPS + 1):
        # Sums of the scaled matrix are products: 4 us for the plant, where to scale it and to sum takes 20.
        rows, columns = (sizes @ scale) / scale + no_row, ((1.0 / scale) @ sizes) * scale + no_column
        size = h * float((columns + own).max())
        if size <= _SHORT or not largest > 1.0:
            break
        steps = np.rint(0.25 * (np.log2(rows) - np.log2(columns)))
        scale *= np.exp2(steps)
        largest = np.abs(steps).max()
    return scale, size


def _sum_series(X: Array) -> tuple[Array, Array]:
    """exp(X) and phi(X) of a small X."""
    n = len(X)
    powers = np.empty((4, n, n))
    powers[0], powers[1] = _make_identity(n), X
    np.matmul(X, X, out=powers[2])
    np.matmul(powers[2], X, out=powers[3])
    fourth = powers[2] @ powers[2]
    rows = (_FACTORS @ powers.reshape(4, -1)).reshape(4, n, n)
    phi = rows[3]
    for row in rows[2::-1]:
        phi = phi @ fourth
        phi += row
    exponential = X @ phi
    exponential += powers[0]
    return exponential, phi


@lru_cache(maxsize=8)
def _make_identity(n: int) -> Array:
    identity = np.eye(n)
    identity.setflags(write=False)
    return identity


def make_held_step_map(Ad: Array, Bd: Array, C: Array, D: Array) -> Array:
    """One step as one matrix, ``[y; x](t + h) = M @ [x; u](t)``, shape (p + n, n + m), from the exponential (Ad, Bd).

    The output is that of the end of the step, with the input that was held during it:
    ``y = C x(t + h) + D u(t)``.
    """
    (p, n), m = C.shape, Bd.shape[1]
    step = np.empty((p + n, n + m))
    with np.errstate(over="ignore", invalid="ignore"):
        step[:p, :n], step[:p, n:] = C @ Ad, C @ Bd + D
    step[p:, :n], step[p:, n:] = Ad, Bd
    return step
