"""Welch spectra of runs of any length, segment by segment.

P. D. Welch, The use of fast Fourier transform for the estimation of power spectra, IEEE Trans.  Audio
Electroacoust.  15 (1967) 70-73: Hann window, segments that overlap by half, one-sided density, the mean
over the segments.  The result equals ``scipy.signal.welch`` of the whole record; only one
segment is held in memory.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...pointing.windows import count_samples
from .kept import State, check_array
from .observer import ColumnObserver, NamedColumn

Array = NDArray[np.float64]


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
        rows = count_samples(segment_s, step_s, "segment")
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
        self._power = np.zeros((len(self.names), len(self.frequency)))
        lines = len(self.names), len(self.frequency)
        self._rooms = np.empty(self._held.shape), np.empty(lines, dtype=complex), *np.empty((2, len(self.frequency)))

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
                self._transform()
                self.segments += 1
                self._held[:, : self._overlap] = self._held[:, rows - self._overlap :].copy()
                self._filled = self._overlap

    def _transform(self) -> None:
        """Add the squares of the segment's lines to the power.

        One call transforms all signals: it prepares itself once, for a tenth of its time.  What comes before and after
        takes one signal at a time, which stays in the cache.  Arrays that are made anew each time, and so mapped anew,
        take twice the time.
        """
        windowed, lines, squares, more = self._rooms
        for segment, one in zip(self._held, windowed, strict=True):
            np.multiply(
                np.subtract(segment, segment.mean(), out=one) if self._remove_mean else segment,
                self._window, out=one,
            )  # fmt: skip
        np.fft.rfft(windowed, out=lines)
        for own, power in zip(lines, self._power, strict=True):
            np.square(own.real, out=squares)
            squares += np.square(own.imag, out=more)
            power += squares

    def save_state(self) -> dict[str, Any]:
        """As :meth:`ColumnObserver.save_state`."""
        power = self._power if self.segments else None  # all zeros: 3 MB of a usual run
        return {"segments": self.segments, "held": self._held[:, : self._filled], "power": power}

    def load_state(self, state: State) -> None:
        """As :meth:`ColumnObserver.load_state`."""
        held, segments = state["held"], state["segments"]
        check_array("held", held.T, self._held.T, grows=True)
        if type(segments) is not int or held.shape[1] >= self._held.shape[1]:
            raise ValueError(f"held: {held.shape[1]} rows in segments of {self._held.shape[1]}")
        power = state["power"]
        self._power = check_array("power", power, self._power) if segments else np.zeros_like(self._power)
        self.segments, self._filled = segments, held.shape[1]
        self._held[:, : self._filled] = held

    def psd(self) -> Array:
        """One-sided densities (signals, frequencies) in unit^2/Hz at ``frequency``.

        Raises ``ValueError`` while no segment has been filled.
        """
        if not self.segments:
            raise ValueError(f"no segment of {self.segment_s} s was filled: run longer or shorten the segment")
        return self._power * (self._scale / self.segments)
