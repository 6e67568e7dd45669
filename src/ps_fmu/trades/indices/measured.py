"""The indices on the running FMUs, each with the interval that is stated for it."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from ...cosim import System, Value
from ...mechanism.parameters import Array, load
from ...pointing import PointingIndex, Statement, gaussian_rms, windows_rms
from ...results.observers.sampler import SampleObserver
from ...runs.runner import compute
from .closed_form import ORIENTATIONS, SIGNALS, STEP, STRIDE, ClosedForm, solve

SETTLING = 12.0  # s: the rise of the disturbance, and 4.5 time constants of the suspension
JOINT = 0.999  # probability with which all intervals together hold the closed form
Case = tuple[str, bool]
"""Orientation, and whether the isolator is on."""


@dataclass(frozen=True)
class Comparison:
    """An index of a signal on the FMUs and in closed form, rad."""

    orientation: str
    active: bool
    index: str
    signal: str
    stated: Statement
    """RMS with its interval, at the confidence of all comparisons together."""
    usual: Statement
    """The same with an interval of 95 %."""
    expected: float
    """In closed form."""
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
