"""Sines and a sweep: a wrench of fixed direction whose size follows a sine of constant or changing frequency."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ..mechanism.parameters import Parameters
from ..mechanism.quantities import Array, ParameterError, quantity
from .kind import Kind, SharedSettings, Source, explain_folding
from .spectrum import ramp


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


@dataclass(frozen=True, eq=False)
class ToneSettings(Kind):
    """A sine; no amplitude means off."""

    name: ClassVar[str] = "tones"

    frequency: float = quantity("Hz", "Frequency of the sine", at_least=1e-4)
    phase: float = quantity("rad", "Phase of the sine at t = 0")
    force_B: Array = quantity("N", "Amplitude of the sine's force, in B", shape=(3,))
    torque_B: Array = quantity("N.m", "Amplitude of the sine's torque, in B at its origin", shape=(3,))

    @classmethod
    def make_defaults(cls, p: Parameters) -> tuple[ToneSettings, ...]:
        """Three sines of 1 Hz without amplitude."""
        zero = np.zeros(3)
        return (cls(frequency=1.0, phase=0.0, force_B=zero, torque_B=zero),) * 3

    def make_source(self, shared: SharedSettings, number: int) -> Source | None:
        """The sine."""
        wrench = np.concatenate([self.force_B, self.torque_B])
        return Tone(wrench, self.frequency, self.phase, shared.rise_time) if wrench.any() else None

    def explain_aliasing(self, h: float) -> str | None:
        """That the steps fold the sine."""
        wrench = np.concatenate([self.force_B, self.torque_B])
        return explain_folding("the sine", self.frequency, h) if wrench.any() else None


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


@dataclass(frozen=True, eq=False)
class ChirpSettings(Kind):
    """A sweep; no amplitude means off."""

    name: ClassVar[str] = "chirp"

    initial_frequency: float = quantity("Hz", "Frequency at the start of the sweep", above=0.0)
    final_frequency: float = quantity("Hz", "Frequency at the end of the sweep", above=0.0)
    start: float = quantity("s", "Time at which the sweep starts")
    duration: float = quantity("s", "Duration of the sweep", above=0.0)
    logarithmic: bool = quantity("", "True: equal frequency ratios in equal times; false: linear")
    force_B: Array = quantity("N", "Amplitude of the sweep's force, in B", shape=(3,))
    torque_B: Array = quantity("N.m", "Amplitude of the sweep's torque, in B at its origin", shape=(3,))

    @classmethod
    def make_defaults(cls, p: Parameters) -> ChirpSettings:
        """A sweep from 0.1 to 500 Hz in a minute, without amplitude."""
        return cls(
            initial_frequency=0.1,  # Hz
            final_frequency=500.0,  # Hz
            start=0.0,  # s
            duration=60.0,  # s
            logarithmic=True,
            force_B=np.zeros(3),
            torque_B=np.zeros(3),
        )

    @property
    def wrench(self) -> Array:
        """Amplitude (6,), N and N.m."""
        return np.concatenate([self.force_B, self.torque_B])

    def check(self, shared: SharedSettings) -> None:
        """The sweep must hold its two fades."""
        if self.duration < 2.0 * shared.rise_time and self.wrench.any():
            problem = f"must be at least twice the rise_time of {shared.rise_time:g} s, got {self.duration:g} s"
            raise ParameterError("duration", problem)

    def make_source(self, shared: SharedSettings, number: int) -> Source | None:
        """The sweep."""
        if not self.wrench.any():
            return None
        ends = (self.initial_frequency, self.final_frequency)
        return Chirp(self.wrench, *ends, self.start, self.duration, self.logarithmic, shared.rise_time)

    def explain_aliasing(self, h: float) -> str | None:
        """That the steps fold the sweep's higher end."""
        highest = max(self.initial_frequency, self.final_frequency)
        return explain_folding("the sweep's higher end", highest, h) if self.wrench.any() else None
