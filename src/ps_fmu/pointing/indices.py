"""The pointing error indices: absolute, mean, relative, drift and reproducibility error, smear, residual jitter.

Terms, definitions and clauses of ECSS-E-ST-60-10C (15 November 2008); displacement, smear and jitter of Pittelkau and
McKinley (see :mod:`.windows`).  An index is an object; it is applied to a spectrum, to lines, to a record, or to a
linear process (:mod:`.linear_process`)::

    RelativeError(window=1.0, at="uniform").rms(frequency, psd)

Spectra are one-sided densities S(f) of a stationary error without its mean, in unit^2/Hz.  A bias is not in them: its
square adds to the mean square of the absolute and the mean error, and to no other index (``keeps_bias``).

With ``step``, s, an index is that of sampled data: a window is N = window / step samples, and the spectrum is that of
the samples, from 0 Hz to half the sampling rate.  Without, time is continuous.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .integrals import bin_quadrature, function_integral, linear_quadrature, power_law_integral
from .records import Estimate, estimate, split
from .windows import count_samples, end_share, trend_lags, triangle, window_shares

Array = NDArray[np.float64]
Lags = NDArray[np.int64]
Interpolation = Literal["linear", "power law", "bins"]


class PointingIndex(ABC):
    """One aspect of how an error varies with time, as a linear operation on the error in a window."""

    symbol: ClassVar[str]
    """Short name, as in ECSS-E-ST-60-10C where it has one."""
    keeps_bias: ClassVar[bool] = False
    """Whether a constant error remains; if not, the index of a constant is zero."""

    @property
    @abstractmethod
    def span(self) -> float:
        """Time from the first to the last sample that the index needs, s; its weight has no faster period in f."""

    @abstractmethod
    def _weight(self, frequency: Array, step: float | None) -> Array:
        """Weight at frequencies that are fit for the step."""

    @abstractmethod
    def lag_weights(self, lags: Lags, step: float) -> Array:
        """q (n,) at ``lags`` m (n,), steps, so that the mean square is the sum over all m of q_m R_m.

        R_m is the autocovariance of the samples.  q is even in m, and zero beyond :meth:`count`.
        """

    @abstractmethod
    def _evaluate(self, windows: Array, step: float) -> Array:
        """Values (windows, r, signals) of the index in windows (windows, count, signals)."""

    def count(self, step: float) -> int:
        """Samples that one value of the index needs, for a step, s; ``ValueError`` unless times are whole steps."""
        return count_samples(self.span, step, "window")

    def weight(self, frequency: ArrayLike, step: float | None = None) -> Array:
        """W(f), between 0 and 4, at frequencies, Hz, of any shape: the index's mean square of a line of mean square 1.

        Raises ``ValueError`` for frequencies below 0 Hz, for those above half the sampling rate 1 / ``step``, and for
        a window that is not a whole number of steps.
        """
        frequency = np.asarray(frequency, dtype=float)
        if not (frequency >= 0.0).all():
            raise ValueError("frequency: expected 0 Hz and above")
        if step is not None and frequency.size and float(frequency.max()) > 0.5 / step * (1.0 + 1e-9):
            raise ValueError(f"frequency: {float(frequency.max()):g} Hz is above half the rate of steps of {step:g} s")
        return self._weight(frequency, step)

    def quadrature(
        self, frequency: ArrayLike, *, step: float | None = None, interpolation: Interpolation = "linear"
    ) -> Array:
        """Coefficients (n,), Hz: the variance is their sum with the samples of a density at ``frequency`` (n,), Hz.

        ``linear``: exact, to rounding, for a density that is linear between its samples, even where the weight
        oscillates many times between them.  ``bins``: each sample is the mean over a bin around it, as in a Welch
        spectrum; frequencies are equally spaced from 0 Hz on, and APE is the plain sum.  Nothing outside the given
        frequencies counts.
        """
        frequency = np.asarray(frequency, dtype=float)
        if frequency.ndim != 1 or len(frequency) < 2 or not (np.diff(frequency) > 0.0).all():
            raise ValueError("frequency: expected two or more ascending values")
        self.weight(frequency, step)  # refuses what does not fit before anything is integrated
        if interpolation == "bins":
            return bin_quadrature(lambda f: self._weight(_fold(f, step), step), frequency, self.span)
        if interpolation == "linear":
            return linear_quadrature(lambda f: self._weight(f, step), frequency, self.span)
        raise ValueError(f"interpolation: expected 'linear' or 'bins', got {interpolation!r}")

    def variance(
        self,
        frequency: ArrayLike,
        psd: ArrayLike,
        *,
        step: float | None = None,
        interpolation: Interpolation = "linear",
        axis: int = 0,
    ) -> Array:
        """Variance from samples of a one-sided density: the integral of W S over the given frequencies.

        Parameters
        ----------
        frequency: (n,), Hz, ascending.
        psd: unit^2/Hz with n values along ``axis``: (n,) for one signal, (n, k) for more, (n, k, k) for the real part
            of a spectral density matrix, which gives the covariance (k, k).
        interpolation: what the density is between its samples: ``linear`` or ``bins``, see :meth:`quadrature`, or
            ``power law``, straight in a log-log plot, for which frequencies and densities are above 0.

        Returns the variance in unit^2, in the shape of ``psd`` without ``axis``.
        """
        frequency, psd = np.asarray(frequency, dtype=float), np.moveaxis(np.asarray(psd, dtype=float), axis, 0)
        if psd.shape[:1] != frequency.shape:
            raise ValueError(f"psd: {psd.shape[0]} values along axis {axis} for frequencies of shape {frequency.shape}")
        if interpolation == "power law":
            self.weight(frequency, step)
            return power_law_integral(lambda f: self._weight(f, step), frequency, psd, self.span)
        coefficients = self.quadrature(frequency, step=step, interpolation=interpolation)
        return np.asarray(np.tensordot(coefficients, psd, axes=1))

    def rms(
        self,
        frequency: ArrayLike,
        psd: ArrayLike,
        *,
        step: float | None = None,
        interpolation: Interpolation = "linear",
        axis: int = 0,
    ) -> Array:
        """Root of :meth:`variance`, for densities of signals (not matrices)."""
        return np.sqrt(self.variance(frequency, psd, step=step, interpolation=interpolation, axis=axis))

    def variance_of_function(
        self,
        psd: Callable[[Array], Array],
        band: tuple[float, float],
        *,
        step: float | None = None,
        points: Iterable[float] = (),
    ) -> float:
        """Variance from a density given as a function of the frequency, Hz, over a finite band (low, high), Hz.

        Adaptive, to 1e-12 of the result.  ``points`` are frequencies of narrow resonances and steps.  Densities that
        grow towards 0 Hz are fine where the weight falls faster: ``band=(0.0, high)`` of 1/f^2 for the relative error.
        """
        if step is not None:
            self.weight(band[1], step)
        return function_integral(lambda f: self._weight(f, step), psd, band, self.span, points)

    def variance_of_lines(self, frequency: ArrayLike, amplitude: ArrayLike, *, step: float | None = None) -> Array:
        """Variance from lines (n,), Hz, of amplitude (n,) or (n, k), unit, real or complex; shape () or (k,), unit^2.

        Phases are random or frequencies differ, so that mean squares, half the squares of the amplitudes, add up.
        """
        return np.asarray(np.tensordot(self.weight(frequency, step), 0.5 * np.abs(np.asarray(amplitude)) ** 2, axes=1))

    def values(self, record: ArrayLike, step: float, *, stride: int | None = None) -> Array:
        """The index in each window of a record, (windows, r, signals), with its sign.

        Parameters
        ----------
        record: (n,) or (n, signals), samples ``step`` s apart.
        stride: samples between the starts of windows: 1 slides by each sample; None puts windows side by side.

        r is 1 where a window has one value, and the samples of the window where it has one for each time t in it (RPE
        with t uniform, residual jitter).  Raises ``ValueError`` if the record is shorter than one window.
        """
        parts = split(record, self.count(step), self._stride(step, stride))
        return np.concatenate([self._evaluate(windows, step) for windows in parts])

    def of_record(self, record: ArrayLike, step: float, *, stride: int | None = None) -> Estimate:
        """Bias, covariance and peak of the index over the windows of a record; arguments as in :meth:`values`."""
        parts = split(record, self.count(step), self._stride(step, stride))
        return estimate(self._evaluate(windows, step) for windows in parts)

    def _stride(self, step: float, stride: int | None) -> int:
        return self.count(step) if stride is None else stride


@dataclass(frozen=True)
class AbsoluteError(PointingIndex):
    """APE, absolute performance error: e(t).  ECSS-E-ST-60-10C, 3.2.2.  W = 1."""

    symbol: ClassVar[str] = "APE"
    keeps_bias: ClassVar[bool] = True

    @property
    def span(self) -> float:
        """0 s: one sample."""
        return 0.0

    def count(self, step: float) -> int:
        """One sample."""
        return 1

    def _weight(self, frequency: Array, step: float | None) -> Array:
        return np.ones(frequency.shape)

    def lag_weights(self, lags: Lags, step: float) -> Array:
        """1 at lag 0."""
        return np.where(lags == 0, 1.0, 0.0)

    def _evaluate(self, windows: Array, step: float) -> Array:
        return windows


@dataclass(frozen=True)
class _WindowIndex(PointingIndex):
    window: float
    """Length of the window, s."""

    def __post_init__(self) -> None:
        _check_time(self.window, "window")

    @property
    def span(self) -> float:
        """The window, s."""
        return self.window

    def _phase(self, frequency: Array, step: float | None) -> tuple[Array, int | None]:
        """u = pi f T, rad, and the samples of the window."""
        if step is None:
            return np.pi * frequency * self.window, None
        samples = count_samples(self.window, step, "window")
        return np.pi * frequency * (samples * step), samples


@dataclass(frozen=True)
class MeanError(_WindowIndex):
    """MPE, mean performance error: the mean of e over a window.  ECSS-E-ST-60-10C, 3.2.7.  W = j0^2.

    The displacement of an image exposed over the window.
    """

    symbol: ClassVar[str] = "MPE"
    keeps_bias: ClassVar[bool] = True

    def _weight(self, frequency: Array, step: float | None) -> Array:
        return window_shares(*self._phase(frequency, step)).mean

    def lag_weights(self, lags: Lags, step: float) -> Array:
        """(N - abs(m)) / N^2."""
        return triangle(lags, self.count(step))

    def _evaluate(self, windows: Array, step: float) -> Array:
        return np.asarray(windows.mean(axis=1, keepdims=True))


@dataclass(frozen=True)
class RelativeError(_WindowIndex):
    """RPE, relative performance error: e(t) less the mean of e over a window that t lies in.  ECSS-E-ST-60-10C, 3.2.12.

    The standard leaves open where t lies and names two choices (3.2.12, note 2), so ``at`` has no default:

    ``uniform``: t is random in the window.  W = 1 - j0^2, and APE^2 = MPE^2 + RPE^2 in the mean square.
    ``end``: t is the window's end.  W = |1 - (1 - e^(-ix)) / (ix)|^2, x = 2 pi f T.  For errors that are slow against
    the window this is 3 times the variance of ``uniform``, for fast ones the same.
    """

    at: Literal["uniform", "end"]
    """Where t lies in the window."""

    symbol: ClassVar[str] = "RPE"

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.at not in ("uniform", "end"):
            raise ValueError(f"at: expected 'uniform' or 'end', got {self.at!r}")

    def _weight(self, frequency: Array, step: float | None) -> Array:
        phase = self._phase(frequency, step)
        if self.at == "end":
            return end_share(*phase)
        shares = window_shares(*phase)
        return shares.trend + shares.rest

    def lag_weights(self, lags: Lags, step: float) -> Array:
        """``uniform``: 1 at lag 0, less those of the mean; ``end``: less 1/N at all lags but 0, and 2/N at 0."""
        samples = self.count(step)
        mean = triangle(lags, samples)
        at_zero = np.where(lags == 0, 1.0, 0.0)
        if self.at == "uniform":
            return at_zero - mean
        return at_zero + mean - np.where(np.abs(lags) < samples, np.where(lags == 0, 2.0, 1.0) / samples, 0.0)

    def _evaluate(self, windows: Array, step: float) -> Array:
        deviation = windows - windows.mean(axis=1, keepdims=True)
        return deviation if self.at == "uniform" else deviation[:, -1:]


@dataclass(frozen=True)
class DriftError(_WindowIndex):
    """PDE, performance drift error: the mean over a window less that over an earlier one.  ECSS-E-ST-60-10C, 3.2.8.

    Both windows have the same length and lie in one observation.  W = 4 sin^2(pi f D) j0^2.
    """

    separation: float
    """D, from the start of one window to the start of the other, s."""

    symbol: ClassVar[str] = "PDE"

    def __post_init__(self) -> None:
        super().__post_init__()
        _check_time(self.separation, "separation")

    @property
    def span(self) -> float:
        """From the start of the first to the end of the second window, s."""
        return self.window + self.separation

    def count(self, step: float) -> int:
        """Samples of the window and of the separation."""
        return count_samples(self.window, step, "window") + count_samples(self.separation, step, "separation")

    def _weight(self, frequency: Array, step: float | None) -> Array:
        if step is not None:
            count_samples(self.separation, step, "separation")
        mean = window_shares(*self._phase(frequency, step)).mean
        return np.asarray(4.0 * np.sin(np.pi * frequency * self.separation) ** 2 * mean)

    def lag_weights(self, lags: Lags, step: float) -> Array:
        """Twice those of the mean, less those of the mean moved by +-D."""
        samples = count_samples(self.window, step, "window")
        moved = self.count(step) - samples
        apart = triangle(lags - moved, samples) + triangle(lags + moved, samples)
        return np.asarray(2.0 * triangle(lags, samples) - apart)

    def _evaluate(self, windows: Array, step: float) -> Array:
        samples = count_samples(self.window, step, "window")
        later, earlier = windows[:, -samples:], windows[:, :samples]
        return np.asarray(later.mean(axis=1, keepdims=True) - earlier.mean(axis=1, keepdims=True))


@dataclass(frozen=True)
class ReproducibilityError(DriftError):
    """PRE, performance reproducibility error: as PDE, the windows in different observations.  ECSS-E-ST-60-10C, 3.2.10.

    The definitions are identical (3.2.10, note 5).  What a calibration between the observations resets is not in the
    spectrum that belongs here; a bias that changes between them adds twice its variance (annex B, Table B-2).
    """

    symbol: ClassVar[str] = "PRE"


@dataclass(frozen=True)
class Smear(_WindowIndex):
    """Linear trend of e over a window, as its RMS there: the slope times T / sqrt(12).  W = 3 j1^2.

    The smear length, slope times T, is sqrt(12) times it.  Pittelkau and McKinley.
    """

    symbol: ClassVar[str] = "smear"

    @property
    def length(self) -> float:
        """Smear length over RMS: sqrt(12)."""
        return math.sqrt(12.0)

    def _weight(self, frequency: Array, step: float | None) -> Array:
        return window_shares(*self._phase(frequency, step)).trend

    def lag_weights(self, lags: Lags, step: float) -> Array:
        """A cubic in the lag, from the autocorrelation of the centred ramp."""
        return trend_lags(lags, self.count(step))

    def _evaluate(self, windows: Array, step: float) -> Array:
        samples = windows.shape[1]
        return np.asarray(np.einsum("t,wts->ws", _ramp(samples), windows)[:, None] / math.sqrt(samples))


@dataclass(frozen=True)
class ResidualJitter(_WindowIndex):
    """What is left of e in a window without its mean and linear trend, t random.  W = 1 - j0^2 - 3 j1^2.

    The jitter that blurs an image exposed over the window.  Its mean square divides by the length of the window.
    Pittelkau and McKinley.
    """

    symbol: ClassVar[str] = "jitter"

    def _weight(self, frequency: Array, step: float | None) -> Array:
        return window_shares(*self._phase(frequency, step)).rest

    def lag_weights(self, lags: Lags, step: float) -> Array:
        """1 at lag 0, less those of mean and trend."""
        samples = self.count(step)
        return np.asarray(np.where(lags == 0, 1.0, 0.0) - triangle(lags, samples) - trend_lags(lags, samples))

    def _evaluate(self, windows: Array, step: float) -> Array:
        ramp = _ramp(windows.shape[1])
        deviation = windows - windows.mean(axis=1, keepdims=True)
        return np.asarray(deviation - ramp[:, None] * np.einsum("t,wts->ws", ramp, deviation)[:, None])


def _ramp(samples: int) -> Array:
    """Centred ramp (n,) of unit length; zero for one sample."""
    ramp = np.arange(samples) - 0.5 * (samples - 1)
    return np.asarray(ramp / max(float(np.linalg.norm(ramp)), 0.5))


def _fold(frequency: Array, step: float | None) -> Array:
    """The half of the last bin that lies above half the sampling rate mirrors the half below."""
    return frequency if step is None else np.minimum(frequency, np.abs(1.0 / step - frequency))


def _check_time(value: float, name: str) -> None:
    if not (math.isfinite(value) and value > 0.0):
        raise ValueError(f"{name}: expected a time above 0 s, got {value!r}")
