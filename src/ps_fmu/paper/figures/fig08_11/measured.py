"""Figs 8 and 11 in closed form: singular values over frequency."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from ....analyses.system import load_built_system
from ....analyses.table import AnalysisOptions
from ....cosim import Value
from ....mechanism.parameters import Array, Parameters
from ....results.tables import Table, format_angles
from ....scenarios.comparison import TARGET
from ....scenarios.shaking import Shaking, measure
from ....theory.loop import Loop, loop_at
from ....theory.sampled import LOOP_DELAY, from_base_sampled
from ....theory.transfer_matrices import Nominal
from ....theory.transmissibility import from_base, singular_values_db
from ...agreement import ALLOWED_DB, ALLOWED_DEG, BAND, COHERENCE, Agreement
from ...bus_cases import CASES, assemble_nominal, case_start_values, load_case
from ..table2.runs import ORIENTATIONS

FREQUENCY = np.geomspace(1e-2, 1e3, 3000)  # Hz
AMPLIFIED_BAND = (100.0, 700.0)  # Hz, where the paper looks for the largest amplification
SUSPENSION_BELOW = 20.0  # Hz: the resonance of the fine legs is the largest value below this frequency


@dataclass(frozen=True, eq=False)
class Curves:
    """Singular values over frequency, largest first, (n, 3), dB; m and rad count alike."""

    frequency: Array  # (n,), Hz
    theory: Array  # passive, by (38): rigid legs and payload
    passive: Array  # of the practical plant
    active: Array  # of the practical plant with the isolator, without delay

    @property
    def gain(self) -> Array:
        """What the isolator does to the largest singular value, (n,), dB; negative where it attenuates."""
        return np.asarray(self.active[:, 0] - self.passive[:, 0])

    @property
    def start(self) -> float:
        """Largest passive singular value at the lowest frequency, dB."""
        return float(self.passive[0, 0])

    @property
    def attenuation(self) -> float:
        """Largest attenuation, dB."""
        return float(-self.gain.min())

    @property
    def amplification(self) -> float:
        """Largest amplification of the largest singular value from 100 to 700 Hz, dB."""
        return float(self.amplifications[0])

    @property
    def amplifications(self) -> Array:
        """Largest amplification of each singular value from 100 to 700 Hz, (3,), dB."""
        low, high = AMPLIFIED_BAND
        return np.asarray((self.active - self.passive)[(low <= self.frequency) & (high >= self.frequency)].max(axis=0))

    @property
    def amplified_band(self) -> tuple[float, float]:
        """Where the largest singular value is amplified, around its largest amplification above 100 Hz, Hz."""
        top = int(np.where(AMPLIFIED_BAND[0] <= self.frequency, self.gain, -np.inf).argmax())
        quiet = np.flatnonzero(self.gain <= 0.0)
        return float(self.frequency[quiet[quiet < top].max()]), float(self.frequency[quiet[quiet > top].min()])


def compute_curves(
    p: Parameters, rpy_deg: tuple[float, float, float] = (0.0, 0.0, 0.0), frequency: Array = FREQUENCY
) -> Curves:
    """The curves of Figs 8 and 11 for a parameter set at an orientation, roll, pitch, yaw, deg."""
    loop, s = loop_at(p, np.radians(rpy_deg)), 2j * np.pi * frequency
    return Curves(
        frequency,
        theory=singular_values_db(Nominal(assemble_nominal(p, loop.model.dynamics.pose)).G_P(s)),
        passive=singular_values_db(from_base(loop, s, active=False)),
        active=singular_values_db(from_base(loop, s, active=True)),
    )


ORIGINAL = "OSM"
SHAKING = Shaking()


@dataclass(frozen=True)
class Setup:
    """One measurement: an orientation of Fig 8 or a case of Fig 11, without or with the isolator."""

    orientation: str = "nominal"  # of Table 2
    case: str = ORIGINAL
    active: bool = False

    @property
    def rpy_deg(self) -> tuple[float, float, float]:
        """Roll, pitch, yaw, deg."""
        return ORIENTATIONS[self.orientation]

    @property
    def mode(self) -> str:
        """``passive`` or ``active``."""
        return "active" if self.active else "passive"

    @property
    def values(self) -> dict[str, Value]:
        """Start values of the system, by ``component.variable``."""
        target = {name: float(np.radians(angle)) for name, angle in zip(TARGET, self.rpy_deg, strict=True)}
        return {**case_start_values(self.case), **target, "isolator.enabled": self.active}

    @cached_property
    def loop(self) -> Loop:
        """Plant and controller in closed form."""
        return loop_at(load_case(self.case), np.radians(self.rpy_deg))

    def closed_form(self, frequency: Array, step: float) -> NDArray[np.complex128]:
        """Base motion (m, rad; B) to payload rotation (rad; P) at frequencies (n,), Hz, (n, 3, 6); with a step, s."""
        s = 2j * np.pi * frequency
        return from_base_sampled(self.loop, s, step) if self.active else from_base(self.loop, s, active=False)


#: The four orientations, passive and active, and of the four cases those that are not among them: Fig 11 is passive.
SETUPS = (
    *(Setup(orientation, active=active) for orientation in ORIENTATIONS for active in (False, True)),
    *(Setup(case=case) for case in CASES if case != ORIGINAL),
)

Agreements = Mapping[Setup, Agreement]


def compare_setups(options: AnalysisOptions, shaking: Shaking) -> Agreements:
    """Shake the FMUs in each of :data:`SETUPS` and compare with the closed form; builds them if they are out of date.

    Raises BuildError, CosimError, ValueError.
    """
    system = load_built_system(options)
    runs = len(SETUPS) * shaking.records
    with tqdm(total=runs, unit="run", disable=not options.progress, desc="transmissibility") as bar:
        return {
            setup: Agreement(
                measure(system, shaking, setup.values, options.seed, bar.update),
                setup.closed_form(shaking.lines, shaking.step),
            )
            for setup in SETUPS
        }


def compare_step_models(measured: Agreements, step: float) -> dict[str, Agreement]:
    """The active response at (0, 0, 0) against the closed form and two coarser ones; ``step`` of communication, s."""
    setup = Setup(active=True)
    exact, loop = measured[setup], setup.loop
    s = 2j * np.pi * exact.response.frequency
    return {
        "with the step": exact,
        f"step as a delay of {LOOP_DELAY:g} steps": Agreement(
            exact.response, from_base(loop.with_delay(LOOP_DELAY * step), s, active=True)
        ),
        "step ignored": Agreement(exact.response, from_base(loop, s, active=True)),
    }


def verdict(measured: Agreements) -> str:
    """The worst of all setups, in words."""
    compared = measured.values()
    worst_db = max(measured, key=lambda setup: measured[setup].largest_db.max())
    worst_deg = max(measured, key=lambda setup: measured[setup].largest_deg.max())
    return (
        f"Allowed are {ALLOWED_DB:g} dB and {ALLOWED_DEG:g} deg from {BAND[0]:g} to {BAND[1]:g} Hz wherever the "
        f"coherence exceeds {COHERENCE:g}, as it does at {sum(a.checked.sum() for a in compared)} of "
        f"{sum(a.within.sum() for a in compared)} lines (lowest: {min(a.lowest_coherence for a in compared):.6f}). "
        f"This {'holds' if all(a.holds for a in compared) else 'does not hold'}: the largest deviation of a singular "
        f"value is {measured[worst_db].largest_db.max():.3f} dB ({describe(worst_db)}), of its phase "
        f"{measured[worst_deg].largest_deg.max():.2f} deg ({describe(worst_deg)})."
    )


def agreement_table(measured: Agreements) -> Table:
    """Largest deviations, a row for each setup."""
    header = ("orientation (deg)", "case", "isolator", *_DEVIATIONS, "allowed")
    rows = [
        (format_angles(s.rpy_deg), s.case, s.mode, *_deviations(a), "holds" if a.holds else "does not hold")
        for s, a in measured.items()
    ]
    caption = (
        f"FMUs against the closed form: largest deviation of singular values and their phases, {BAND[0]:g} to "
        f"{BAND[1]:g} Hz; allowed: {ALLOWED_DB:g} dB, {ALLOWED_DEG:g} deg where coherence exceeds {COHERENCE:g}"
    )
    return Table(caption, header, rows)


def step_table(found: Mapping[str, Agreement]) -> Table:
    """Largest deviations from the closed forms of :func:`compare_step_models`."""
    rows = [(name, *_deviations(agreement)) for name, agreement in found.items()]
    caption = "What the step does: FMUs at (0, 0, 0), active, against three closed forms"
    return Table(caption, ("closed form", *_DEVIATIONS), rows)


_DEVIATIONS = (
    "coherent lines", "lowest coherence", "value 1 (dB)", "2 (dB)", "3 (dB)", "phase 1 (deg)", "2 (deg)", "3 (deg)",
)  # fmt: skip


def _deviations(a: Agreement) -> tuple[str, ...]:
    return (
        f"{a.checked.sum()} of {a.within.sum()}",
        f"{a.lowest_coherence:.6f}",
        *(f"{value:.3f}" for value in a.largest_db),
        *(f"{value:.2f}" for value in a.largest_deg),
    )


def describe(setup: Setup) -> str:
    """The setup in words."""
    return f"{setup.case} at {format_angles(setup.rpy_deg)} deg, {setup.mode}"
