"""What all pointing error indices can do: apply themselves to a spectrum, to lines, to a record.

Spectra are one-sided densities S(f) of a stationary error without its mean, in unit^2/Hz.  A bias is not in them: its
square adds to the mean square of the absolute and the mean error, and to no other index (``keeps_bias``).

With ``step``, s, an index is that of sampled data: a window is N = window / step samples, and the spectrum is that of
the samples, from 0 Hz to half the sampling rate.  Without, time is continuous.

Of a record there are statistics over its windows: bias apart from covariance, and the peak.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .integrals import bin_quadrature, function_integral, linear_quadrature, power_law_integral
from .windows import count_samples

Array = NDArray[np.float64]
Lags = NDArray[np.int64]
Interpolation = Literal["linear", "power law", "bins"]

_BLOCK = 1 << 21  # numbers in a block of windows: 16 MB


class PointingIndex(ABC):
    """A pointing error index: a linear operation on the error within a window."""

    symbol: ClassVar[str]  # short name, as in ECSS-E-ST-60-10C where it has one
    keeps_bias: ClassVar[bool] = False  # whether a constant error remains; if not, the index of a constant is zero

    @property
    def about(self) -> str:
        """The index in words, for example ``RPE over 1 s, t uniform``."""
        text = self.symbol
        if (window := getattr(self, "window", None)) is not None:
            text += f" over {window:g} s"
        if (separation := getattr(self, "separation", None)) is not None:
            text += f", {separation:g} s apart"
        if (at := getattr(self, "at", None)) is not None:
            text += ", t uniform" if at == "uniform" else ", t at the end"
        return text

    @property
    @abstractmethod
    def span(self) -> float:
        """Time from the first to the last sample that the index needs, s; the weight has periods of 1/span in f."""

    @abstractmethod
    def _weight(self, frequency: Array, step: float | None) -> Array:
        """Weight at frequencies that are fit for the step."""

    @abstractmethod
    def lag_weights(self, lags: Lags, step: float) -> Array:
        """Return q (n,) at ``lags`` m (n,), in steps: the mean square is the sum over all m of q_m R_m.

        R_m is the autocovariance of the samples.  q is even in m, and zero beyond :meth:`count`.
        """

    @abstractmethod
    def _evaluate(self, windows: Array, step: float) -> Array:
        """Values (windows, r, signals) of the index in windows (windows, count, signals)."""

    def count(self, step: float) -> int:
        """Return the number of samples for one value of the index; ``ValueError`` unless times are whole steps, s."""
        return count_samples(self.span, step, "window")

    def weight(self, frequency: ArrayLike, step: float | None = None) -> Array:
        """Return the weight W(f), 0 to 4, at frequencies of any shape, Hz.

        W is the mean square of the index for a sine with the mean square 1.

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
        """Return coefficients (n,), Hz; their sum with samples of a density at ``frequency`` (n,), Hz, is the variance.

        ``linear``: the density is linear between its samples; the result is exact to rounding, even if the weight
        oscillates many times between samples.  ``bins``: each sample is the mean over a bin around it, as in a Welch
        spectrum; frequencies are equally spaced from 0 Hz on.  The density outside the given frequencies counts as 0.
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
        """Return the variance for samples of a one-sided density S: the integral of W S over the given frequencies.

        Parameters
        ----------
        frequency: (n,), Hz, ascending.
        psd: S, unit^2/Hz, with n values along ``axis``: (n,) for one signal, (n, k) for k signals, (n, k, k) for the
            real part of a spectral density matrix, which gives the covariance (k, k).
        interpolation: the density between its samples: ``linear`` or ``bins``, see :meth:`quadrature`, or
            ``power law``, a straight line in a log-log plot; frequencies and densities are then above 0.

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
        """Return the square root of :meth:`variance` for densities of signals (not matrices)."""
        return np.sqrt(self.variance(frequency, psd, step=step, interpolation=interpolation, axis=axis))

    def variance_of_function(
        self,
        psd: Callable[[Array], Array],
        band: tuple[float, float],
        *,
        step: float | None = None,
        points: Iterable[float] = (),
    ) -> float:
        """Return the variance for a density that is a function of the frequency, over a band (low, high), Hz.

        The relative error is 1e-12.  ``points``: frequencies of narrow resonances and steps.  A density may grow
        towards 0 Hz if the weight falls faster: the relative error has a variance for 1/f^2 and ``band=(0.0, high)``.
        """
        if step is not None:
            self.weight(band[1], step)
        return function_integral(lambda f: self._weight(f, step), psd, band, self.span, points)

    def variance_of_lines(self, frequency: ArrayLike, amplitude: ArrayLike, *, step: float | None = None) -> Array:
        """Return the variance, () or (k,), unit^2, for spectral lines (n,), Hz, of amplitudes (n,) or (n, k), unit.

        Amplitudes are real or complex.  Phases are random or frequencies differ, so that mean squares add up.
        """
        return np.asarray(np.tensordot(self.weight(frequency, step), 0.5 * np.abs(np.asarray(amplitude)) ** 2, axes=1))

    def values(self, record: ArrayLike, step: float, *, stride: int | None = None) -> Array:
        """Return the signed index in each window of a record, (windows, r, signals).

        Parameters
        ----------
        record: (n,) or (n, signals), samples ``step`` s apart.
        stride: samples between the starts of windows; None: windows lie side by side.

        r is 1 if the index gives one value per window.  It is the number of samples of the window if the index gives a
        value at each time t in it (RPE with t uniform, residual jitter).  Raises ``ValueError`` if the record is
        shorter than one window.
        """
        parts = split(record, self.count(step), self._stride(step, stride))
        found = [self._evaluate(windows, step) for windows in parts]
        return found[0] if len(found) == 1 and found[0].flags.owndata else np.concatenate(found)

    def of_record(self, record: ArrayLike, step: float, *, stride: int | None = None) -> Estimate:
        """Return bias, covariance and peak over the windows of a record; arguments as in :meth:`values`."""
        parts = split(record, self.count(step), self._stride(step, stride))
        return estimate(self._evaluate(windows, step) for windows in parts)

    def _stride(self, step: float, stride: int | None) -> int:
        return self.count(step) if stride is None else stride


