"""Lines of wheels in the payload's rotation: short-time spectra, and where harmonics cross natural modes.

The amplitude of a vector signal at a frequency is the largest magnitude that it has on its ellipse: of the complex
amplitude a (3,), ``sqrt((|a|^2 + |a.a|) / 2)`` with the product a.a not conjugated.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..disturbance.turning import RPM, Speed
from ..disturbance.wheels import WheelSource
from ..mechanism.quantities import Array, Complex
from ..theory.natural_modes import NaturalMode

WINDOW_S = 0.4
"""Length of a segment: a line that moves by 6 Hz/s stays in its bin of 2.4 Hz."""
FEWEST_ROWS = 16
ROWS = 400  # of a spectrogram: as many as a picture shows
PERIODS = 3.0  # of the lowest frequency in a window: from there on a line is told apart from its mirror image
_PLACES = 16  # of a window while a line is tracked across a mode
_GRID = 20_000  # times at which speeds are looked at for crossings
_TURN = 2.0 * np.pi

Response = Callable[[Array], Complex]
"""Frequencies (n,), Hz, to transfer matrices (n, 3, 6) from the wrench to the payload's rotation."""


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


@dataclass(frozen=True, eq=False)
class Wheel:
    """A wheel that is on: its name, its speed and its harmonics."""

    name: str
    profile: Speed
    source: WheelSource

    @property
    def orders(self) -> Array:
        """Orders of its harmonics (n,), ascending, each once."""
        return np.unique(self.source.orders)

    @property
    def highest(self) -> float:
        """Frequency of its highest harmonic at its highest speed, Hz."""
        return float(self.orders[-1] * self.profile.highest / _TURN)

    def amplitude(self, order: float, speed: float) -> Complex:
        """Complex amplitude (6,) of a harmonic at a speed, rad/s; for the frequency without its sign."""
        both = self.source.amplitudes(speed)[self.source.orders == order].sum(axis=0)
        return np.asarray(both if speed >= 0.0 else both.conj())


@dataclass(frozen=True, eq=False)
class Crossing:
    """A harmonic of a wheel meets a mode."""

    wheel: Wheel
    order: float
    mode: NaturalMode
    time: float
    """s."""
    speed: float
    """Of the wheel, rad/s."""
    steady: float
    """Amplitude of the payload's rotation if the wheel stayed at this speed, in closed form, rad."""
    amplitude: float = float("nan")
    """The same in the run, rad."""

    @property
    def entry(self) -> dict[str, object]:
        """For summary.json."""
        return {
            "wheel": self.wheel.name,
            "harmonic": self.order,
            "speed_rpm": self.speed / RPM,
            "frequency_hz": self.mode.frequency,
            "mode": self.mode.name,
            "time_s": self.time,
            "peak_amplitude_rad": self.amplitude,
            "constant_speed_amplitude_rad": self.steady,
        }

    @property
    def window(self) -> float:
        """Length of the window that the amplitude is taken with, s."""
        return max(WINDOW_S, PERIODS / self.mode.frequency)

    @property
    def is_slow(self) -> bool:
        """Whether the wheel changes its speed by less than its half within the window: a faster run shows no line."""
        ends = self.wheel.profile.speed(self.time + np.array([-0.5, 0.5]) * self.window)
        return bool(np.ptp(ends) < 0.5 * abs(self.speed))

    def is_beside(self, other: Crossing) -> bool:
        """Whether the run cannot tell the two apart: the other harmonic stays within four bins of this mode."""
        bin_width = 1.0 / self.window
        times = np.linspace(self.time, other.time, 33)
        line = other.order * np.abs(other.wheel.profile.speed(times)) / _TURN
        near = abs(self.mode.frequency - other.mode.frequency) < 2.0 * bin_width
        return near and bool(np.abs(line - self.mode.frequency).max() < 4.0 * bin_width)


def find_crossings(
    wheels: Sequence[Wheel], modes: Sequence[NaturalMode], duration_s: float, response: Response
) -> list[Crossing]:
    """All crossings of a run, those with the largest steady amplitude first.

    A wheel at constant speed crosses nothing, one that stands on a mode's frequency included.
    """
    time = np.linspace(0.0, duration_s, _GRID + 1)
    matrices = response(np.array([mode.frequency for mode in modes])) if modes else np.zeros((0, 3, 6))
    found = []
    for wheel in wheels:
        speed = wheel.profile.speed(time)
        for mode, matrix in zip(modes, matrices, strict=True):
            for order in wheel.orders:
                away = order * np.abs(speed) / _TURN - mode.frequency
                for k in np.flatnonzero((away[1:] > 0.0) != (away[:-1] > 0.0)):
                    at = time[k] + (time[k + 1] - time[k]) * away[k] / (away[k] - away[k + 1])
                    there = float(np.copysign(_TURN * mode.frequency / order, speed[k] + speed[k + 1]))
                    steady = float(measure_ellipse(matrix @ wheel.amplitude(float(order), there)))
                    found.append(Crossing(wheel, float(order), mode, float(at), there, steady))
    return sorted(found, key=lambda crossing: -crossing.steady)


def measure_crossings(crossings: Sequence[Crossing], signals: Array, step_s: float) -> list[Crossing]:
    """The crossings that the payload's rotation (3, n), rad, shows, with their amplitudes, the worst first.

    Of those that it cannot tell apart, the one that is the largest at constant speed stands for all.
    """
    kept: list[Crossing] = []
    for crossing in sorted(filter(lambda each: each.is_slow, crossings), key=lambda each: -each.steady):
        if not any(crossing.is_beside(other) for other in kept):
            kept.append(crossing)
    time = np.arange(signals.shape[1], dtype=np.float64) * step_s
    angles = {each.wheel.name: each.wheel.profile.angle(time) for each in kept}
    measured = []
    for crossing in kept:
        angle = crossing.order * angles[crossing.wheel.name]
        found = track_line(signals, step_s, angle, crossing.time, crossing.mode.frequency)
        measured.append(replace(crossing, amplitude=found))
    return sorted(measured, key=lambda crossing: -crossing.amplitude)
