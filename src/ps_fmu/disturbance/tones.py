"""Sines and sweeps: a wrench of fixed direction whose size follows a sine."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .smooth import ramp

Array = NDArray[np.float64]


class Tone:
    """f(t) = d2/dt2 (W G) with G = -A sin(w t + phase) / w^2: a sine that pushes a free body without drift.

    Parameters
    ----------
    wrench: amplitude A (6,), N and N.m in B at its origin.
    frequency: above 0, Hz.
    phase: rad.
    rise_time: of the ramp W, s; stretched to one period where that is longer, since the momentum of a sine is
        proportional to its period.
    """

    def __init__(self, wrench: Array, frequency: float, phase: float = 0.0, rise_time: float = 2.0) -> None:
        self._wrench = wrench
        self._omega = 2.0 * np.pi * frequency
        self._phase = phase
        self._rise_time = max(rise_time, 1.0 / frequency)

    def __call__(self, time: Array) -> Array:
        """Force (N) and torque (N.m) at the times (n,) in s, shape (n, 6)."""
        angle, omega = self._omega * time + self._phase, self._omega
        sine = np.sin(angle)[:, None]
        weight = ramp(time, self._rise_time)
        size = weight.second_derivative(-sine / omega**2, -np.cos(angle)[:, None] / omega, sine)
        return size * self._wrench


class Chirp:
    """A sine whose frequency sweeps from one value to another, linearly or by equal ratios in equal times.

    Zero before and after the sweep; faded in and out over the rise time within it.  The phase is the exact
    integral of the frequency.  A free body keeps what momentum the sweep leaves, which is small if the
    fade-in lasts a few periods of the first frequency.

    Parameters
    ----------
    wrench: amplitude (6,), N and N.m in B at its origin.
    initial, final: frequencies at the ends, above 0, Hz.
    start, duration: s; the duration is at least twice the rise time.
    logarithmic: log(frequency) instead of frequency is linear in time.
    rise_time: s.
    """

    def __init__(
        self,
        wrench: Array,
        initial: float,
        final: float,
        start: float,
        duration: float,
        logarithmic: bool = False,
        rise_time: float = 2.0,
    ) -> None:
        self._wrench = wrench
        self._initial, self._final = initial, final
        self._start, self._duration = start, duration
        self._logarithmic = logarithmic
        self._rise_time = rise_time

    def phase(self, elapsed: Array) -> Array:
        """Phase since the start of the sweep (n,), rad."""
        first, last, duration = self._initial, self._final, self._duration
        if self._logarithmic and first != last:
            rate = np.log(last / first) / duration  # 1/s
            return np.asarray(2.0 * np.pi * first * np.expm1(rate * elapsed) / rate)
        return np.asarray(2.0 * np.pi * (first * elapsed + 0.5 * (last - first) / duration * elapsed**2))

    def __call__(self, time: Array) -> Array:
        """Force (N) and torque (N.m) at the times (n,) in s, shape (n, 6)."""
        elapsed = np.clip(time - self._start, 0.0, self._duration)
        fade = ramp(elapsed, self._rise_time).value * ramp(self._duration - elapsed, self._rise_time).value
        return np.multiply.outer(fade * np.sin(self.phase(elapsed)), self._wrench)
