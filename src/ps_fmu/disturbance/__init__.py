"""Disturbance wrenches on the bus: noise, reaction wheels, sines, sweeps, recordings, and their sum.

Every kind maps ascending times (n,) in s to force (N) and torque (N.m) in B at its origin, (n, 6): a function
of time and parameters alone.  Noise and sines are exact second time derivatives of bounded signals that start
from zero, so that a free spacecraft pushed from rest does not drift.
"""

from .combine import Disturbance, Source, psd_at_origin, to_origin
from .gaussian import GaussianNoise
from .multisine import Multisine, multisine_lines
from .recorded import Recording
from .settings import DisturbanceSettings, default_settings
from .tones import Chirp, Tone
from .wheels import Harmonics, SpeedProfile, WheelSource, read_harmonics

__all__ = [
    "Chirp",
    "Disturbance",
    "DisturbanceSettings",
    "GaussianNoise",
    "Harmonics",
    "Multisine",
    "Recording",
    "Source",
    "SpeedProfile",
    "Tone",
    "WheelSource",
    "default_settings",
    "multisine_lines",
    "psd_at_origin",
    "read_harmonics",
    "to_origin",
]