def _fold(frequency: Array, step: float | None) -> Array:
    """The half of the last bin that lies above half the sampling rate mirrors the half below."""
    return frequency if step is None else np.minimum(frequency, np.abs(1.0 / step - frequency))


@dataclass(frozen=True, eq=False)
class Estimate:
    """Statistics of an index over the windows of a record."""

    bias: Array  # (signals,), mean over the windows, in the unit of the signals
    covariance: Array  # (signals, signals), unit^2, about the bias; divided by the number of values
    peak: Array  # (signals,), largest magnitude
    windows: int
    """Number of windows; they are not independent samples, see :func:`.confidence.effective_samples`."""

    @property
    def variance(self) -> Array:
        """(signals,), unit^2, about the bias."""
        return np.asarray(np.diag(self.covariance).copy())

    @property
    def std(self) -> Array:
        """(signals,), unit, about the bias."""
        return np.sqrt(self.variance)

    @property
    def rms(self) -> Array:
        """(signals,), unit, with the bias: sqrt(bias^2 + variance)."""
        return np.sqrt(self.bias**2 + self.variance)


def split(record: ArrayLike, count: int, stride: int) -> Iterator[Array]:
    """Windows (windows, count, signals) of a record (n,) or (n, signals), in blocks.

    They start ``stride`` samples apart.  A window that the record does not fill is left out.  Raises ``ValueError`` for
    a record with less than one window, a stride below 1, and values that are not finite.
    """
    record = np.asarray(record, dtype=float)
    record = record[:, None] if record.ndim == 1 else record
    if record.ndim != 2:
        raise ValueError(f"record: expected the shape (n,) or (n, signals), got {record.shape}")
    if stride < 1:
        raise ValueError(f"stride: expected 1 sample or more, got {stride}")
    if len(record) < count:
        raise ValueError(f"record: {len(record)} samples, and a window needs {count}")
    if not np.isfinite(record).all():
        raise ValueError("record: it has values that are not finite")
    view = np.lib.stride_tricks.sliding_window_view(record, count, axis=0)[::stride]
    block = max(1, _BLOCK // (count * record.shape[1]))
    for first in range(0, len(view), block):
        yield np.moveaxis(view[first : first + block], 2, 1)


def estimate(parts: Iterable[Array]) -> Estimate:
    """Bias, covariance and peak of values (windows, r, signals) in blocks."""
    windows, count = 0, 0
    offset = total = squares = peak = np.zeros(0)
    for part in parts:
        values = part.reshape(-1, part.shape[2])
        if not windows:
            # Sums about a value near the mean: those of plain squares would lose a small jitter beside a large bias.
            offset = values.mean(axis=0)
            total, squares, peak = np.zeros(offset.shape), np.zeros((len(offset), len(offset))), np.zeros(offset.shape)
        deviation = values - offset
        windows += len(part)
        count += len(values)
        total = total + deviation.sum(axis=0)
        squares = squares + deviation.T @ deviation
        peak = np.maximum(peak, np.abs(values).max(axis=0))
    mean = total / count
    return Estimate(offset + mean, squares / count - np.outer(mean, mean), peak, windows)
