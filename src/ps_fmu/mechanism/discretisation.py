"""Exact discretisation of a linear system whose inputs are held, or grow evenly, over a step."""

from __future__ import annotations

from ctypes import byref
from typing import NamedTuple

import numpy as np

from ..numerics.library import Discretisation, allocate, find_address, find_library
from .quantities import Array

_LANES = 8
_ALL = 2**62  # multiplications: no bound
_DONE = 1


class HeldStep(NamedTuple):
    """``x(t + h) = Ad x(t) + Bd u(t) + Rd (u(t + h) - u(t))``, of inputs u that grow evenly over the step."""

    Ad: Array
    Bd: Array
    Rd: Array


def zero_order_hold(A: Array, B: Array, h: float) -> tuple[Array, Array]:
    """``x(t + h) = Ad x(t) + Bd u`` for ``x' = A x + B u`` with ``u`` constant over the step.

    Parameters
    ----------
    A: (n, n).  B: (n, m).  h: step, s.

    Compiled, see ``native/numerics/expm.c``: balancing by powers of two, a series, doublings.  The results have the
    same bits on each processor.  Where the step is far too long for the system, so that few digits would be right, no
    element of the result is a number.
    """
    Ad, Bd, _ = _discretise(A, B, h, False)
    return Ad, Bd


def first_order_hold(A: Array, B: Array, h: float) -> HeldStep:
    """As :func:`zero_order_hold`, of inputs that grow evenly over the step."""
    return HeldStep(*_discretise(A, B, h, True))


def prepare(A: Array, B: Array, ramp: bool = False) -> tuple[Discretisation, list[Array]]:
    """The work in C for ``x' = A x + B u``, and the arrays it points to: A, B, Ad, Bd, Rd by columns, and its room.

    The arrays have to be kept as long.  A host in C gives the step.
    """
    (n, m), library = B.shape, find_library()
    stride = max(-(-n // _LANES), 1) * _LANES
    sizes = n * stride, m * stride, n * stride, m * stride, m * stride * ramp, library.discretise_room(n)
    arrays = [allocate(size) for size in sizes]
    for array, given in zip(arrays, (A, B), strict=False):
        array.reshape(-1, stride)[:, :n] = given.T
    addresses = [find_address(array) if array.size else None for array in arrays]
    return Discretisation(n, m, stride, 0.0, *addresses, largest=np.inf), arrays


def _discretise(A: Array, B: Array, h: float, ramp: bool) -> tuple[Array, Array, Array]:
    work, arrays = prepare(A, B, ramp)
    work.step = h
    Ad, Bd, Rd = (array.reshape(-1, work.stride)[:, : len(A)].T for array in arrays[2:5])
    if find_library().discretise(byref(work), _ALL) != _DONE:
        for result in (Ad, Bd, Rd):
            result[:] = np.nan
    return np.ascontiguousarray(Ad), np.ascontiguousarray(Bd), np.ascontiguousarray(Rd)


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
