"""Figs 8 and 11: from base motion to payload rotation, in closed form, and as measured on the running FMUs."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from ..manipulator.frequency import Nominal
from ..manipulator.parameters import Array, Parameters, load
from ..manipulator.sampled import from_base_sampled
from ..manipulator.stability import loop_at
from ..manipulator.transmissibility import from_base, singular_values_db
from ..pointing.report import Picture, Table
from ..scenarios.comparison import TARGET, angles
from ..scenarios.table2 import ORIENTATIONS
from .agreement import ALLOWED_DB, ALLOWED_DEG, BAND, Agreement
from .command import Options
from .measured import Shaking, measure
from .result import Analysis, Finding
from .stability import CASES, nominal_system, parameters_of

FREQUENCY = np.geomspace(1e-2, 1e3, 3000)  # Hz
AMPLIFIED_BAND = (100.0, 700.0)  # Hz, where the paper looks for the largest amplification
SUSPENSION_BELOW = 20.0  # Hz: the resonance of the fine legs is the largest value below


@dataclass(frozen=True, eq=False)
class Curves:
    """Singular values at :data:`FREQUENCY`, largest first, (n, 3), dB; m and rad count alike."""

    theory: Array
    """Passive, by (38): rigid legs and payload."""
    passive: Array
    """Of the practical plant."""
    active: Array
    """Of the practical plant with the isolator, without delay."""

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
        """Largest amplification from 100 to 700 Hz, dB."""
        low, high = AMPLIFIED_BAND
        return float(self.gain[(low <= FREQUENCY) & (high >= FREQUENCY)].max())


def curves(p: Parameters, rpy_deg: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Curves:
    """The curves of Figs 8 and 11 for a parameter set at an orientation, roll, pitch, yaw, deg."""
    loop, s = loop_at(p, np.radians(rpy_deg)), 2j * np.pi * FREQUENCY
    return Curves(
        theory=singular_values_db(Nominal(nominal_system(p, loop.model.dynamics.pose)).G_P(s)),
        passive=singular_values_db(from_base(loop, s, active=False)),
        active=singular_values_db(from_base(loop, s, active=True)),
    )


def analyse(options: Options, shaking: Shaking | None = None) -> Analysis:
    """Compute the curves, measure them at (0, 0, 0), compare, draw and word it."""
    from .transmissibility_plots import cases_figure, measured_figure, orientations_figure

    at_orientations = {name: curves(load(), rpy) for name, rpy in ORIENTATIONS.items()}
    of_cases = {case: curves(parameters_of(case)) for case in CASES}
    measured = agreements(options, shaking or Shaking())
    figures: list[tuple[str, str, Callable[[Path], None]]] = [
        (
            "orientations",
            "Fig 8: singular values at the four orientations.",
            partial(orientations_figure, found=at_orientations),
        ),
        (
            "cases",
            "Fig 11: largest singular value, passive, in the four cases.",
            partial(cases_figure, found=of_cases),
        ),
        (
            "measured",
            "As measured on the running FMUs, and its deviation from the closed form.",
            partial(measured_figure, measured=measured),
        ),
    ]
    pictures = []
    for name, caption, paint in figures:
        path = options.output / f"transmissibility_{name}.png"
        paint(path)
        pictures.append(Picture(path, caption))
    return Analysis(
        name="transmissibility",
        title="Transmissibility: Figs 8 and 11",
        text=_text(measured),
        findings=findings(at_orientations, measured),
        tables=[_orientation_table(at_orientations), _case_table(of_cases), _agreement_table(measured)],
        pictures=pictures,
        data={
            "orientations": {name: _entry(c) for name, c in at_orientations.items()},
            "cases": {case: {"largest_db": float(c.passive.max())} for case, c in of_cases.items()},
            "measured": {name: agreement.entry for name, agreement in measured.items()},
        },
    )


def findings(at_orientations: Mapping[str, Curves], measured: Mapping[str, Agreement] | None = None) -> list[Finding]:
    """The numbers of Fig 8; co-simulated ones only if they were measured."""
    found = at_orientations.values()
    start = attenuation = None
    if measured:
        passive, active = (singular_values_db(measured[case].response.matrix)[:, 0] for case in ("passive", "active"))
        start, attenuation = float(passive[0]), float((passive - active).max())
    return [
        Finding("fig8.start", max((c.start for c in found), key=abs), start),
        Finding(
            "fig8.attenuation",
            min(c.attenuation for c in found),
            attenuation,
            "least of the four orientations; co-simulated: at (0, 0, 0), with what a communication step costs",
        ),
        Finding("fig8.amplification", max(c.amplification for c in found), remark="largest of the four orientations"),
    ]


def agreements(options: Options, shaking: Shaking, orientation: str = "nominal") -> dict[str, Agreement]:
    """Shake the FMUs, passive and active, and compare with closed forms; builds them if they are out of date.

    The active response is also compared with two coarser closed forms, to show what the step does.
    """
    from tqdm import tqdm

    from ..cosim import read_system
    from ..fmu.build import default_fmus
    from ..scenarios.sources import ensure_built

    ensure_built(options.fmus, default_fmus().parent)
    system = read_system(options.system, options.fmus)
    rpy = np.radians(ORIENTATIONS[orientation])
    target = {name: float(angle) for name, angle in zip(TARGET, rpy, strict=True)}
    with tqdm(total=2 * shaking.records, unit="run", disable=not options.progress, desc="transmissibility") as bar:
        passive, active = (
            measure(system, shaking, {**target, "isolator.enabled": on}, options.seed, bar.update)
            for on in (False, True)
        )
    loop, s, h = loop_at(load(), rpy), 2j * np.pi * shaking.lines, shaking.step
    return {
        "passive": Agreement(passive, from_base(loop, s, active=False)),
        "active": Agreement(active, from_base_sampled(loop, s, h)),
        "active, step as a delay of 1.5 steps": Agreement(active, from_base(loop.with_delay(1.5 * h), s, active=True)),
        "active, step ignored": Agreement(active, from_base(loop, s, active=True)),
    }


def _text(measured: Mapping[str, Agreement]) -> list[str]:
    passive, active = measured["passive"], measured["active"]
    both = [("passive", passive), ("active", active)]
    return [
        "Closed form: singular values of the matrix from base motion (m, rad, counted alike) to payload rotation. "
        "Theory is (38), with rigid legs and payload; the practical plant has truss modes and flexible coarse rods, "
        "and with the isolator the filters of (55).",
        "The passive curve does not depend on the bus: in Fig 11 OSM and LSM are one curve, as are LDOSM and LDLSM. "
        "More damping in the fine legs takes away the resonance of the suspension, and changes little above it.",
        "Measured: the four FMUs run at the usual communication step, shaken by a multisine along one axis at a time; "
        "the matrix is found by least squares over all runs. Model, FMUs and master are checked as one. "
        "There is no noise: what coherence lacks to one are transients of bus and suspension. "
        + " ".join(
            f"{name.capitalize()}, singular values and their phases are within {a.largest_db.max():.3f} dB and "
            f"{a.largest_deg.max():.2f} deg of the closed form at {a.checked.sum()} lines from {BAND[0]:g} to "
            f"{BAND[1]:g} Hz (lowest coherence {a.entry['lowest_coherence']:.6f})."
            for name, a in both
        ),
        "Passive, both motions are outputs of the plant at the same instant, so that no delay is between them. With "
        "the isolator the communication step counts: it holds acceleration and force, and the plant's acceleration at "
        "the end of a step is that of the forces held over it. The closed form has all three; a pure delay of 1.5 "
        "steps does for the largest singular value, not for the smallest near the modes of the bus.",
    ]


def _orientation_table(found: Mapping[str, Curves]) -> Table:
    header = ("orientation (deg)", "start (dB)", "largest attenuation (dB)", "largest amplification, 100-700 Hz (dB)")
    rows = [
        (angles(ORIENTATIONS[name]), f"{c.start:.4f}", f"{c.attenuation:.2f}", f"{c.amplification:.2f}")
        for name, c in found.items()
    ]
    return Table("Fig 8, practical plant, largest singular value; published: 0, over 50, under 9 dB", header, rows)


def _case_table(found: Mapping[str, Curves]) -> Table:
    header = (
        "case", "resonance (Hz)", "there (dB)", "at 20 Hz (dB)",
        "by (38): resonance (Hz)", "there (dB)", "at 20 Hz (dB)",
    )  # fmt: skip
    rows = [
        (case, *(text for curve in (c.passive[:, 0], c.theory[:, 0]) for text in _resonance(curve)))
        for case, c in found.items()
    ]
    return Table("Fig 11: passive, largest singular value", header, rows)


def _resonance(curve: Array) -> tuple[str, str, str]:
    low = FREQUENCY < SUSPENSION_BELOW
    top = int(curve[low].argmax())
    return f"{FREQUENCY[top]:.2f}", f"{curve[top]:.2f}", f"{np.interp(20.0, FREQUENCY, curve):.2f}"


def _agreement_table(measured: Mapping[str, Agreement]) -> Table:
    header = (
        "measured against", "lines", "lowest coherence",
        "deviation of singular value 1 (dB)", "2", "3", "of its phase 1 (deg)", "2", "3",
    )  # fmt: skip
    rows = [
        (
            name,
            f"{a.checked.sum()}",
            f"{a.response.coherence[a.checked].min():.6f}",
            *(f"{value:.3f}" for value in a.largest_db),
            *(f"{value:.2f}" for value in a.largest_deg),
        )
        for name, a in measured.items()
    ]
    caption = (
        f"FMUs at (0, 0, 0) against the closed form: largest deviation from {BAND[0]:g} to {BAND[1]:g} Hz; "
        f"allowed: {ALLOWED_DB:g} dB, {ALLOWED_DEG:g} deg for the first two rows"
    )
    return Table(caption, header, rows)


def _entry(c: Curves) -> dict[str, object]:
    return {"start_db": c.start, "attenuation_db": c.attenuation, "amplification_db": c.amplification}
