"""RMS: what an isolator takes away of it, and where it lies in a spectrum; bands of spectra; lines of a record."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

_LONGEST = 2**20  # rows of a segment that is transformed at once: 50 MB for six signals


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


def gather_lines(
    read: Callable[[NDArray[np.int64]], Array], count: int, step: float, edges: Array, *, repeats: bool = False
) -> tuple[Array, Complex]:
    """The spectrum of a record as lines: frequencies (n,), Hz, and mean squares (n, k, k), unit^2, Hermitian.

    All bins between two of the edges are one line, at the centre of their power, with their phases and correlations.
    By Welch's method with Hann windows over half of the record, so that a slow change makes no lines; of a record that
    repeats, over the whole without a window.  Segments have at most 2^20 rows.  The mean of a segment is left out, and
    what a window does not tell from it.

    Parameters
    ----------
    read: rows (m, k) of the record by their numbers (m,).
    count: rows of the record, 8 at least.
    step: s, between rows.
    edges: (m,), Hz, ascending, from 0 to half the rate of the rows.
    """
    whole = repeats and count <= _LONGEST
    length = count if whole else min(count // 2, _LONGEST)
    segments = 1 if whole else -(-2 * (count - length) // length) + 1  # that overlap by half
    window = np.ones(length) if whole else 0.5 - 0.5 * np.cos(2.0 * np.pi * np.arange(length) / length)
    lowest = 1 if whole else 2  # bins
    frequency = np.arange(length // 2 + 1) / (length * step)
    cell = np.clip(np.searchsorted(edges, frequency[lowest:], side="right"), 1, len(edges) - 1)
    begin = np.flatnonzero(np.diff(cell, prepend=-1))
    total = np.zeros((len(begin), *[read(np.arange(1)).shape[1]] * 2), dtype=complex)
    centre, power = np.zeros(len(begin)), np.zeros(len(begin))
    for start in np.linspace(0, count - length, segments).round().astype(int):
        rows = read(start + np.arange(length))
        found = np.fft.rfft((rows - rows.mean(axis=0)) * window[:, None], axis=0)[lowest:]
        found *= np.sqrt(2.0 / (length * np.sum(window**2) * segments))
        if length % 2 == 0:
            found[-1] *= np.sqrt(0.5)  # at half the rate of the rows there is one bin, not two
        squares = found.real**2 + found.imag**2
        products = [[np.add.reduceat(one * other.conj(), begin) for other in found.T] for one in found.T]
        total += np.moveaxis(np.array(products), 2, 0)
        size = (squares / np.maximum(squares.sum(axis=0), np.finfo(float).tiny)).sum(axis=1)  # N beside N.m
        centre += np.add.reduceat(size * frequency[lowest:], begin)
        power += np.add.reduceat(size, begin)
    there = power > 0.0
    return centre[there] / power[there], total[there]
