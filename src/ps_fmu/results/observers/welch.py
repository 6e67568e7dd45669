"""Welch spectra of runs of any length, segment by segment.

P. D. Welch, The use of fast Fourier transform for the estimation of power spectra, IEEE Trans.  Audio
Electroacoust.  15 (1967) 70-73: Hann window, segments that overlap by half, one-sided density, the mean
over the segments.  The result equals ``scipy.signal.welch`` of the whole record; only one
segment is held in memory.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ...pointing.windows import count_samples
from .observer import Buffer, ColumnObserver, NamedColumn

Array = NDArray[np.float64]


class Welch(ColumnObserver):
    """One-sided power spectral densities of the named columns, of each segment without its mean.

    Parameters
    ----------
    segment_s: length of a segment [s], a whole number of steps; the frequency step is its inverse
    step_s: time between rows [s]
    start_s: rows before this time [s] are left out
    """

    KEPT = ("segments", "_buffer", "_power")

    def __init__(
        self,
        columns: Sequence[NamedColumn],
        names: Sequence[str],
        *,
        segment_s: float,
        step_s: float,
        start_s: float = -math.inf,
    ) -> None:
        super().__init__(columns, names, start_s=start_s)
        rows = count_samples(segment_s, step_s, "segment")
        if rows < 4:
            raise ValueError(f"segment: {segment_s!r} s is {rows} steps; a spectrum needs four at least")
        self.segment_s = segment_s
        self.segments = 0
        self.frequency: Array = np.arange(rows // 2 + 1) / segment_s  # Hz
        self._overlap = rows // 2
        self._window = 0.5 - 0.5 * np.cos(2.0 * np.pi * np.arange(rows) / rows)
        # Density of a one-sided spectrum: every bin but 0 Hz and Nyquist stands for its mirror image too.
        density = segment_s / rows / np.square(self._window).sum()
        self._scale: Array = np.full(self.frequency.shape, 2.0 * density)
        self._scale[0] /= 2.0
        if rows % 2 == 0:
            self._scale[-1] /= 2.0
        self._buffer = Buffer(len(self.names), rows)
        self._power = np.zeros((len(self.names), len(self.frequency)))
        windowed, lines = np.empty_like(self._buffer.room), np.empty(self._power.shape, dtype=complex)
        self._rooms = windowed, lines, *np.empty((2, len(self.frequency)))

    def take(self, time: Array, samples: Array) -> None:
        """Fill the segment; transform it when it is full and keep its second half for the next."""
        for segment in self._buffer.add(samples):
            self._transform(segment)
            self.segments += 1
            segment[:, : self._overlap] = segment[:, -self._overlap :].copy()
            self._buffer.filled = self._overlap

    def _transform(self, segments: Array) -> None:
        """Add the squares of the segment's lines to the power.

        One call transforms all signals: it prepares itself once, for a tenth of its time.  What comes before and after
        takes one signal at a time, which stays in the cache.  Arrays that are made anew each time, and so mapped anew,
        take twice the time.
        """
        windowed, lines, squares, more = self._rooms
        for segment, one in zip(segments, windowed, strict=True):
            np.multiply(np.subtract(segment, segment.mean(), out=one), self._window, out=one)
        np.fft.rfft(windowed, out=lines)
        for own, power in zip(lines, self._power, strict=True):
            np.square(own.real, out=squares)
            squares += np.square(own.imag, out=more)
            power += squares

    def psd(self) -> Array:
        """One-sided densities (signals, frequencies) in unit^2/Hz at ``frequency``.

        Raises ``ValueError`` while no segment has been filled.
        """
        self.take_held()
        if not self.segments:
            raise ValueError(f"no segment of {self.segment_s} s was filled: run longer or shorten the segment")
        return self._power * (self._scale / self.segments)
