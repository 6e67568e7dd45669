"""Smooth steps and cross-fades, with the two derivatives that a disturbance needs.

A disturbance is built as a second time derivative, f = d2/dt2 (w G).  Everything that is switched on or faded
is faded before it is differentiated: the integral of f over time is then (w G)', and returns to zero with w.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..mechanism.quantities import Array

# Coefficients of x^9 .. x^0: the polynomial from 0 to 1 with four vanishing derivatives at both ends.
_STEP = np.array([70.0, -315.0, 540.0, -420.0, 126.0, 0.0, 0.0, 0.0, 0.0, 0.0])
_STEP_1 = np.polyder(_STEP)
_STEP_2 = np.polyder(_STEP, 2)


class Weight(NamedTuple):
    """A weight over time with its first and second derivative (1, 1/s, 1/s2), equal shapes (n,)."""

    value: Array
    rate: Array
    curvature: Array

    def times(self, other: Weight) -> Weight:
        """Product of two weights (Leibniz)."""
        return Weight(
            self.value * other.value,
            self.rate * other.value + self.value * other.rate,
            self.curvature * other.value + 2.0 * self.rate * other.rate + self.value * other.curvature,
        )

    def second_derivative(self, g: Array, g_1: Array, g_2: Array) -> Array:
        """d2/dt2 of weight times g, from g and its derivatives of shape (n, m)."""
        return np.asarray(
            self.value[:, None] * g_2 + 2.0 * self.rate[:, None] * g_1 + self.curvature[:, None] * g
        )


def ramp(time: Array, rise_time: float) -> Weight:
    """From 0 at t <= 0 to 1 at t >= rise_time, four times continuously differentiable; time (n,) in s."""
    if time.size and time.min() >= rise_time:  # the polynomials give the same, in 25 us for 256 times
        return Weight(np.ones(time.shape), np.zeros(time.shape), np.zeros(time.shape))
    x = np.clip(time / rise_time, 0.0, 1.0)
    steps = (_STEP, _STEP_1, _STEP_2)
    value, rate, curvature = (np.asarray(np.polyval(step, x), dtype=np.float64) for step in steps)
    return Weight(value, rate / rise_time, curvature / rise_time**2)


def crossfade(time: Array, hop: float) -> Weight:
    """The window w of a block that lives on 0 <= t <= 2 hop, with w(t)^2 + w(t + hop)^2 = 1 on 0 <= t <= hop.

    Independent blocks at a distance of one hop then add up to a process of constant power.
    """
    up = ramp(hop - np.abs(time - hop), hop)
    direction = np.where(time <= hop, 1.0, -1.0)
    angle = Weight(*(0.5 * np.pi * part for part in (up.value, direction * up.rate, up.curvature)))
    sine, cosine = np.sin(angle.value), np.cos(angle.value)
    return Weight(sine, cosine * angle.rate, cosine * angle.curvature - sine * angle.rate**2)
