"""Figs 8 and 11 measured on the running FMUs, and how far they are from the closed form."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from ....cosim import Value, read_system
from ....mechanism.parameters import Array
from ....results.tables import Table, format_angles
from ....runs.comparison import TARGET
from ....runs.shaking import Shaking, measure
from ....theory.loop import Loop, loop_at
from ....theory.sampled import from_base_sampled
from ....theory.transmissibility import from_base
from ...agreement import ALLOWED_DB, ALLOWED_DEG, BAND, COHERENCE, Agreement
from ...analysis import AnalysisOptions
from ...bus_cases import CASES, case_start_values, load_case
from ...cosimulation import load_built_system
from ...jobs import Job
from ..table2.closed_form import LOOP_DELAY, ORIENTATIONS

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


def list_jobs(options: AnalysisOptions) -> list[Job]:
    """A job for each of :data:`SETUPS`, which measures it as :func:`compare_setups` does."""
    return [Job(name_job(setup), 8.0, measure_setup, (options, setup)) for setup in SETUPS]


def name_job(setup: Setup) -> str:
    """Name of the job that measures a setup."""
    return f"transmissibility: {describe(setup)}"


def measure_setup(options: AnalysisOptions, setup: Setup, shaking: Shaking = SHAKING) -> Agreement:
    """Shake the FMUs, which are built, in a setup and compare with the closed form.  Raises CosimError, ValueError."""
    system = read_system(options.system, options.fmus)
    response = measure(system, shaking, setup.values, options.seed, threads=options.threads)
    return Agreement(response, setup.closed_form(shaking.lines, shaking.step))


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


def entries(measured: Agreements) -> list[dict[str, object]]:
    """For the JSON file."""
    return [{"orientation_deg": s.rpy_deg, "case": s.case, "isolator": s.mode, **a.entry} for s, a in measured.items()]


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
