"""Figs 8 and 11: from base motion to payload rotation, in closed form, and as measured on the running FMUs."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from ....mechanism.parameters import Array, Parameters, load
from ....results.report import draw_pictures
from ....results.tables import Table, format_angles
from ....theory.loop import loop_at
from ....theory.transfer_matrices import Nominal
from ....theory.transmissibility import from_base, singular_values_db
from ...agreement import Agreement
from ...command import Options
from ...multisine import Shaking
from ...result import Analysis, Finding
from ...support_modules import CASES, parameters_of
from ..fig10.analysis import nominal_system
from ..table2.scenario import ORIENTATIONS
from .measured import Measured, Setup, agreement_table, agreements, entries, step_agreements, step_table, verdict

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
        """Largest amplification of the largest singular value from 100 to 700 Hz, dB."""
        return float(self.amplifications[0])

    @property
    def amplifications(self) -> Array:
        """Largest amplification of each singular value from 100 to 700 Hz, (3,), dB."""
        low, high = AMPLIFIED_BAND
        return np.asarray((self.active - self.passive)[(low <= FREQUENCY) & (high >= FREQUENCY)].max(axis=0))

    @property
    def amplified_band(self) -> tuple[float, float]:
        """Where the largest singular value is amplified, around its largest amplification above 100 Hz, Hz."""
        top = int(np.where(AMPLIFIED_BAND[0] <= FREQUENCY, self.gain, -np.inf).argmax())
        quiet = np.flatnonzero(self.gain <= 0.0)
        return float(FREQUENCY[quiet[quiet < top].max()]), float(FREQUENCY[quiet[quiet > top].min()])


def curves(p: Parameters, rpy_deg: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Curves:
    """The curves of Figs 8 and 11 for a parameter set at an orientation, roll, pitch, yaw, deg."""
    loop, s = loop_at(p, np.radians(rpy_deg)), 2j * np.pi * FREQUENCY
    return Curves(
        theory=singular_values_db(Nominal(nominal_system(p, loop.model.dynamics.pose)).G_P(s)),
        passive=singular_values_db(from_base(loop, s, active=False)),
        active=singular_values_db(from_base(loop, s, active=True)),
    )


def analyse(options: Options, shaking: Shaking | None = None) -> Analysis:
    """Compute the curves, measure them on the FMUs, compare, draw and word it."""
    from .plots import cases_figure, deviation_figure, measured_figure, orientations_figure

    shaking = shaking or Shaking()
    at_orientations = {name: curves(load(), rpy) for name, rpy in ORIENTATIONS.items()}
    of_cases = {case: curves(parameters_of(case)) for case in CASES}
    measured = agreements(options, shaking)
    of_step = step_agreements(measured, shaking.step)
    figures: list[tuple[str, str, Callable[[Path], None]]] = [
        (
            "orientations",
            "Fig 8: singular values at the four orientations.",
            partial(orientations_figure, found=at_orientations),
        ),
        (
            "cases",
            "Fig 11: largest singular value, passive, in the four cases, in closed form and as measured on the FMUs.",
            partial(cases_figure, found=of_cases, measured=measured),
        ),
        (
            "measured",
            "Fig 8 as measured on the running FMUs, in the band that is shaken.",
            partial(measured_figure, measured=measured),
        ),
        (
            "deviation",
            "Deviation of what was measured from the closed form: the largest of the three singular values.",
            partial(deviation_figure, measured=measured),
        ),
    ]
    return Analysis(
        name="transmissibility",
        title="Transmissibility: Figs 8 and 11",
        text=paragraphs(measured),
        findings=findings(at_orientations, of_cases, measured),
        tables=tables(at_orientations, of_cases, measured, of_step),
        pictures=draw_pictures(options.output, "transmissibility", figures),
        data={
            "orientations": {name: _entry(c) for name, c in at_orientations.items()},
            "cases": {case: {"largest_db": float(c.passive.max())} for case, c in of_cases.items()},
            "measured": entries(measured),
            "measured_active_by_closed_form": {name: agreement.entry for name, agreement in of_step.items()},
        },
    )


def findings(
    at_orientations: Mapping[str, Curves], of_cases: Mapping[str, Curves], measured: Measured | None = None
) -> list[Finding]:
    """What the paper says of Figs 8 and 11; co-simulated values only if they were measured."""
    return [*_of_figure_8(at_orientations, measured or {}), *_of_figure_11(of_cases, measured or {})]


def _of_figure_8(at_orientations: Mapping[str, Curves], measured: Measured) -> list[Finding]:
    found = at_orientations.values()
    start = attenuation = None
    if measured:
        passive, active = (
            np.array([_measured_db(measured[Setup(name, active=on)])[:, 0] for name in at_orientations])
            for on in (False, True)
        )
        start, attenuation = float(max(passive[:, 0], key=abs)), float((passive - active).max(axis=1).min())
    bands = np.array([c.amplified_band for c in found])
    _, second, third = np.max([c.amplifications for c in found], axis=0)
    return [
        Finding("fig8.start", max((c.start for c in found), key=abs), start, "farthest from 0 of four orientations"),
        Finding(
            "fig8.attenuation",
            min(c.attenuation for c in found),
            attenuation,
            "least of the four orientations; co-simulated: with what a communication step costs",
        ),
        Finding(
            "fig8.amplification",
            max(c.amplification for c in found),
            remark="largest singular value, largest of the four orientations; the second and the third are amplified "
            f"by up to {second:.1f} and {third:.1f} dB, at minima of the passive curves",
        ),
        Finding("fig8.amplified_from", float(bands[:, 0].min()), remark="largest singular value, lowest of the four"),
        Finding("fig8.amplified_to", float(bands[:, 1].max()), remark="largest singular value, highest of the four"),
    ]


def _of_figure_11(of_cases: Mapping[str, Curves], measured: Measured) -> list[Finding]:
    passive = {case: c.passive for case, c in of_cases.items()}
    runs = {setup.case: _measured_db(a) for setup, a in measured.items() if setup == Setup(case=setup.case)}
    most = _farthest_below(passive["LDOSM"], passive["OSM"])
    remark = (
        f"from {passive['OSM'][most, 0]:.1f} to {passive['LDOSM'][most, 0]:.1f} dB; the largest values of the curves "
        f"are {_suspension_peak(passive['OSM']):.1f} and {_suspension_peak(passive['LDOSM']):.1f} dB"
    )
    lines = measured[Setup()].response.frequency if measured else None
    return [
        *(
            Finding(key, _apart(passive, *cases), _apart(runs, *cases) if runs else None, "of any singular value")
            for key, cases in (("fig11.similar", ("OSM", "LSM")), ("fig11.similar_damped", ("LDOSM", "LDLSM")))
        ),
        Finding(
            "fig11.attenuation",
            float(FREQUENCY[most]),
            None if lines is None else float(lines[_farthest_below(runs["LDOSM"], runs["OSM"])]),
            remark,
        ),
    ]


def _measured_db(agreement: Agreement) -> Array:
    """Singular values of what was measured, (lines, 3), dB."""
    return singular_values_db(agreement.response.matrix)


def _apart(curves_of: Mapping[str, Array], one: str, other: str) -> float:
    """Largest difference of two curves, dB."""
    return float(np.abs(curves_of[one] - curves_of[other]).max())


def _farthest_below(curve: Array, other: Array) -> int:
    """Row in which the largest singular value of a curve is farthest below that of the other."""
    return int((curve - other)[:, 0].argmin())


def _suspension_peak(curve: Array) -> float:
    """Largest value at the resonance of the fine legs, dB."""
    return float(curve[FREQUENCY < SUSPENSION_BELOW, 0].max())


def paragraphs(measured: Measured) -> list[str]:
    """What was computed and measured, and what it says."""
    return [
        "Closed form: singular values of the matrix from base motion (m, rad, counted alike) to payload rotation. "
        "Theory is (38), with rigid legs and payload; the practical plant has truss modes and flexible coarse rods, "
        "and with the isolator the filters of (55).",
        "The passive curve does not depend on the bus: in Fig 11 OSM and LSM are one curve, as are LDOSM and LDLSM. "
        "More damping in the fine legs takes away the resonance of the suspension, and changes little above it.",
        "Measured: the four FMUs run at the usual communication step, shaken by a multisine along one axis at a time; "
        "the matrix is found by least squares over all runs. Model, FMUs and master are checked as one. "
        "There is no noise: what coherence lacks to one are transients of bus and suspension. " + verdict(measured),
        "Passive, both motions are outputs of the plant at the same instant, so that no delay is between them. With "
        "the isolator the communication step counts: it holds acceleration and force, and the plant's acceleration at "
        "the end of a step is that of the forces held over it. The closed form has all three; a pure delay of 1.5 "
        "steps does for the largest singular value, not for the smallest near the modes of the bus.",
    ]


def tables(
    at_orientations: Mapping[str, Curves],
    of_cases: Mapping[str, Curves],
    measured: Measured,
    of_step: Mapping[str, Agreement],
) -> list[Table]:
    """All tables."""
    return [
        _orientation_table(at_orientations),
        _case_table(of_cases),
        agreement_table(measured),
        step_table(of_step),
    ]


def _orientation_table(found: Mapping[str, Curves]) -> Table:
    header = ("orientation (deg)", "start (dB)", "largest attenuation (dB)", "largest amplification, 100-700 Hz (dB)")
    rows = [
        (format_angles(ORIENTATIONS[name]), f"{c.start:.4f}", f"{c.attenuation:.2f}", f"{c.amplification:.2f}")
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


def _entry(c: Curves) -> dict[str, object]:
    return {"start_db": c.start, "attenuation_db": c.attenuation, "amplification_db": c.amplification}
