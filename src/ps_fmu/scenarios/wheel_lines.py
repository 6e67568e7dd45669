"""Lines of wheels in the payload's rotation: short-time spectra, and where harmonics cross natural modes.

The amplitude of a vector signal at a frequency is the largest magnitude that it has on its ellipse: of the complex
amplitude a (3,), ``sqrt((|a|^2 + |a.a|) / 2)`` with the product a.a not conjugated.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

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
_BESIDE, _REACH = 4.0, 8.0  # bins of a window: what is one with a line, and what a Hann window lets through
_FAINT = 0.1  # of a harmonic: a line that does not change its amplitude by more than a tenth
_NEAR, _PEAK_PLACES = 0.1, 161  # of the frequency of a mode: where its peak is looked for; how many places
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
    frequency: float
    """Where the payload answers most to this harmonic near the mode, Hz; the mode's own where it has no peak there."""
    time: float
    """s."""
    speed: float
    """Of the wheel, rad/s."""
    steady: float
    """Amplitude of the payload's rotation if the wheel stayed at this speed, in closed form, rad."""
    amplitude: float = float("nan")
    """The same in the run, rad; NaN where a line of another wheel that changes its speed, too, is too near."""

    @property
    def entry(self) -> dict[str, object]:
        """For summary.json."""
        return {
            "wheel": self.wheel.name,
            "harmonic": self.order,
            "speed_rpm": self.speed / RPM,
            "frequency_hz": self.frequency,
            "mode": self.mode.name,
            "time_s": self.time,
            "peak_amplitude_rad": None if np.isnan(self.amplitude) else self.amplitude,
            "constant_speed_amplitude_rad": self.steady,
        }

    @property
    def window(self) -> float:
        """Length of the window that the amplitude is taken with, s."""
        return max(WINDOW_S, PERIODS / self.frequency)

    def is_near(self, line: Other) -> bool:
        """Whether the windows that the amplitude is taken with let a line through."""
        return abs(line.frequency - self.frequency) < _REACH / self.window

    def makes_most(self, lines: Iterable[Other]) -> bool:
        """Whether no other harmonic of the wheel makes more at that time, but for the rounding of the time."""
        return all(line.steady < 1.01 * self.steady for line in lines if line.wheel is self.wheel)

    @property
    def is_slow(self) -> bool:
        """Whether the wheel changes its speed by less than its half within the window: a faster run shows no line."""
        ends = self.wheel.profile.speed(self.time + np.array([-0.5, 0.5]) * self.window)
        return bool(np.ptp(ends) < 0.5 * abs(self.speed))

    def is_beside(self, other: Crossing) -> bool:
        """Whether the run cannot tell the two apart: the other harmonic stays within four bins of this crossing."""
        times = np.linspace(self.time, other.time, 33)
        line = other.order * np.abs(other.wheel.profile.speed(times)) / _TURN
        near = abs(self.frequency - other.frequency) < 2.0 / self.window
        return near and bool(np.abs(line - self.frequency).max() < _BESIDE / self.window)


@dataclass(frozen=True, eq=False)
class Other:
    """Another line at the time of a crossing."""

    wheel: Wheel
    order: float
    speed: float  # rad/s
    steady: float  # amplitude of the payload's rotation at this speed, in closed form, rad

    @property
    def frequency(self) -> float:
        """Hz."""
        return self.order * abs(self.speed) / _TURN


def find_crossings(
    wheels: Sequence[Wheel], modes: Sequence[NaturalMode], duration_s: float, response: Response
) -> list[Crossing]:
    """All crossings of a run, those with the largest steady amplitude first.

    A wheel at constant speed crosses nothing, one that stands on a mode's frequency included.
    """
    time = np.linspace(0.0, duration_s, _GRID + 1)
    around = _place_around(modes)
    answers = np.split(response(np.concatenate(around)), len(modes)) if modes else []
    found = []
    for wheel in wheels:
        speed = wheel.profile.speed(time)
        for sense in (1.0, -1.0):
            for order in wheel.orders if (sense * speed > 0.0).any() else ():
                unit = wheel.amplitude(float(order), sense)
                for mode, at, answer in zip(modes, around, answers, strict=True):
                    peak = _find_peak(at, at**2 * measure_ellipse(answer @ unit), mode.frequency)
                    away = order * sense * speed / _TURN - peak
                    for k in np.flatnonzero((away[1:] > 0.0) != (away[:-1] > 0.0)):
                        when = float(time[k] + (time[k + 1] - time[k]) * away[k] / (away[k] - away[k + 1]))
                        there = sense * _TURN * peak / float(order)
                        found.append(Crossing(wheel, float(order), mode, peak, when, there, float("nan")))
    steady = _find_steady([(each.wheel, each.order, each.speed) for each in found], response)
    found = [replace(each, steady=float(size)) for each, size in zip(found, steady, strict=True)]
    return sorted(found, key=lambda crossing: -crossing.steady)


