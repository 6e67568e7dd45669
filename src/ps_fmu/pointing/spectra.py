"""Welch spectra of runs of any length, segment by segment.

P. D. Welch, The use of fast Fourier transform for the estimation of power spectra, IEEE Trans.  Audio
Electroacoust.  15 (1967) 70-73: Hann window, segments that overlap by half, one-sided density, the mean
over the segments.  The result equals ``scipy.signal.welch`` (and ``csd``) of the whole record; only one
segment is held in memory.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from .observer import ColumnObserver, NamedColumn, rows_of

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]


class Welch(ColumnObserver):
    """One-sided power spectral densities of the named columns.

    Parameters
    ----------
    segment_s: length of a segment [s], a whole number of steps; the frequency step is its inverse
    step_s: time between rows [s]
    remove_mean: take the mean out of each segment first; what is slower than a segment is lost then
    start_s: rows before this time [s] are left out
    """

    def __init__(
        self,
        columns: Sequence[NamedColumn],
        names: Sequence[str],
        *,
        segment_s: float,
        step_s: float,
        remove_mean: bool = True,
        start_s: float = -math.inf,
    ) -> None:
        super().__init__(columns, names, start_s=start_s)
        rows = rows_of(segment_s, step_s, "segment")
        if rows < 4:
            raise ValueError(f"segment: {segment_s!r} s is {rows} steps; a spectrum needs four at least")
        self.segment_s = segment_s
        self.segments = 0
        self.frequency: Array = np.arange(rows // 2 + 1) / segment_s  # Hz
        self._remove_mean = remove_mean
        self._overlap = rows // 2
        self._window = 0.5 - 0.5 * np.cos(2.0 * np.pi * np.arange(rows) / rows)
        # Density of a one-sided spectrum: every bin but 0 Hz and Nyquist stands for its mirror image too.
        density = segment_s / rows / np.square(self._window).sum()
        self._scale: Array = np.full(self.frequency.shape, 2.0 * density)
        self._scale[0] /= 2.0
        if rows % 2 == 0:
            self._scale[-1] /= 2.0
        self._held = np.empty((len(self.names), rows))
        self._filled = 0
        self._allocate()

    def _allocate(self) -> None:
        self._power = np.zeros((len(self.names), len(self.frequency)))

    def take(self, time: Array, samples: Array) -> None:
        """Fill the segment; transform it when it is full and keep its second half for the next."""
        rows = self._held.shape[1]
        taken = 0
        while taken < samples.shape[1]:
            count = min(rows - self._filled, samples.shape[1] - taken)
            self._held[:, self._filled : self._filled + count] = samples[:, taken : taken + count]
            taken += count
            self._filled += count
            if self._filled == rows:
                segment = self._held
                if self._remove_mean:
                    segment = segment - segment.mean(axis=1, keepdims=True)
                self._add(np.fft.rfft(segment * self._window, axis=1))
                self.segments += 1
                self._held[:, : self._overlap] = self._held[:, rows - self._overlap :].copy()
                self._filled = self._overlap

    def _add(self, transform: ComplexArray) -> None:
        self._power += np.square(transform.real) + np.square(transform.imag)

    def _check(self, needed: int = 1) -> None:
        if self.segments < needed:
            raise ValueError(
                f"{needed} segments of {self.segment_s} s are needed and {self.segments} were filled: "
                "run longer or shorten the segment"
            )

    def psd(self) -> Array:
        """One-sided densities (signals, frequencies) in unit^2/Hz at :attr:`frequency`.

        Raises ``ValueError`` while no segment has been filled.
        """
        self._check()
        return self._power * (self._scale / self.segments)


class CrossWelch(Welch):
    """Cross spectra of the named columns too, for transfer functions measured in a run; same parameters."""

    def _allocate(self) -> None:
        signals = len(self.names)
        self._cross: ComplexArray = np.zeros((len(self.frequency), signals, signals), dtype=complex)

    def _add(self, transform: ComplexArray) -> None:
        self._cross += transform.T.conj()[:, :, None] * transform.T[:, None, :]

    def csd(self) -> ComplexArray:
        """One-sided cross densities (frequencies, signals, signals); i, j is the mean of conj(X_i) X_j."""
        self._check()
        density: ComplexArray = np.multiply(self._cross, (self._scale / self.segments)[:, None, None])
        return density

    def psd(self) -> Array:
        """One-sided densities (signals, frequencies), the diagonal of :meth:`csd`."""
        return np.ascontiguousarray(np.einsum("fii->if", self.csd()).real)

    def transfer(self, inputs: Sequence[str], outputs: Sequence[str]) -> tuple[ComplexArray, Array]:
        """Estimate H in Y = H U from the cross spectra, H^T = S_uu^-1 S_uy (noise on the outputs only).

        Returns H (frequencies, outputs, inputs) and the multiple coherence (frequencies, outputs): the
        share of an output's power that is a linear function of the inputs.  Where inputs depend on one
        another H is the solution of least norm.  Raises ``KeyError`` for a name that is not observed,
        ``ValueError`` unless there are more segments than inputs: the coherence would be 1 whatever the
        signals.
        """
        for name in (*inputs, *outputs):
            if name not in self.names:
                raise KeyError(f"{name} is not among the observed columns {', '.join(self.names)}")
        self._check(len(inputs) + 1)
        u = [self.names.index(name) for name in inputs]
        y = [self.names.index(name) for name in outputs]
        cross: ComplexArray = np.divide(self._cross, self.segments)
        s_uy = cross[:, u][:, :, y]
        h_transposed = np.linalg.pinv(cross[:, u][:, :, u], rcond=1e-10, hermitian=True) @ s_uy
        explained = np.einsum("fuy,fuy->fy", h_transposed.conj(), s_uy).real
        power = np.einsum("fyy->fy", cross[:, y][:, :, y]).real
        coherence = np.divide(explained, power, out=np.zeros_like(power), where=power > 0.0)
        return h_transposed.transpose(0, 2, 1), coherence


def cumulative_rms(frequency: Array, psd: Array, *, from_high: bool = False) -> Array:
    """RMS of what lies below each frequency (or above, ``from_high``), along the last axis of ``psd``.

    The bins of a Welch spectrum add up to the mean square of its windowed segments, so the sum is a plain
    one: ``sqrt(cumsum(psd) df)``.  Raises ``ValueError`` unless the frequencies are equally spaced.
    """
    spacing = np.diff(frequency)
    if len(frequency) < 2 or psd.shape[-1] != len(frequency):
        raise ValueError(f"psd of shape {psd.shape} does not fit {len(frequency)} frequencies")
    if not np.allclose(spacing, spacing[0], rtol=1e-6):
        raise ValueError("frequency: the values must be equally spaced")
    if from_high:
        return np.sqrt(np.cumsum(psd[..., ::-1], axis=-1)[..., ::-1] * spacing[0])
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
