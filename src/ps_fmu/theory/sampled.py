"""What a communication step does to the transmissibility with the isolator, in closed form.

A step h costs the loop three half steps.  The isolator holds the acceleration over a step, and the plant the force:
each is a pure delay of h / 2.  The third is not: an acceleration at the end of a step is computed with the forces that
were held over it, which are half a step old on average, while its part from springs and dampers is up to date.  With
u = [f, w_b] the forces on fine legs and base, and N their direct effect on the base acceleration::

    a = s^2 q_b - (s h / 2) N u,    f = K_we exp(-s (tau + h)) a,    q_b = C f + D w_b

Where no spring is at work, well above the modes of the bus, all three together are a delay of 1.5 steps.  What is left
out is of second order in s h.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..mechanism.dynamics import Dynamics
from ..mechanism.quantities import Array, Complex
from .loop import Loop
from .transfer_matrices import Practical


def from_base_sampled(loop: Loop, s: ArrayLike, h: float) -> Complex:
    """Active transmissibility with a step of h, s: base motion (m, rad; B) to payload rotation (rad; P), (..., 3, 6).

    The passive one (:func:`.transmissibility.from_base`) does not depend on the step.
    """
    plant, s = Practical(loop.model.dynamics), np.asarray(s, dtype=complex)
    G_P, C = plant.G_P(s), plant.C(s)
    N_f, N_w = _direct(loop.model.dynamics)
    half = _column(0.5 * h * s)
    K = loop.controller.response(s) * _column(np.exp(-s * (loop.delay + h)))
    N_q = N_w @ np.linalg.inv(plant.D(s))  # by the wrench that makes the motion: w_b = D^-1 (q_b - C f)
    by_motion = _column(s * s) * np.eye(6) - half * N_q
    by_force = -half * (N_f - N_q @ C)
    F = np.linalg.solve(np.eye(3) - K @ by_force, K @ by_motion)  # base motion to force
    return np.asarray(loop.model.dynamics.pose.rotation_BP.T @ (G_P + (plant.A(s) - G_P @ C) @ F))


def loop_sampled(loop: Loop, s: ArrayLike, h: float) -> Complex:
    """L(s) with a step of h, s, (..., 6, 6), as measured with the loop open.

    From the acceleration of one base to that which the isolator's force makes on another: two holds of h / 2, and the
    direct effect of the force half a step late.
    """
    s = np.asarray(s, dtype=complex)
    N_f, _ = _direct(loop.model.dynamics)
    from_force = _column(s * s) * Practical(loop.model.dynamics).C(s) - _column(0.5 * h * s) * N_f
    return np.asarray(from_force @ loop.controller.response(s) * _column(np.exp(-s * (loop.delay + h))))


def _direct(dynamics: Dynamics) -> tuple[Array, Array]:
    """Base acceleration (6) from fine forces (6, 3) and base wrench (6, 6), before anything has moved."""
    d = dynamics
    on = np.flatnonzero(d.active)
    mobility = np.zeros((d.n, d.n))
    mobility[np.ix_(on, on)] = np.linalg.inv(d.M[np.ix_(on, on)])
    base = mobility[d.slices["q_b"]]
    return base[:, d.slices["d_f"]], base[:, d.slices["q_b"]]


def _column(values: NDArray[Any]) -> NDArray[Any]:
    return values[..., None, None]
