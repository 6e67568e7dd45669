"""The wrench on the bus: the sum of all kinds of disturbance that are switched on."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..mechanism.rotations import skew
from .gaussian import GaussianNoise
from .multisine import Multisine
from .recorded import Recording
from .settings import DisturbanceSettings, NoiseSource, Wheel
from .tones import Chirp, Tone
from .wheels import SpeedProfile, WheelSource

Array = NDArray[np.float64]
Source = Callable[[Array], Array]  # times (n,), s -> force and torque (n, 6), N and N.m in B at its origin


class Disturbance:
    """A function of time and settings alone: any times, in any order of calls, give the same values.

    Raises
    ------
    ParameterError: the recorded file cannot be used (settings have checked everything else).
    """

    def __init__(self, settings: DisturbanceSettings) -> None:
        self._sources: list[Source] = []
        if settings.noise.enabled:
            self._sources.append(_noise(settings.noise, settings.bus.com_B, settings))
        for i, wheel in enumerate(settings.wheels, 1):
            if wheel.enabled:
                self._sources.append(_wheel(wheel, (settings.seed, 100 + i), settings.rise_time))
        for tone in settings.tones:
            wrench = np.concatenate([tone.force_B, tone.torque_B])
            if wrench.any():
                self._sources.append(Tone(wrench, tone.frequency, tone.phase, settings.rise_time))
        chirp = settings.chirp
        wrench = np.concatenate([chirp.force_B, chirp.torque_B])
        if wrench.any():
            self._sources.append(
                Chirp(
                    wrench, chirp.initial_frequency, chirp.final_frequency, chirp.start, chirp.duration,
                    chirp.logarithmic, settings.rise_time,
                )
            )
        if settings.recording.path:
            recording = settings.recording
            self._sources.append(Recording(Path(recording.path), recording.repeat, recording.scale))

    def __call__(self, time: Array) -> Array:
        """Force (N) and torque (N.m) in B at its origin at ascending times (n,) in s, shape (n, 6)."""
        wrench = np.zeros((time.size, 6))
        if time.size:
            for source in self._sources:
                wrench += source(time)
        return wrench


def psd_at_origin(psd_com: Array, com: Array) -> Array:
    """Spectrum (6, 6) of a wrench at the origin from that at the point ``com`` (3,): torque + com x force."""
    move = to_origin(com)
    return np.asarray(move @ psd_com @ move.T)


def to_origin(com: Array) -> Array:
    """(6, 6): wrench at the point ``com`` (3,), m, to the same wrench at the origin."""
    move = np.eye(6)
    move[3:, :3] = skew(com)
    return move


def _noise(noise: NoiseSource, com_B: Array, settings: DisturbanceSettings) -> Source:
    kind = Multisine if noise.multisine else GaussianNoise
    psd = noise.scale**2 * psd_at_origin(noise.wrench_psd_B, com_B)
    return kind(psd, noise.band, settings.seed, noise.period, settings.rise_time)


def _wheel(wheel: Wheel, seed: tuple[int, ...], rise_time: float) -> Source:
    profile = SpeedProfile(wheel.initial_speed, wheel.final_speed, wheel.ramp_start, wheel.ramp_duration)
    return WheelSource(profile, wheel.spin_axis_B, wheel.position_B, seed, wheel.scale, rise_time)
