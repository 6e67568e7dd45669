"""RMS: what an isolator takes away of it, and where it lies in a spectrum; bands for logarithmic axes."""

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


def cumulative_rms(frequency: Array, psd: Array) -> Array:
    """RMS of what lies below each frequency, along the last axis of ``psd``.

    The bins of a Welch spectrum add up to the mean square of its windowed segments, so the sum is a plain
    one: ``sqrt(cumsum(psd) df)``.  Raises ``ValueError`` unless the frequencies are equally spaced.
    """
    spacing = np.diff(frequency)
    if len(frequency) < 2 or psd.shape[-1] != len(frequency):
        raise ValueError(f"psd of shape {psd.shape} does not fit {len(frequency)} frequencies")
    if not np.allclose(spacing, spacing[0], rtol=1e-6):
        raise ValueError("frequency: the values must be equally spaced")
    return np.sqrt(np.cumsum(psd, axis=-1) * spacing[0])


def log_bands(frequency: Array, psd: Array, *, per_decade: int = 100) -> tuple[Array, Array]:
    """Mean frequency and mean density in bands of equal ratio, for figures on logarithmic axes.

    Where a band holds no more than one frequency the spectrum is as it was.  Single lines of a multisine become a
    density when bands are wider than their distance.  ``frequency`` ascends; 0 Hz, which no such axis shows, is left
    out.  Returns (bands,) and, along the last axis of ``psd``, (..., bands).
    """
    positive = frequency > 0.0
    band = np.floor(per_decade * np.log10(frequency[positive]) + 1e-9)
    starts = np.flatnonzero(np.diff(band, prepend=-np.inf))
    counts = np.diff(starts, append=len(band))
    return (
        np.add.reduceat(frequency[positive], starts) / counts,
        np.add.reduceat(psd[..., positive], starts, axis=-1) / counts,
    )
