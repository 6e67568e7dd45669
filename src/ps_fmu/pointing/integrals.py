"""Integrals of a weight times a spectral density, with weights that oscillate much faster than the density changes."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
Weight = Callable[[Array], Array]

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(10)
_PLACES = 0.5 * (_NODES + 1.0)  # in a cell from 0 to 1
_BLOCK = 20_000  # cells at a time: some 2 MB an array
_RATIO = 1.3  # largest ratio of the ends of a cell for power laws and functions
_RELATIVE = 1e-12  # of the total: what halving all cells may still change
_MOST_CELLS = 500_000


def linear_quadrature(weight: Weight, frequency: Array, period: float) -> Array:
    """Coefficients (n,) with which samples (n,) of a density give the integral of weight times density.

    Exact, to rounding, for a density that is linear between its samples, however many periods the weight makes there.

    Parameters
    ----------
    weight: of the frequency, Hz; it oscillates with 1 / ``period``, Hz, at the fastest.
    frequency: (n,), Hz, ascending, n from 2 on.
    period: s.
    """
    lower, width = frequency[:-1], np.diff(frequency)
    first, second = np.zeros(len(width)), np.zeros(len(width))
    for interval, start, stop in _cells(lower, width, np.ceil(2.0 * period * width)):
        size = (stop - start) * width[interval]
        place = start[:, None] + (stop - start)[:, None] * _PLACES
        value = weight(lower[interval, None] + width[interval, None] * place) * (0.5 * _WEIGHTS)
        np.add.at(first, interval, size * (value * (1.0 - place)).sum(axis=1))
        np.add.at(second, interval, size * (value * place).sum(axis=1))
    return np.append(first, 0.0) + np.insert(second, 0, 0.0)


def bin_quadrature(weight: Weight, frequency: Array, period: float) -> Array:
    """Coefficients (n,) for a spectrum of bins: the mean of the weight over each bin, times the width of the bins.

    Each sample stands for ``frequency +- half a bin``, the first and the last too: with a weight of 1 the result is the
    plain sum that equals the mean square of what a Welch spectrum was made of.  Raises ``ValueError`` unless the
    frequencies are equally spaced.
    """
    spacing = np.diff(frequency)
    if not np.allclose(spacing, spacing[0], rtol=1e-6):
        raise ValueError("frequency: bins must be equally spaced")
    bin_ = float(spacing[0])
    found = np.zeros(len(frequency))
    whole = np.full(len(frequency), bin_)
    for interval, start, stop in _cells(frequency - 0.5 * bin_, whole, np.ceil(2.0 * period * whole)):
        place = start[:, None] + (stop - start)[:, None] * _PLACES
        # The weight is even, as the density is: the half of a bin below 0 Hz mirrors the half above.
        value = weight(frequency[interval, None] + bin_ * (place - 0.5))
        np.add.at(found, interval, (stop - start) * bin_ * (value @ (0.5 * _WEIGHTS)))
    return found


def power_law_integral(weight: Weight, frequency: Array, psd: Array, period: float) -> Array:
    """Integral over a density that is a power law between its samples, straight in a log-log plot.

    ``psd`` (n, ...), above 0, at ``frequency`` (n,), above 0; the result has the shape of the rest.
    """
    if frequency[0] <= 0.0 or (psd <= 0.0).any():
        raise ValueError("power law: frequencies and densities must be above 0")
    slope = np.diff(np.log(psd), axis=0) / np.diff(np.log(frequency)).reshape(-1, *[1] * (psd.ndim - 1))
    lower, width = frequency[:-1], np.diff(frequency)
    parts = np.maximum(np.ceil(2.0 * period * width), np.ceil(width / (lower * (_RATIO - 1.0))))
    total = np.zeros(psd.shape[1:])
    for interval, start, stop in _cells(lower, width, parts):
        place = start[:, None] + (stop - start)[:, None] * _PLACES
        at = lower[interval, None] + width[interval, None] * place
        factor = weight(at) * (0.5 * _WEIGHTS) * ((stop - start) * width[interval])[:, None]
        ratio = np.log(at / lower[interval, None])
        shape = (*at.shape, *[1] * (psd.ndim - 1))
        density = psd[interval, None] * np.exp(slope[interval, None] * ratio.reshape(shape))
        total += (factor.reshape(shape) * density).sum(axis=(0, 1))
    return total


def function_integral(
    weight: Weight, psd: Weight, band: tuple[float, float], period: float, points: Iterable[float] = ()
) -> float:
    """Integral of weight times density over a band, by Gauss-Legendre quadrature in ever smaller cells.

    Parameters
    ----------
    weight, period: as in :func:`linear_quadrature`.
    psd: density of an array of frequencies, Hz; it is not asked for at the ends of the band.
    band: lower and upper end, Hz; the upper one finite.
    points: frequencies, Hz, of narrow resonances and of steps; cells end there.

    All cells are halved until that changes the integral by less than 1e-12 of it.  Raises ``ValueError`` for a band
    that is not one, and for a density that is not integrable over it.
    """
    low, high = band
    if not (0.0 <= low < high and math.isfinite(high)):
        raise ValueError(f"band: expected 0 <= low < high, finite, got {band!r}")
    edges, before = _edges(low, high, period, points), math.nan
    while len(edges) < _MOST_CELLS:
        total = 0.0
        for first in range(0, len(edges) - 1, _BLOCK):
            start, width = edges[first : first + _BLOCK + 1][:-1, None], np.diff(edges[first : first + _BLOCK + 1])
            at = start + width[:, None] * _PLACES
            total += float((weight(at) * psd(at) @ (0.5 * _WEIGHTS)) @ width)
        if abs(total - before) <= _RELATIVE * abs(total):
            return total
        edges, before = np.sort(np.concatenate([edges, 0.5 * (edges[:-1] + edges[1:])])), total
    raise ValueError(f"psd: its weighted integral over {low:g} to {high:g} Hz does not converge")


def _edges(low: float, high: float, period: float, points: Iterable[float]) -> Array:
    """Ends of cells: within half a period of the weight, and in a ratio of 1.3 at most."""
    floor = max(low, 1e-3 * min(high, 1.0 / period if period > 0.0 else high))
    count = max(2, math.ceil(math.log(high / floor) / math.log(_RATIO)) + 1) if high > floor else 2
    edges = [np.array([low, high]), np.geomspace(floor, high, count), np.asarray(list(points), dtype=float)]
    if period > 0.0:
        edges.append(np.linspace(low, high, math.ceil(2.0 * period * (high - low)) + 1))
    joined = np.unique(np.concatenate(edges))
    return np.asarray(joined[(joined >= low) & (joined <= high)])


def _cells(lower: Array, width: Array, parts: ArrayLike) -> Iterable[tuple[NDArray[np.int64], Array, Array]]:
    """Blocks of (interval, start, stop): each interval cut into ``parts``; starts and stops as shares of it."""
    count = np.maximum(np.asarray(parts, dtype=np.int64), 1)
    ends = np.cumsum(count)
    for first in range(0, int(ends[-1]), _BLOCK):
        number = np.arange(first, min(first + _BLOCK, int(ends[-1])))
        interval = np.searchsorted(ends, number, side="right")
        within = number - (ends[interval] - count[interval])
        yield interval, within / count[interval], (within + 1) / count[interval]