def _place_around(modes: Sequence[NaturalMode]) -> list[Array]:
    """Frequencies (n,), Hz, around each mode, dense at it: up to half way to the next, and within a tenth of it."""
    middle = [0.5 * (one.frequency + other.frequency) for one, other in pairwise(modes)]
    found = []
    for mode, low, high in zip(modes, [0.0, *middle], [*middle, np.inf], strict=True):
        damping = max(mode.damping_ratio, 1e-4)
        reach = np.arcsinh(_NEAR / damping)
        at = mode.frequency * (1.0 + damping * np.sinh(np.linspace(-reach, reach, _PEAK_PLACES)))
        found.append(np.clip(at, low, high))
    return found


def _find_peak(frequency: Array, amplitude: Array, otherwise: float) -> float:
    """Where the amplitude (n,) has its largest value, Hz, by the parabola that 1/amplitude^2 is at a resonance."""
    k = int(amplitude.argmax())
    if not (0 < k < len(frequency) - 1 and amplitude[k] > max(amplitude[k - 1], amplitude[k + 1])):
        return otherwise
    at = slice(k - 1, k + 2)
    curve = np.polyfit(frequency[at] - frequency[k], (amplitude[k] / amplitude[at]) ** 2, 2)
    return float(frequency[k] - 0.5 * curve[1] / curve[0])


def _find_steady(lines: Sequence[tuple[Wheel, float, float]], response: Response) -> Array:
    """Amplitudes (n,), rad, that harmonics of wheels make at constant speeds, rad/s; not 0."""
    if not lines:
        return np.zeros(0)
    matrices = response(np.array([order * abs(speed) / _TURN for _, order, speed in lines]))
    wrench = np.array([wheel.amplitude(order, speed) for wheel, order, speed in lines])
    return measure_ellipse(np.einsum("nij,nj->ni", matrices, wrench))


def measure_crossings(
    crossings: Sequence[Crossing], wheels: Sequence[Wheel], signals: Array, step_s: float, response: Response
) -> list[Crossing]:
    """The crossings that matter in the payload's rotation (3, n), rad, with their amplitudes, the worst first.

    Of those that a run cannot tell apart, the one that is the largest at constant speed stands for all.  Those are left
    out at which another harmonic of the wheel makes more at constant speed.  The lines of other wheels that keep their
    speed are taken away before a harmonic is measured.
    """
    kept: list[Crossing] = []
    for crossing in sorted(filter(lambda each: each.is_slow, crossings), key=lambda each: -each.steady):
        if not any(crossing.is_beside(other) for other in kept):
            kept.append(crossing)
    others = [_list_others(crossing, wheels) for crossing in kept]
    sizes = iter(_find_steady([line for lines in others for line in lines], response).tolist())
    beside = {k: [Other(*line, next(sizes)) for line in lines] for k, lines in enumerate(others)}
    chosen = [k for k, each in enumerate(kept) if each.makes_most(beside[k])]
    time = np.arange(signals.shape[1], dtype=np.float64) * step_s
    constant = [wheel for wheel in wheels if np.ptp(wheel.profile.speed(time)) == 0.0]
    near = {k: [line for line in beside[k] if kept[k].is_near(line)] for k in chosen}
    signals = remove_lines(
        signals, step_s, sorted({line.frequency for k in chosen for line in near[k] if line.wheel in constant})
    )
    measured = []
    for k in chosen:
        crossing = kept[k]
        moving = [line for line in near[k] if line.wheel not in (crossing.wheel, *constant)]
        if all(line.steady < _FAINT * crossing.steady for line in moving):
            angle = crossing.order * crossing.wheel.profile.angle(time)
            found = track_line(signals, step_s, angle, crossing.time, crossing.frequency)
            crossing = replace(crossing, amplitude=found)
        measured.append(crossing)
    return sorted(measured, key=lambda crossing: -np.nan_to_num(crossing.amplitude))


def _list_others(crossing: Crossing, wheels: Sequence[Wheel]) -> list[tuple[Wheel, float, float]]:
    """Wheel, order and speed, rad/s, of all lines at the time of a crossing, but for those that are one with it."""
    found = []
    for wheel in wheels:
        speed = float(wheel.profile.speed(np.array([crossing.time]))[0])
        for order in wheel.orders.tolist() if speed else []:
            away = abs(order * abs(speed) / _TURN - crossing.frequency)
            if wheel is not crossing.wheel or away > _BESIDE / crossing.window:
                found.append((wheel, order, speed))
    return found


def remove_lines(signals: Array, step_s: float, frequencies: Iterable[float]) -> Array:
    """A vector signal (3, n) without what it has of lines of constant frequency and amplitude, Hz.

    Of each the part that turns with it, averaged over all of the signal with a Hann window, one after the other.
    """
    window = _hann(signals.shape[1])
    window *= 2.0 / window.sum()
    time = np.arange(signals.shape[1]) * step_s
    for frequency in frequencies:
        turn = np.exp(1j * _TURN * frequency * time)
        found = (signals * turn.conj()) @ window
        signals = signals - (found[:, None] * turn).real
    return signals
