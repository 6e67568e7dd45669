"""Sines and a sweep: a wrench of fixed direction whose size follows a sine of constant or changing frequency."""

from __future__ import annotations

from ctypes import c_double
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ..mechanism.parameters import Parameters
from ..mechanism.quantities import Array, ParameterError, quantity
from ..numerics import library
from .kind import Kind, SharedSettings, Source


class Tone(Source):
    """f(t) = d2/dt2 (W G) with G = -A sin(w t + phase) / w^2: a sine that pushes a free body without drift.

    Parameters
    ----------
    wrench: amplitude A (6,), N and N.m in B at its origin.
    frequency: above 0, Hz.
    phase: rad.
    rise_time: of the ramp W, s; stretched to one period where that is longer, since the momentum of a sine is
        proportional to its period.
    """

    function: ClassVar[str] = "add_tone"

    def __init__(self, wrench: Array, frequency: float, phase: float = 0.0, rise_time: float = 2.0) -> None:
        self.words = library.Tone((c_double * 6)(*wrench), frequency, phase / (2.0 * np.pi))
        self.words.rise_time = max(rise_time, 1.0 / frequency)


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

    def find_highest(self) -> tuple[float, str] | None:
        """Its frequency."""
        return (self.frequency, "the sine") if self.force_B.any() or self.torque_B.any() else None


class Chirp(Source):
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

    function: ClassVar[str] = "add_chirp"

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
        rate = np.log(final / initial) / duration if logarithmic and final != initial else 0.0  # 1/s
        self.words = library.Chirp((c_double * 6)(*wrench), initial, final, start, duration, rise_time, rate)


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

    def find_highest(self) -> tuple[float, str] | None:
        """The higher end."""
        highest = max(self.initial_frequency, self.final_frequency)
        return (highest, "the sweep's higher end") if self.wrench.any() else None
