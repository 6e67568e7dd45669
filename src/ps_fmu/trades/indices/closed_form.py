"""The pointing indices of the isolation scenario in closed form, at one orientation, passive and active.

Noise, plant, isolator and exchange as the FMUs compute them: :mod:`...theory.sampled` from the wrench to the outputs,
the exact density of the noise, and the indices of sampled data.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ...disturbance import multisine_lines, psd_at_origin
from ...disturbance.spectrum import gaussian_density
from ...mechanism.parameters import Array, Parameters
from ...mechanism.signals import output_slices
from ...pointing import (
    AbsoluteError,
    DriftError,
    MeanError,
    PointingIndex,
    RelativeError,
    ResidualJitter,
    Smear,
)
from ...theory.loop import loop_at
from ...theory.sampled import SteppedLoop, step_loop
from ...theory.transfer_matrices import place_frequencies

STEP = 1e-4  # s, of communication
STRIDE = 5  # steps from one sample to the next: the noise ends at 1000 Hz, half the rate of the samples
PERIOD = 100.0  # s, of the noise
WINDOWS = (0.02, 0.1, 1.0)  # s
APART = 10  # windows, from the start of one to that of the other, of the drift error
ORIENTATIONS: Mapping[str, tuple[float, float, float]] = {
    "nominal": (0.0, 0.0, 0.0),
    "pitch": (0.0, -7.0, 0.0),
    "yaw": (0.0, 0.0, 14.0),
    "roll": (8.5, 0.0, 0.0),
}
"""Those of Table 2 of the paper: roll, pitch, yaw, deg."""
OUTPUTS = ("payload_rotation", "line_of_sight")
SIGNALS = tuple(f"plant.{name}.{axis}" for name, axes in zip(OUTPUTS, ("xyz", "xy"), strict=True) for axis in axes)
"""Rotation of the payload and of its line of sight, rad, in P."""


def list_indices(windows: tuple[float, ...] = WINDOWS) -> dict[str, PointingIndex]:
    """The indices by name, for windows in s."""
    found: dict[str, PointingIndex] = {"APE": AbsoluteError()}
    for window in windows:
        over = f"{1e3 * window:g} ms"
        found |= {
            f"MPE {over}": MeanError(window),
            f"RPE uniform {over}": RelativeError(window, at="uniform"),
            f"RPE end {over}": RelativeError(window, at="end"),
            f"PDE {over}": DriftError(window, APART * window),
            f"smear {over}": Smear(window),
            f"jitter {over}": ResidualJitter(window),
        }
    return found


@dataclass(frozen=True, eq=False)
class ClosedForm:
    """Density of the signals by the Gaussian noise, and the indices that follow."""

    parameters: Parameters
    loop: SteppedLoop
    points: int
    """Of the grid of frequencies, besides those around the resonances; 4000 leave an error of 2e-4 of an RMS."""

    @cached_property
    def frequency(self) -> Array:
        """(n,), Hz: dense around the resonances, and at the lower edge of the band, where the motion is."""
        low, high = self.parameters.noise.band
        grid = place_frequencies(self.loop.poles(), 0.5 * low, high * (1.0 - 1e-9), self.points, 40)
        edge = low + np.arange(-40, 60) * 0.1 * 2.0 / PERIOD
        return np.unique(np.concatenate([grid, edge[edge > 0.5 * low]]))

    @cached_property
    def density(self) -> Array:
        """(n, signals), one-sided, rad2/Hz."""
        noise, G = self.parameters.noise, self.loop.response(self.frequency)
        S = psd_at_origin(noise.wrench_psd_B, self.parameters.bus.com_B)
        own = np.einsum("nij,jk,nik->ni", G, S, G.conj()).real
        return np.asarray(own * gaussian_density(noise.band, PERIOD, self.frequency)[:, None])

    def rms(self, index: PointingIndex) -> Array:
        """RMS (signals,), rad, of an index of the samples."""
        return index.rms(self.frequency, self.density, step=STRIDE * STEP)

    def independent(self, index: PointingIndex, duration: float) -> Array:
        """Independent samples (signals,) that the mean square of an index over a record, s, is worth.

        2 (mean square)^2 over its variance, which is the integral of (W S)^2 over the duration (J. S. Bendat, A. G.
        Piersol, Random Data, 8.2), for Gaussian noise and windows that slide.
        """
        weighted = index.weight(self.frequency, STRIDE * STEP)[:, None] * self.density
        square, variance = (np.trapezoid(weighted**power, self.frequency, axis=0) for power in (1, 2))
        return np.asarray(2.0 * duration * square**2 / variance)

    def rms_of_lines(self, index: PointingIndex, seed: int, period: float) -> Array:
        """The same under the multisine of a seed, over whole periods, s: without any scatter."""
        noise = self.parameters.noise
        S = psd_at_origin(noise.wrench_psd_B, self.parameters.bus.com_B)
        frequency, wrench = multisine_lines(S, noise.band, seed, period)
        amplitude = np.einsum("nij,nj->ni", self.loop.response(frequency), wrench)
        return np.sqrt(index.variance_of_lines(frequency, amplitude, step=STRIDE * STEP))


def solve(
    parameters: Parameters, orientation_deg: tuple[float, float, float], *, active: bool, points: int = 4000
) -> ClosedForm:
    """The closed form at an orientation (roll, pitch, yaw), with or without the isolator."""
    loop = loop_at(parameters, np.radians(orientation_deg))
    slices = output_slices()
    places = np.concatenate([np.arange(slices[name].start, slices[name].stop) for name in OUTPUTS])
    controller = loop.controller if active else None
    return ClosedForm(parameters, step_loop(loop.model, controller, STEP, places), points)
