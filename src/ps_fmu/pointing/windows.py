"""What a window of time makes of a line: how much of its mean square is mean, how much linear trend, how much the rest.

A line of frequency f and mean square 1, its phase random, is averaged over a window of length T.  With u = pi f T, the
shares of its mean square are, j0 and j1 the spherical Bessel functions::

    mean            j0^2,       j0 = sin u / u
    linear trend    3 j1^2,     j1 = sin u / u^2 - cos u / u
    rest            1 - j0^2 - 3 j1^2

For N samples of step dt, T = N dt, the mean's share is [sin u / (N sin(u / N))]^2 and the trend's follows in the same
way.  These are the first terms of an expansion in Legendre polynomials (Gram's for samples).  Displacement, smear and
jitter in M. E. Pittelkau, W. G. McKinley, Optical transfer functions, weighting functions, and metrics for images
with two-dimensional line-of-sight motion, Opt. Eng. 55 (2016) 063108, doi 10.1117/1.OE.55.6.063108.  The difference
1 - j0^2: R. L. Lucke, S. W. Sirlin, A. M. San Martin, New definition of pointing stability: AC and DC effects,
J. Astronaut. Sci. 40 (1992) 557-576.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

# Below this u the shares come from a power series: 1 - j0^2 - 3 j1^2 falls with u^4 and would drown in rounding, which
# matters for spectra that rise as fast towards 0 Hz.  At 0.5 the difference still has 13 digits, the series 16.
SMALL_PHASE = 0.5
_TERMS = 7  # of the series of sine and cosine: the first left out is u^14 / 14!, 7e-16 at 0.5


class Shares(NamedTuple):
    """Shares of a line's mean square in a window; each between 0 and 1, together 1.  Arrays like the phase."""

    mean: Array
    trend: Array
    rest: Array


def window_shares(phase: ArrayLike, samples: int | None = None) -> Shares:
    """Shares of mean, linear trend and rest.

    Parameters
    ----------
    phase: u = pi f T, rad, of any shape; with samples up to N pi / 2, which is half the sampling rate.
    samples: N; None for a continuous window.
    """
    u = np.abs(np.asarray(phase, dtype=float))
    mean, trend, rest = np.empty(u.shape), np.empty(u.shape), np.empty(u.shape)
    small = u < SMALL_PHASE
    mean[small], trend[small], rest[small] = _series(u[small], samples)
    large = u[~small]
    cosine, sine = np.cos(large), np.sin(large)
    if samples is None:
        j0 = sine / large
        slope = (j0 - cosine) / large
    elif samples == 1:
        j0, slope = np.ones(large.shape), np.zeros(large.shape)
    else:
        v = large / samples
        j0 = sine / (samples * np.sin(v))
        slope = (j0 * np.cos(v) - cosine) / (np.sin(v) * math.sqrt(samples**2 - 1.0))
    mean[~small], trend[~small] = j0**2, 3.0 * slope**2
    # Two samples lie on a line: what the difference leaves of them is rounding.
    rest[~small] = 0.0 if samples in (1, 2) else np.maximum(1.0 - mean[~small] - trend[~small], 0.0)
    return Shares(mean, trend, rest)


def end_share(phase: ArrayLike, samples: int | None = None) -> Array:
    """Mean square of a line's value at the end of a window less its mean over it; between 0 and 1.59.

    ``|1 - (1 - e^(-ix)) / (ix)|^2`` with x = 2 u; with samples the end is the last of them.  Arguments as in
    :func:`window_shares`.
    """
    u = np.abs(np.asarray(phase, dtype=float))
    v = 0.0 if samples is None else u / samples
    with np.errstate(divide="ignore", invalid="ignore"):
        j0 = np.sin(u) / (u if samples is None else samples * np.sin(v))
    j0 = np.where(u == 0.0, 1.0, j0)
    return np.asarray((1.0 - j0 * np.cos(u - v)) ** 2 + (j0 * np.sin(u - v)) ** 2)


