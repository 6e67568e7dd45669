"""From a 6x6 power spectral density to sums of spectral lines on a time grid, faded smoothly.

A wrench with the one-sided spectrum S is f(t) = Re sum_k L c_k exp(i w_k t), with lines 1/T apart, S = L L^T
and E(c_k c_k^H) = 2/T.  Its double integral without offset or drift is G: every line divided by -w_k^2.

The band is cut in two layers, so that no table is long: a slow one with finely spaced lines on a coarse grid,
and a fast one with lines 0.2 Hz apart on a fine grid.  0.1-1000 Hz with a period of 100 s need 9 MB; one grid
for all would need 48 MB or more, and half a second per block.

A disturbance is built as a second time derivative, f = d2/dt2 (w G).  Everything that is switched on or faded
is faded before it is differentiated: the integral of f over time is then (w G)', and returns to zero with w.

**The density that Gaussian noise has on average over time** is known exactly (:func:`gaussian_density`).  In the
spectrum of w g, with the window w of :func:`crossfade` and lines g at k / T, each line is as wide as that of w; f has
(2 pi f)^4 of it.  Lines are 1/T apart and the autocorrelation of w ends at T, so by Poisson's formula their sum is
flat.  Only at the edges of the band one sees how wide a line is: some 2/T.  There a free body has most of its motion.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import count
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..mechanism.quantities import Array, Complex
from ..mechanism.rotations import skew

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


@dataclass(frozen=True, eq=False)
class Inputs:
    """Independent inputs of a wrench: its one-sided spectrum at a frequency is L D L^T with D the densities there."""

    factor: Array
    """L (6, r)."""
    root: Callable[[Array], Array]
    """Frequencies (n,), Hz -> the square root of each density, (r, n), N/sqrt(Hz) or N.m/sqrt(Hz) where L is one."""

    @classmethod
    def of(cls, density: Array | Inputs) -> Inputs:
        """Those of a spectrum (6, 6) that is the same at all frequencies; what are inputs already stays."""
        if isinstance(density, Inputs):
            return density
        L = factor(density)
        return cls(L, lambda frequency: np.ones((L.shape[1], len(frequency))))


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
    overlap: both layers have lines from OVERLAP to SPLIT, to be weighted with :func:`share`; else they abut.  Their
        grids are a little finer where their points would be a number with prime factors above 5.
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
            points = round(rate * repeat)
            fitting = _find_points(points) if overlap else points
            found.append(Layer(key, rate if fitting == points else fitting / repeat, repeat, numbers))
    return found


def _find_points(least: int) -> int:
    """The next even number without prime factors above 5: blocks are made by transforms of parts of so many points."""
    for points in count(least + least % 2, 2):
        rest = points
        for factor in (2, 3, 5):
            while rest % factor == 0:
                rest //= factor
        if rest == 1:
            return points
    raise AssertionError


def share(layer: Layer) -> Array:
    """Amplitude of each line of an overlapping layer: the squares of slow and fast add up to one."""
    angle = 0.5 * np.pi * np.clip((layer.frequencies - OVERLAP) / (SPLIT - OVERLAP), 0.0, 1.0)
    return np.asarray(np.sin(angle) if layer.key else np.cos(angle))


def psd_at_origin(psd_com: Array, com: Array) -> Array:
    """Spectrum (6, 6) of a wrench at the origin from that at the point ``com`` (3,): torque + com x force."""
    move = to_origin(com)
    return np.asarray(move @ psd_com @ move.T)


def to_origin(com: Array) -> Array:
    """(6, 6): wrench at the point ``com`` (3,), m, to the same wrench at the origin."""
    move = np.eye(6)
    move[3:, :3] = skew(com)
    return move


_REACH = 12  # lines to either side of a frequency: further away a line has 1e-10 of its largest density
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(64)


def edge_frequencies(band: Array, period: float) -> Array:
    """Ascending frequencies (n,), Hz, above 0, over the edges of a band, as dense as :func:`gaussian_density` bends.

    Beyond the first and the last of them there is nothing.  Arguments as there.
    """
    found = layers(band, period, half=False, overlap=True)
    off = np.linspace(-_REACH, _REACH, 20 * _REACH + 1)
    at = [each.frequencies[end] + off / each.period for each, end in ((found[0], 0), (found[-1], -1))]
    joined = np.unique(np.concatenate(at))
    return np.asarray(joined[joined > 0.0])


def gaussian_density(
    band: Array, period: float, frequency: Array, root: Callable[[Array], Array] | None = None
) -> Array:
    """Density (n,) at ascending frequencies (n,), Hz, above 0, in parts of the flat density that is asked for.

    Parameters
    ----------
    band: (2,), edges, Hz.
    period: of the slow lines, s, as of :class:`.gaussian.GaussianNoise`.
    root: of densities that are not flat, see :class:`Inputs`; then the densities themselves, (r, n).
    """
    found = np.zeros(len(frequency))
    for layer in layers(band, period, half=False, overlap=True):
        wanted = share(layer) ** 2 if root is None else (share(layer) * root(layer.frequencies)) ** 2
        found = found + _layer_density(layer, frequency, wanted)
    return found


def _layer_density(layer: Layer, frequency: Array, wanted: Array) -> Array:
    """Of lines with the wanted densities (..., lines): (..., n)."""
    total = np.zeros((*wanted.shape[:-1], len(frequency)))
    lines = layer.frequencies
    nearest = np.rint(frequency * layer.period).astype(np.int64) - layer.numbers[0]
    for shift in range(-_REACH, _REACH + 1):
        place = nearest + shift
        there = np.flatnonzero((place >= 0) & (place < len(lines)))
        line = place[there]
        off = (frequency[there] - lines[line]) * layer.period
        total[..., there] += wanted[..., line] * _line_shape(off) * (frequency[there] / lines[line]) ** 4
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
