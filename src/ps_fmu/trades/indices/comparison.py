"""The pointing indices of a system at some orientations, passive and active: closed form, and the FMUs.

Closed form: noise, plant, isolator and exchange as the FMUs compute them, as for budgets (:mod:`..budget`): from the
wrench to the outputs, the exact density of the noise, and the indices of sampled data.  Of the running FMUs each index
has the interval that is stated for it.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from ...cosim import System, Value
from ...interface.linear_system import Circuit
from ...interface.system_model import POINTING, TRACKER, read_model
from ...mechanism.quantities import Array
from ...mechanism.rotations import from_rotation_matrix, rotation_matrix
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
from ..budget.results import BudgetError, list_sources, select_signals
from ..sensors.results import settle_highpass

STEP = 1e-4  # s, of communication
STRIDE = 5  # steps from one sample to the next: the noise ends at 1000 Hz, half the rate of the samples
WINDOWS = (0.02, 0.1, 1.0)  # s
APART = 10  # windows, from the start of one to that of the other, of the drift error
ORIENTATIONS: Mapping[str, tuple[float, float, float]] = {
    "nominal": (0.0, 0.0, 0.0),
    "pitch": (0.0, -7.0, 0.0),
    "yaw": (0.0, 0.0, 14.0),
    "roll": (8.5, 0.0, 0.0),
}
"""Those of Table 2 of the paper: roll, pitch, yaw, deg."""
Orientations = Mapping[str, tuple[float, float, float]]
SIGNALS = tuple(
    f"plant.{name}.{axis}" for name, axes in (("payload_rotation", "xyz"), ("line_of_sight", "xy")) for axis in axes
)
"""Rotation of the payload and of its line of sight, rad, in P."""
TARGET = tuple(f"commander.target.{angle}" for angle in ("roll", "pitch", "yaw"))
SETTLING = 12.0  # s: the rise of the disturbance, and 4.5 time constants of the suspension
SLOWEST = 0.01  # Hz: a slower high-pass of the isolator does not settle; of the default one see :func:`_compare`
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

    frequency: Array  # (n,), Hz
    density: Array  # (n, signals), one-sided, rad2/Hz

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


def set_case(system: System, case: Case, orientations: Orientations = ORIENTATIONS) -> System:
    """The system at an orientation, with the isolator, and a line-of-sight loop, or without both.

    The target of a tracker is where the payload looks then, if the base has turned nowhere.
    """
    angles = np.radians(orientations[case[0]])
    values: dict[str, Value] = dict(zip(TARGET, angles.tolist(), strict=True))
    attitude = from_rotation_matrix(rotation_matrix(angles)).tolist()
    for tracker in (c.name for c in system.components if c.source.stem == TRACKER):
        values |= {f"{tracker}.target_attitude.{k}": number for k, number in zip("wxyz", attitude, strict=True)}
    loops = [c.name for c in system.components if c.source.stem == POINTING]
    values |= {f"{name}.enabled": False for name in loops if not case[1]}
    return system.with_parameters({"isolator.enabled": case[1], **values})


def read_orientation(system: System) -> Orientations:
    """The target of the system's commander alone."""
    given = system.component("commander").parameters
    entries = [given.get(name.removeprefix("commander.")) for name in TARGET]
    roll, pitch, yaw = (0.0 if entry is None else float(np.degrees(float(entry.value))) for entry in entries)
    return {"target": (roll, pitch, yaw)}


def find_settling(system: System) -> float:
    """Time, s, that runs need to settle: also four time constants of the isolator's high-pass, if that is not slow."""
    highpass = read_model(system, STEP).turned["isolator.filters.highpass_frequency"].value
    slow = highpass < SLOWEST
    return SETTLING if slow else max(SETTLING, settle_highpass(highpass))


def solve(
    system: System, case: Case, points: int = 4000, orientations: Orientations = ORIENTATIONS
) -> ClosedForm:
    """The closed form of a case, as :mod:`..budget` makes it.

    ``points``: of the grid of frequencies, besides those around the resonances; 4000 leave an error of 2e-4 of an RMS.
    Raises :class:`..budget.results.BudgetError` for sines, wheels and recordings, of which there is no density.
    """
    circuit = Circuit(read_model(set_case(system, case, orientations), STEP), case[1])
    sources = list_sources(circuit, [name.removeprefix("plant.") for name in SIGNALS], points)[1]
    if lines := [source.name for source in sources if source.lines]:
        raise BudgetError(f"{lines[0]}: it has no density, and no interval in closed form; switch it off")
    frequency = sources[0].frequency if len(sources) == 1 else np.unique(np.concatenate([s.frequency for s in sources]))
    total = np.zeros((len(frequency), len(SIGNALS)))
    for source in sources:
        own = np.stack([select_signals(source, [k]).density() for k in range(len(SIGNALS))], axis=1)
        for k in range(len(SIGNALS)):
            total[:, k] += np.interp(frequency, source.frequency, own[:, k], left=0.0, right=0.0)
    sampled = frequency < 0.5 / (STRIDE * STEP)
    return ClosedForm(frequency[sampled], total[sampled])


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


def list_cases(orientations: Orientations = ORIENTATIONS) -> list[Case]:
    """Each orientation passive, then active."""
    return [(name, active) for name in orientations for active in (False, True)]


def record(
    system: System,
    case: Case,
    duration: float,
    seed: int,
    values: Mapping[str, Value] | None = None,
    orientations: Orientations = ORIENTATIONS,
    settling: float = SETTLING,
) -> Array:
    """Samples (n, signals), rad, of a run of ``duration``, s, after the settling.  Raises CosimError."""
    given = {"disturbance.seed": seed, **(values or {})}
    rows = round(settling / STEP) + STRIDE * np.arange(round(duration / (STRIDE * STEP)))
    samples = compute(
        set_case(system, case, orientations).with_parameters(given), STEP, round((settling + duration) / STEP) * STEP,
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
    orientations: Orientations = ORIENTATIONS,
) -> list[Comparison]:
    """Run all cases for ``duration``, s, after the settling, and compare each index.  Raises CosimError."""
    cases, settling = list_cases(orientations), find_settling(system)
    confidence = 1.0 - (1.0 - JOINT) / (len(cases) * len(indices) * len(SIGNALS))

    def run(case: Case) -> list[Comparison]:
        found = record(system, case, duration, seed, None, orientations, settling)
        return list(_compare(case, found, solve(system, case, points, orientations), indices, confidence))

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

    The record's mean is taken out: it is a bias, which no density shows.  The isolator's integrators, with a high-pass
    of 1e-4 Hz, take half an hour to forget how the disturbance began: some 5e-9 rad.
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
