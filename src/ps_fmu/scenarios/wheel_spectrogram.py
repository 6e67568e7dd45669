"""Amplitudes of lines over a run: by short-time spectrum, and along one line whose angle is known.

The amplitude of a vector signal at a frequency is the largest magnitude that it has on its ellipse: of the complex
amplitude a (3,), ``sqrt((|a|^2 + |a.a|) / 2)`` with the product a.a not conjugated.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..mechanism.quantities import Array, Complex

WINDOW_S = 0.4
"""Length of a segment: a line that moves by 6 Hz/s stays in its bin of 2.4 Hz."""
FEWEST_ROWS = 16
ROWS = 400  # of a spectrogram: as many as a picture shows
PERIODS = 3.0  # of the lowest frequency in a window: from there on a line is told apart from its mirror image
_PLACES = 16  # of a window while a line is tracked across a mode


@dataclass(frozen=True, eq=False)
class Spectrogram:
    """``amplitude`` (rows, bins) at the ``time`` (rows,), s, of the segments' middles and ``frequency`` (bins,), Hz."""

    time: Array
    frequency: Array
    amplitude: Array


def make_spectrogram(signals: Array, step_s: float, highest: float) -> Spectrogram:
    """Of a vector signal (3, n) up to ``highest``, Hz; windows of :data:`WINDOW_S`, shorter in a short run.

    Blackman's windows: with Hann's the strongest line hides what is 70 dB below it 30 Hz away.

    Raises ``ValueError`` for fewer rows than :data:`FEWEST_ROWS`.
    """
    from scipy.signal import ShortTimeFFT
    from scipy.signal.windows import blackman

    count = signals.shape[1]
    if count < FEWEST_ROWS:
        raise ValueError(f"expected {FEWEST_ROWS} rows at least, got {count}")
    length = min(2 ** round(np.log2(max(WINDOW_S / step_s, 8.0))), 2 ** int(np.log2(count / 2)))
    hop = max(1, (count - length) // (ROWS - 1))
    window = blackman(length, sym=False)
    transform = ShortTimeFFT(
        window, hop, fs=1.0 / step_s, fft_mode="onesided2X", scale_to="magnitude", phase_shift=None
    )
    first, last = transform.lower_border_end[1], transform.upper_border_begin(count)[1]
    bins = int(np.searchsorted(transform.f, highest, side="right"))
    spectra = transform.stft(signals, p0=first, p1=last)[:, :bins]
    return Spectrogram(transform.t(count, first, last), transform.f[:bins], measure_ellipse(spectra.transpose(2, 1, 0)))


def measure_ellipse(amplitudes: Complex) -> Array:
    """The largest magnitude (...) of the real part of ``a exp(j phase)`` for complex amplitudes a (..., 3)."""
    squared = np.sum(np.abs(amplitudes) ** 2, axis=-1)
    return np.asarray(np.sqrt(0.5 * (squared + np.abs(np.sum(amplitudes**2, axis=-1)))))


def track_line(signals: Array, step_s: float, angle: Array, around_s: float, frequency: float) -> float:
    """Largest amplitude of a line near a time: of the part of a vector signal (3, n) that turns with an angle.

    The signal turned back by the angle (n,), rad, averaged with Hann windows as long as a segment, or three periods of
    ``frequency`` (Hz), whose middles lie from half a window before to a window after ``around_s``: the peak of a
    resonance comes after the crossing.  A run shorter than the window is one window.
    """
    count = signals.shape[1]
    length = min(round(max(WINDOW_S, PERIODS / frequency) / step_s), count)
    window = _hann(length)
    window *= 2.0 / window.sum()
    centre = around_s / step_s
    starts = np.linspace(centre - length, centre + 0.5 * length, _PLACES)
    starts = np.unique(np.clip(starts.round().astype(int), 0, count - length))
    span = slice(starts[0], starts[-1] + length)
    turned = signals[:, span] * np.exp(-1j * angle[span])
    found = [turned[:, k - starts[0] : k - starts[0] + length] @ window for k in starts]
    return float(measure_ellipse(np.array(found)).max())


def _hann(length: int) -> Array:
    """Periodic, (length,)."""
    return np.asarray(0.5 - 0.5 * np.cos(2.0 * np.pi * np.arange(length) / length))
