"""The pointing indices of the isolation scenario at one orientation, passive and active: closed form, and the FMUs.

Closed form: noise, plant, isolator and exchange as the FMUs compute them, by :mod:`...theory.sampled` from the wrench
to the outputs, the exact density of the noise, and the indices of sampled data.  Of the running FMUs each index has
the interval that is stated for it.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ...cosim import System, Value
from ...disturbance import psd_at_origin
from ...disturbance.spectrum import edge_frequencies, gaussian_density
from ...mechanism.parameters import Array, Parameters, load
from ...mechanism.signals import output_slices
from ...pointing import (
    AbsoluteError,
    DriftError,
    MeanError,
    PointingIndex,
    RelativeError,
    ResidualJitter,
    Smear,
    Statement,
    gaussian_rms,
    windows_rms,
)
from ...results.observers.sampler import SampleObserver
from ...runs.runner import compute
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
SETTLING = 12.0  # s: the rise of the disturbance, and 4.5 time constants of the suspension
JOINT = 0.999  # probability with which all intervals together hold the closed form
Case = tuple[str, bool]  # orientation, and whether the isolator is on


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
        edge = edge_frequencies(self.parameters.noise.band, PERIOD)
        return np.unique(np.concatenate([grid, edge[edge < high]]))

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


def solve(
    parameters: Parameters, orientation_deg: tuple[float, float, float], *, active: bool, points: int = 4000
) -> ClosedForm:
    """The closed form at an orientation (roll, pitch, yaw), with or without the isolator."""
    loop = loop_at(parameters, np.radians(orientation_deg))
    slices = output_slices()
    places = np.concatenate([np.arange(slices[name].start, slices[name].stop) for name in OUTPUTS])
    controller = loop.controller if active else None
    return ClosedForm(parameters, step_loop(loop.model, controller, STEP, places), points)


@dataclass(frozen=True)
class Comparison:
    """An index of a signal on the FMUs and in closed form, rad."""

    orientation: str
    active: bool
    index: str
    signal: str
    stated: Statement  # RMS with its interval, at the confidence of all comparisons together
    usual: Statement  # the same with an interval of 95 %
    expected: float  # in closed form
    known: Statement
    """At the confidence of all comparisons together, too, but with the number of independent samples in closed form."""

    @property
    def known_holds(self) -> bool:
        """The interval of :attr:`known` has the closed form in it."""
        return self.known.lower <= self.expected <= self.known.upper

    @property
    def holds(self) -> bool:
        """The interval has the closed form in it."""
        return self.stated.lower <= self.expected <= self.stated.upper

    @property
    def usually_holds(self) -> bool:
        """The interval of 95 % has."""
        return self.usual.lower <= self.expected <= self.usual.upper


def list_cases() -> list[Case]:
    """Each orientation passive, then active."""
    return [(name, active) for name in ORIENTATIONS for active in (False, True)]


def record(system: System, case: Case, duration: float, seed: int, values: Mapping[str, Value] | None = None) -> Array:
    """Samples (n, signals), rad, of a run of ``duration``, s, after the settling.  Raises CosimError."""
    name, active = case
    angles = np.radians(ORIENTATIONS[name]).tolist()
    targets = {f"commander.target.{axis}": angle for axis, angle in zip(("roll", "pitch", "yaw"), angles, strict=True)}
    given = {"disturbance.seed": seed, "isolator.enabled": active, **targets, **(values or {})}
    rows = round(SETTLING / STEP) + STRIDE * np.arange(round(duration / (STRIDE * STEP)))
    samples = compute(
        system.with_parameters(given), STEP, round((SETTLING + duration) / STEP) * STEP,
        lambda columns: SampleObserver(columns, SIGNALS, rows.tolist()), only=SIGNALS,
    )  # fmt: skip
    return samples.values(*SIGNALS)


def measure(
    system: System,
    indices: Mapping[str, PointingIndex],
    duration: float,
    seed: int,
    points: int = 4000,
    progress: Callable[[], object] | None = None,
) -> list[Comparison]:
    """Run all cases for ``duration``, s, after the settling, and compare each index.  Raises CosimError."""
    cases = list_cases()
    confidence = 1.0 - (1.0 - JOINT) / (len(cases) * len(indices) * len(SIGNALS))
    parameters = load()

    def run(case: Case) -> list[Comparison]:
        found = record(system, case, duration, seed)
        theory = solve(parameters, ORIENTATIONS[case[0]], active=case[1], points=points)
        return list(_compare(case, found, theory, indices, confidence))

    compared: list[Comparison] = []
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        for each in pool.map(run, cases):
            compared += each
            if progress:
                progress()
    return compared


def _compare(
    case: Case, found: Array, theory: ClosedForm, indices: Mapping[str, PointingIndex], confidence: float
) -> Iterator[Comparison]:
    """What a run has, with the closed form.

    The record's mean is taken out: it is a bias, which no density shows.  The isolator's integrators, whose corner lies
    at 1e-4 Hz, take half an hour to forget how the disturbance began: some 5e-9 rad.
    """
    found = found - found.mean(axis=0)
    for name, index in indices.items():
        window = getattr(index, "window", None)
        values = index.values(found, STRIDE * STEP, stride=round(window / (STRIDE * STEP)) if window else 1)
        expected, independent = theory.rms(index), theory.independent(index, len(found) * STRIDE * STEP)
        if values.shape[1] == 1:  # one value of a window: the sum of two variances is on the safe side
            independent = 1.0 / (1.0 / independent + 1.0 / len(values))
        for k, signal in enumerate(SIGNALS):
            stated, usual = (windows_rms(values[:, :, k], level) for level in (confidence, 0.95))
            known = gaussian_rms(stated.value, float(independent[k]), confidence)
            yield Comparison(case[0], case[1], name, signal, stated, usual, float(expected[k]), known)


def share_held(compared: Sequence[Comparison]) -> float:
    """Share of the intervals of 95 % that have the closed form in them."""
    return float(np.mean([each.usually_holds for each in compared]))
