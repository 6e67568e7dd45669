"""The density that Gaussian noise has on average over time, exactly, over the density it is asked for.

A block of :class:`.gaussian.GaussianNoise` is f = d2/dt2 (w g) with the window w of :func:`.smooth.crossfade` and
lines g at k / T.  In the spectrum of w g each line is as wide as that of w; f has (2 pi f)^4 of it.  Lines are 1/T
apart and the autocorrelation of w ends at T, so by Poisson's formula their sum is flat.  Only at the edges of the band
one sees how wide a line is: some 2/T.  There a free body has most of its motion.
"""

from __future__ import annotations

import numpy as np

from ..mechanism.quantities import Array
from .smooth import crossfade
from .spectrum import Layer, layers, share

_REACH = 12  # lines to either side of a frequency: further away a line has 1e-10 of its largest density
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(64)


def gaussian_density(band: Array, period: float, frequency: Array) -> Array:
    """Density (n,) at ascending frequencies (n,), Hz, above 0, in parts of the flat density that is asked for.

    Parameters
    ----------
    band: (2,), edges, Hz.
    period: of the slow lines, s, as of :class:`.gaussian.GaussianNoise`.
    """
    found = np.zeros(len(frequency))
    for layer in layers(band, period, half=False, overlap=True):
        found += _layer_density(layer, frequency)
    return found


def _layer_density(layer: Layer, frequency: Array) -> Array:
    total = np.zeros(len(frequency))
    lines, shares = layer.frequencies, share(layer) ** 2
    nearest = np.rint(frequency * layer.period).astype(np.int64) - layer.numbers[0]
    for shift in range(-_REACH, _REACH + 1):
        place = nearest + shift
        there = np.flatnonzero((place >= 0) & (place < len(lines)))
        line = place[there]
        off = (frequency[there] - lines[line]) * layer.period
        total[there] += shares[line] * _line_shape(off) * (frequency[there] / lines[line]) ** 4
    return total


def _line_shape(off: Array) -> Array:
    """Density of a line, in parts of that asked for, at ``off`` (n,) line spacings from it.

    The square of w's Fourier transform, 2/T^2 of it: a line has the mean square 1/T of a density of one, and a block
    begins every T/2.
    """
    time = 0.5 * (_NODES + 1.0) * 0.5  # s, from 0 to the middle of a block of 1 s
    window = crossfade(time, 0.5).value
    transform = 0.5 * np.cos(2.0 * np.pi * off[:, None] * (0.5 - time)) @ (_WEIGHTS * window)
    return np.asarray(2.0 * transform**2)
