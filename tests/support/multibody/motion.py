"""The multibody prototype over time: its nonlinear equations of motion, integrated with small error."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ps_fmu.mechanism.dynamics import Pose
from support.multibody.linear import BASE, COARSE, FINE
from support.multibody.multibody import Prototype

Array = NDArray[np.float64]

# The integrator's state: base position and quaternion, leg lengths (fine, coarse), independent velocities.
POSITION, QUATERNION, LENGTHS, RATES = slice(0, 3), slice(3, 7), slice(7, 13), slice(13, 25)


@dataclass(frozen=True, eq=False)
class Motion:
    """What happened; the first axis is time."""

    time: Array  # (n,) s
    q: Array  # (n, nq) configurations of the prototype
    v: Array  # (n, nv) velocities


def simulate(prototype: Prototype, pose: Pose, rates: Array, time: Array, tolerance: float = 1e-10) -> Motion:
    """Free motion from a pose of the platform in the base, the coarse legs locked.

    Parameters
    ----------
    rates: (12,) independent velocities at the start, in the order of :class:`.linear.LinearModel`.
    time: (n,) s, ascending from 0, when the motion is wanted.
    tolerance: relative, of the integrator; absolute likewise, in m, rad, m/s and rad/s.

    Raises
    ------
    RuntimeError: the integrator gave up; the text says why.
    """
    from scipy.integrate import solve_ivp

    near = prototype.configuration(pose)

    def configuration(y: Array) -> Array:
        nonlocal near  # where Newton's iteration begins
        near = prototype.with_independent_motion(near, y[POSITION], y[QUATERNION], y[LENGTHS])
        return near

    def derivative(t: float, y: Array) -> Array:
        q, w = configuration(y), y[RATES]
        v = prototype.possible_motions(q) @ w
        base_rotation, _ = prototype.rotations(q)
        forward, turn = w[BASE][:3], w[BASE][3:]  # m/s, rad/s; axes of B
        vector, scalar = y[QUATERNION][:3], y[QUATERNION][3]
        rates = [
            base_rotation @ forward,
            0.5 * (scalar * turn + np.cross(vector, turn)),
            [-0.5 * vector @ turn],
            w[FINE],
            w[COARSE],
            prototype.accelerations(q, v, np.zeros(3), np.zeros(3)),
        ]
        return np.concatenate(rates)

    start = np.concatenate([*prototype.independent_motion(near), rates])
    span = (float(time[0]), float(time[-1]))
    found = solve_ivp(derivative, span, start, method="DOP853", t_eval=time, rtol=tolerance, atol=tolerance)
    if not found.success:
        raise RuntimeError(f"the multibody prototype could not be integrated: {found.message}")
    q = np.array([configuration(y) for y in found.y.T])
    v = np.array([prototype.possible_motions(at) @ y[RATES] for at, y in zip(q, found.y.T, strict=True)])
    return Motion(found.t, q, v)
