"""Sines: a wrench of fixed direction whose size follows a sine."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ...mechanism.parameters import Parameters
from ...mechanism.quantities import Array, quantity
from ..kind import Kind, SharedSettings, Source, explain_folding
from ..smooth import ramp


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
    place: ClassVar[int] = 30

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
