"""What an isolator takes away of the jitter."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


def rejection_percent(rms_passive: ArrayLike, rms_active: ArrayLike) -> Array:
    """``100 (1 - rms_active / rms_passive)`` per axis, as in Table 2 of the paper.

    Negative where the isolator amplifies; NaN where nothing moved without it.  Raises ``ValueError`` for
    shapes that differ and for an RMS below zero.
    """
    passive, active = np.asarray(rms_passive, dtype=float), np.asarray(rms_active, dtype=float)
    if passive.shape != active.shape:
        raise ValueError(f"rms_passive and rms_active differ in shape: {passive.shape} and {active.shape}")
    if (passive < 0.0).any() or (active < 0.0).any():
        raise ValueError(f"an RMS cannot be negative: {passive.tolist()}, {active.tolist()}")
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(passive > 0.0, 100.0 * (1.0 - active / passive), np.nan)
