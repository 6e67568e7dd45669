"""Power spectral densities: cumulative RMS, and bands for figures on logarithmic axes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


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
