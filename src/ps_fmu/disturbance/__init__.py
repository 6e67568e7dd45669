"""Disturbance wrenches on the bus: noise, reaction wheels, sines, sweeps, recordings, and their sum.

Every kind maps ascending times (n,) in s to force (N) and torque (N.m) in B at its origin, (n, 6): a function
of time and parameters alone.  Noise and sines are exact second time derivatives of bounded signals that start
from zero, so that a free spacecraft pushed from rest does not drift.
"""

from .multisine import multisine_lines
from .spectrum import psd_at_origin, to_origin
from .total import Disturbance, DisturbanceSettings, default_settings

__all__ = [
    "Disturbance",
    "DisturbanceSettings",
    "default_settings",
    "multisine_lines",
    "psd_at_origin",
    "to_origin",
]
