"""The pointing error indices: absolute, mean, relative, drift and reproducibility error, smear, residual jitter.

Terms, definitions and clauses of ECSS-E-ST-60-10C (15 November 2008); displacement, smear and jitter of Pittelkau and
McKinley (see :mod:`.windows`).  An index is an object; it is applied to a spectrum, to lines, to a record
(:mod:`.index`), or to a linear process (:mod:`.library.linear_process`)::

    RelativeError(window=1.0, at="uniform").rms(frequency, psd)

Weights W(f) of a one-sided density: u = pi f T, j0 = sin u / u, j1 = sin u / u^2 - cos u / u, T the window.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .index import PointingIndex
from .windows import count_samples, end_share, trend_lags, triangle, window_shares

Array = NDArray[np.float64]
Lags = NDArray[np.int64]


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
    window: float  # length of the window, s

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
    """RPE, relative performance error: e(t) minus the mean of e over a window that contains t.

    ECSS-E-ST-60-10C, 3.2.12.  The standard allows two choices of t in the window (note 2), so ``at`` must be given:

    ``uniform``: t is random in the window.  W = 1 - j0^2, and APE^2 = MPE^2 + RPE^2 in the mean square.
    ``end``: t is the window's end.  W = |1 - (1 - e^(-ix)) / (ix)|^2, x = 2 pi f T.  For errors that are slow
    compared with the window the variance is 3 times that of ``uniform``; for fast errors both variances are equal.
    """

    at: Literal["uniform", "end"]  # where t lies in the window

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
    """PDE, performance drift error: the mean over a window minus the mean over an earlier window.

    ECSS-E-ST-60-10C, 3.2.8.  Both windows have the same length and lie in one observation.  W = 4 sin^2(pi f D) j0^2.
    """

    separation: float  # D, from the start of one window to the start of the other, s

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
        apart = self.separation if step is None else count_samples(self.separation, step, "separation") * step
        mean = window_shares(*self._phase(frequency, step)).mean
        return np.asarray(4.0 * np.sin(np.pi * frequency * apart) ** 2 * mean)

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
    """PRE, performance reproducibility error: PDE of windows in different observations.  ECSS-E-ST-60-10C, 3.2.10.

    The definitions are identical (3.2.10, note 5).  The spectrum does not contain errors that a calibration between the
    observations removes.  A bias that changes between observations adds twice its variance (annex B, Table B-2).
    """

    symbol: ClassVar[str] = "PRE"


@dataclass(frozen=True)
class Smear(_WindowIndex):
    """Smear: RMS of the linear trend of e over a window, the slope times T / sqrt(12).  W = 3 j1^2.

    Pittelkau and McKinley; :meth:`length` gives the smear length, slope times T.
    """

    symbol: ClassVar[str] = "smear"

    def length(self, rms: ArrayLike, step: float | None = None) -> Array:
        """Return the smear length, slope times T: RMS times sqrt(12), or times N sqrt(12 / (N^2 - 1)) for N samples."""
        samples = math.inf if step is None else self.count(step)
        return np.asarray(math.sqrt(12.0 / (1.0 - samples**-2)) * np.asarray(rms, dtype=float))

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
    """Residual jitter: e in a window without its mean and linear trend, t random.  W = 1 - j0^2 - 3 j1^2.

    It blurs an image that is exposed over the window.  The mean square is an integral over the window divided by its
    length.  Pittelkau and McKinley.
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
        trend = np.empty_like(deviation)  # its axes in the same order: else what follows takes five times as long
        np.multiply(ramp[:, None], (ramp @ deviation)[:, None], out=trend)
        return np.asarray(np.subtract(deviation, trend, out=deviation))


def _ramp(samples: int) -> Array:
    """Centred ramp (n,) of unit length; zero for one sample."""
    ramp = np.arange(samples) - 0.5 * (samples - 1)
    return np.asarray(ramp / max(float(np.linalg.norm(ramp)), 0.5))


def _check_time(value: float, name: str) -> None:
    if not (math.isfinite(value) and value > 0.0):
        raise ValueError(f"{name}: expected a time above 0 s, got {value!r}")
