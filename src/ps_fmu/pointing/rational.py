"""Rational approximations of the weights of mean and relative error: for synthesis, not for a budget.

Filters of second order replace the exact weights where a transfer function is wanted (s = 2 pi i f T)::

    mean        2 (s + 6) / (s^2 + 6 s + 12)
    relative    s (s + sqrt(12)) / (s^2 + 6 s + 12)

They are off: the variance of the mean of white noise comes out a third too large, and a line with one cycle in the
window, whose mean is zero, keeps 14 % of its mean square.  :mod:`.indices` has the exact weights.  Filters of this form
are found in codes that follow the ESA pointing error engineering handbook, ESSB-HB-E-003 (2011).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


def approximate_mean_weight(frequency: ArrayLike, window: float) -> Array:
    """Rational approximation of the MPE's weight at frequencies, Hz, for a window, s."""
    s = 2j * np.pi * np.asarray(frequency, dtype=float) * window
    return np.asarray(np.abs(2.0 * (s + 6.0) / (s * s + 6.0 * s + 12.0)) ** 2)


def approximate_relative_weight(frequency: ArrayLike, window: float) -> Array:
    """Rational approximation of the RPE's weight (t uniform in the window) at frequencies, Hz, for a window, s."""
    s = 2j * np.pi * np.asarray(frequency, dtype=float) * window
    return np.asarray(np.abs(s * (s + math.sqrt(12.0)) / (s * s + 6.0 * s + 12.0)) ** 2)