def count_samples(time: float, step: float, name: str) -> int:
    """Number of steps in a time, both in s; raises ``ValueError`` unless it is a whole number from 1 on.

    The step may be that of a record, see :func:`find_step`, and off by the rounding of its times.
    """
    if not (math.isfinite(step) and step > 0.0):
        raise ValueError(f"step: expected a time above 0 s, got {step!r}")
    ratio = time / step
    count = round(ratio) if math.isfinite(ratio) else 0
    if count < 1 or abs(ratio - count) > 1e-6 + 1e-9 * count:
        raise ValueError(f"{name}: {time!r} s is not a whole number of steps of {step!r} s")
    return count


def find_step(time: Array) -> float:
    """The step [s] of the times (rows,) of a record; raises ``ValueError`` unless they are equally spaced.

    Times of a file may be rounded: each may be a hundredth of a step off.
    """
    if len(time) < 2:
        raise ValueError(f"there are {len(time)} rows; two are needed")
    step = float(time[-1] - time[0]) / (len(time) - 1)
    if not step > 0.0:
        raise ValueError("the times do not ascend")
    off = np.abs(time - (time[0] + step * np.arange(len(time))))
    if not off.max() <= 0.01 * step:
        at = float(time[off.argmax()])
        raise ValueError(f"the rows are not equally spaced, as at {at:g} s: expected one each {step:g} s")
    return step


def triangle(lags: NDArray[np.int64], samples: int) -> Array:
    """Lag weights of the mean of N samples: (N - abs(m)) / N^2, zero from N on."""
    return np.asarray(np.maximum(samples - np.abs(lags), 0) / samples**2)


def trend_lags(lags: NDArray[np.int64], samples: int) -> Array:
    """Lag weights of the RMS of the linear trend over N samples: sum_k c_k c_{k+m} / (N sum_k c_k^2), c_k centred."""
    if samples == 1:
        return np.zeros(lags.shape)
    m = np.abs(lags).astype(float)
    left = np.maximum(samples - m, 0.0)
    products = left * (left**2 - 1.0) / 12.0 - left * m**2 / 4.0
    return np.asarray(products / (samples**2 * (samples**2 - 1.0) / 12.0))


def _series(u: Array, samples: int | None) -> tuple[Array, Array, Array]:
    """Shares by power series: regress cos(u v) and sin(u v) on 1 and v over the places v of the window."""
    moment = _even_moments(samples)
    order = np.arange(_TERMS)
    sign = (-1.0) ** order
    cosine = np.array([math.factorial(2 * k) for k in order], dtype=float)
    sine = np.array([math.factorial(2 * k + 1) for k in order], dtype=float)
    even = (sign / cosine)[:, None] * u ** (2 * order[:, None])
    odd = (sign / sine)[:, None] * u ** (2 * order[:, None] + 1)
    mean = (moment[:_TERMS] @ even) ** 2
    if samples == 1:
        return mean, np.zeros(u.shape), np.zeros(u.shape)
    to_trend = moment[1 : _TERMS + 1] / moment[1]
    trend = moment[1] * (to_trend @ odd) ** 2
    sums = order[:, None] + order[None, :]
    even_rest = moment[sums] - np.outer(moment[:_TERMS], moment[:_TERMS])
    odd_rest = moment[sums + 1] - moment[1] * np.outer(to_trend, to_trend)
    rest = np.einsum("in,ij,jn->n", even[1:], even_rest[1:, 1:], even[1:])
    rest += np.einsum("in,ij,jn->n", odd[1:], odd_rest[1:, 1:], odd[1:])
    return mean, trend, np.zeros(u.shape) if samples == 2 else np.maximum(rest, 0.0)


@lru_cache(maxsize=64)  # 1e6 samples take 20 ms, and an integral asks a hundred times
def _even_moments(samples: int | None) -> Array:
    """Means of v^0, v^2, v^4, ... over the window, v from -1 to 1; (2 _TERMS,)."""
    if samples is None:
        return np.asarray(1.0 / (2.0 * np.arange(2 * _TERMS) + 1.0))
    squares = ((2.0 * np.arange(samples) - (samples - 1.0)) / samples) ** 2
    power = np.ones(samples)
    moments = []
    for _ in range(2 * _TERMS):
        moments.append(float(power.mean()))
        power *= squares
    return np.array(moments)
