"""From a 6x6 power spectral density to sums of spectral lines on a time grid.

A wrench with the one-sided spectrum S is f(t) = Re sum_k L c_k exp(i w_k t), with lines 1/T apart, S = L L^T
and E(c_k c_k^H) = 2/T.  Its double integral without offset or drift is G: every line divided by -w_k^2.

The band is cut in two layers, so that no table is long: a slow one with finely spaced lines on a coarse grid,
and a fast one with lines 0.2 Hz apart on a fine grid.  0.1-1000 Hz with a period of 100 s need 9 MB; one grid
for all would need 48 MB or more, and half a second per block.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..mechanism.quantities import Array, Complex
from ..mechanism.rotations import skew

SPLIT = 20.0  # Hz, between the layers
OVERLAP = 15.0  # Hz, where a gradual change from the slow to the fast layer begins
SLOW_RATE = 400.0  # Hz, 20 times the highest slow frequency: interpolation error 5e-6
FAST_RATE = 10_000.0  # Hz, the grid of the usual communication step of 1e-4 s
FAST_PERIOD = 5.0  # s
HIGHEST = 0.4 * FAST_RATE  # Hz


def factor(psd: Array) -> Array:
    """L (6, r) with L L^T = psd (6, 6), from its eigenvalues; r counts those above 1e-9 of the largest.

    A Cholesky factor does not exist: an identified spectrum has eigenvalues at and just below zero.  Eigenvectors have
    no sign of their own: the largest component is made positive, so that a seed means the same noise with any LAPACK.
    """
    eigenvalues, vectors = np.linalg.eigh(psd)
    largest = np.take_along_axis(vectors, np.abs(vectors).argmax(axis=0)[None, :], axis=0)
    vectors = vectors * np.sign(largest)
    keep = eigenvalues > 1e-9 * max(eigenvalues[-1], 0.0)
    return np.asarray(vectors[:, keep] * np.sqrt(eigenvalues[keep]))


@dataclass(frozen=True)
class Layer:
    """Lines at numbers / period (Hz), to be sampled at a rate (Hz) over one period (s)."""

    key: int  # tells the random numbers of the layers apart
    rate: float
    period: float
    numbers: NDArray[np.int64]

    @property
    def frequencies(self) -> Array:
        """Frequencies of the lines, Hz."""
        return np.asarray(self.numbers / self.period)

    @property
    def points(self) -> int:
        """Grid points per period."""
        return round(self.rate * self.period)

    def sample(self, lines: Complex, integrals: int = 0) -> Array:
        """Re sum_k lines[:, k] exp(i w_k t) on the grid, so many times integrated; (points, m) for lines (m, k)."""
        spectrum = np.zeros((len(lines), self.points // 2 + 1), dtype=np.complex128)
        spectrum[:, self.numbers] = lines * (0.5 * self.points / (2j * np.pi * self.frequencies) ** integrals)
        return np.ascontiguousarray(np.fft.irfft(spectrum, self.points, axis=1).T)


def layers(band: Array, period: float, *, half: bool, overlap: bool) -> list[Layer]:
    """The slow and the fast layer of a band; an empty one is left out.

    Parameters
    ----------
    band: lower and upper edge, Hz.
    period: slow lines are 1/period apart, s; rounded to the grid of the slow layer, where layers
        overlap to an even number of points.
    half: lines at (k + 1/2)/period, so that the sum repeats after two periods; else at k/period.
    overlap: both layers have lines from OVERLAP to SPLIT, to be weighted with :func:`share`; else they abut.
    """
    lower, upper = float(band[0]), float(band[1])
    grid = (2.0 if overlap else 1.0) / SLOW_RATE  # blocks begin half a period apart, on a grid point
    slow_period = round(period / grid) * grid
    cuts = (
        (SLOW_RATE, slow_period, lower, min(upper, SPLIT)),
        (FAST_RATE, FAST_PERIOD, max(lower, OVERLAP if overlap else SPLIT), upper),
    )
    found = []
    for key, (rate, distance, f_min, f_max) in enumerate(cuts):
        repeat = 2.0 * distance if half else distance
        first, end = (int(np.ceil(f * repeat - 1e-9)) for f in (f_min, f_max))
        numbers = np.arange(max(first, 1), end, dtype=np.int64)
        numbers = numbers[numbers % 2 == 1] if half else numbers
        if numbers.size:
            found.append(Layer(key, rate, repeat, numbers))
    return found


def share(layer: Layer) -> Array:
    """Amplitude of each line of an overlapping layer: the squares of slow and fast add up to one."""
    angle = 0.5 * np.pi * np.clip((layer.frequencies - OVERLAP) / (SPLIT - OVERLAP), 0.0, 1.0)
    return np.asarray(np.cos(angle) if layer.rate == SLOW_RATE else np.sin(angle))


def psd_at_origin(psd_com: Array, com: Array) -> Array:
    """Spectrum (6, 6) of a wrench at the origin from that at the point ``com`` (3,): torque + com x force."""
    move = to_origin(com)
    return np.asarray(move @ psd_com @ move.T)


def to_origin(com: Array) -> Array:
    """(6, 6): wrench at the point ``com`` (3,), m, to the same wrench at the origin."""
    move = np.eye(6)
    move[3:, :3] = skew(com)
    return move
