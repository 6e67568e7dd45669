"""Fig 10 and section 3.2.2: the internal loop with delay, in both readings, and which verdict survives."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache
from typing import TYPE_CHECKING

import numpy as np

from ..manipulator.dynamics import Dynamics, Pose, assemble
from ..manipulator.frequency import Nominal, Practical
from ..manipulator.parameters import Array, Parameters
from ..paper import published
from ..pointing.modes import rightmost
from ..pointing.report import Picture, Table
from ..scenarios.support_modules import CASES, SUSPENSION, parameters_of
from .command import Options
from .result import Analysis, Finding

if TYPE_CHECKING:
    from ..manipulator.stability import Loop, Margins

LONGEST = 0.3  # s, of the search for a delay limit
BAND = (1.0, 30.0)  # Hz, of Fig 10


@dataclass(frozen=True, eq=False)
class Verdict:
    """What is to be said of one case with the paper's delay."""

    case: str
    loop: Loop
    margins: Margins
    """Of element (1, 1), read against -1 as the paper does."""
    encirclements: int
    """Poles in the right half-plane if the critical point were -1: what the paper's reading of the whole loop says."""
    unstable_poles: int
    """By the argument principle about +1: what equation (48) says."""
    rightmost: complex
    """Pole farthest to the right of those of the fine legs' suspension and the delay, 2 to 20 Hz, rad/s."""
    delay_limit: float
    """s, infinite if stable with any delay."""
    bisected: float
    """The same by bisection of the number of unstable poles."""
    mobile_base_factor: float
    """v of (41)."""
    mobile_base_estimate: float
    """Its estimate (42)."""


@cache
def judge(case: str, delay: float) -> Verdict:
    """All about one case; ``delay`` in s.  Cached: the errata ask for it too."""
    from ..manipulator.stability import delay_limit_by_bisection, element_margins, loop_at

    loop = loop_at(parameters_of(case), delay=delay)
    factor, estimate = mobile_base(case)
    return Verdict(
        case=case,
        loop=loop,
        margins=element_margins(loop, BAND),
        encirclements=loop.inverted().unstable_poles(),
        unstable_poles=loop.unstable_poles(),
        rightmost=rightmost(loop.poles(), SUSPENSION),
        delay_limit=loop.delay_limit,
        bisected=delay_limit_by_bisection(loop, LONGEST, 1e-5),
        mobile_base_factor=factor,
        mobile_base_estimate=estimate,
    )


@cache
def mobile_base(case: str) -> tuple[float, float]:
    """Mobile-base factor v (41) of the nominal system of a case, and its estimate (42)."""
    system = nominal_system(parameters_of(case))
    return Practical(system).mobile_base_factor(), Nominal(system).mobile_base_estimate()


def nominal_system(p: Parameters, pose: Pose | None = None) -> Dynamics:
    """The paper's nominal system: rigid rods and payload, modes of the bus with their damping; at the nominal pose."""
    manipulator = replace(p.manipulator, coarse_rods=replace(p.manipulator.coarse_rods, axial_stiffness=0.0))
    pose = pose or Pose(p.manipulator.geometry.nominal_translation_B, np.eye(3))
    return assemble(manipulator, replace(p.payload, truss_modes=()), p.bus, pose)


def analyse(options: Options) -> Analysis:
    """Judge the four cases, draw and word it."""
    from tqdm import tqdm

    from .stability_plots import bode_figure, nyquist_figure, sensitivity_figure

    delay = published()["text.delay"].value
    bar = tqdm(CASES, unit="case", disable=not options.progress, desc="stability")
    verdicts = {case: judge(case, delay) for case in bar}
    pictures = []
    for name, figure, caption in (
        ("bode", bode_figure, "Fig 10: element (1, 1) of the loop transfer matrix with the delay."),
        (
            "nyquist",
            nyquist_figure,
            "det(E - L) along the imaginary axis: stable if the curve does not go round the origin.",
        ),
        ("sensitivity", sensitivity_figure, "Sensitivity S and complementary T of (48), (61), and the bound (64)."),
    ):
        path = options.output / f"stability_{name}.png"
        figure(path, verdicts)
        pictures.append(Picture(path, caption))
    return Analysis(
        name="stability",
        title="Stability of the internal loop: Fig 10",
        text=_text(verdicts),
        findings=findings(verdicts),
        tables=[_table(verdicts)],
        pictures=pictures,
        data={"delay_s": delay, "cases": {case: _entry(v) for case, v in verdicts.items()}},
    )


def findings(verdicts: Mapping[str, Verdict]) -> list[Finding]:
    """The numbers of Fig 10, in the paper's reading."""
    lsm = verdicts["LSM"].margins
    return [
        Finding("fig10.LSM_first_crossing", computed=lsm.gain_crossings[0]),
        Finding("fig10.LSM_second_crossing", computed=lsm.gain_crossings[1]),
        Finding("fig10.LSM_phase_crossing", computed=lsm.phase_crossings[0]),
        Finding("fig10.LSM_phase_margin", computed=lsm.phase_margin, remark="against -1; the critical point is +1"),
        Finding("fig10.OSM_peak", computed=verdicts["OSM"].margins.largest_gain_db),
        Finding("fig10.LDLSM_peak", computed=verdicts["LDLSM"].margins.largest_gain_db),
    ]


def small_gain(verdict: Verdict, frequency: Array) -> tuple[Array, Array, Array]:
    """Largest singular value of T (63), its bound (64), and 1 / |Delta| of the delay (62), over frequency (n,), Hz."""
    from ..manipulator.stability import delay_uncertainty, nominal_complement, nominal_complement_bound

    nominal, s = Nominal(verdict.loop.model.dynamics), 2j * np.pi * frequency
    T = np.linalg.svd(nominal_complement(nominal, s), compute_uv=False)[:, 0]
    with np.errstate(divide="ignore"):
        allowed = 1.0 / delay_uncertainty(frequency, verdict.loop.delay)
    return np.asarray(T), nominal_complement_bound(nominal, s), np.asarray(allowed)


def _text(verdicts: Mapping[str, Verdict]) -> list[str]:
    lsm = verdicts["LSM"]
    others = ", ".join(case for case, v in verdicts.items() if case != "LSM" and np.isinf(v.delay_limit))
    return [
        f"The loop is base acceleration - isolator - fine force - base, with a delay of {lsm.loop.delay:g} s. The "
        "numbers of Fig 10 are those of element (1, 1) of +C K read against the point -1, and they are reproduced. But "
        "by equation (48) the sensitivity is S = (E - C K)^-1: the feedback is positive and the critical point is +1.",
        "The published verdict that the lighter support module (LSM) is unstable with this delay does not survive: "
        f"det(E - L) does not go round the origin ({lsm.unstable_poles} poles in the right half-plane), and the "
        f"rightmost pole between 2 and 20 Hz is at {lsm.rightmost.real:.2f} {lsm.rightmost.imag:+.2f}i rad/s. It "
        f"becomes unstable beyond a delay of {1e3 * lsm.delay_limit:.1f} ms.",
        f"The other verdicts, and the trend, survive: {others} are stable with any delay. A lighter bus brings the "
        "loop closer to instability, more damping in the fine legs takes it away again.",
        "The small-gain condition (62), (64) is sufficient only: see the figure for how far it is from necessary.",
        "The scenario stability (system/run.py stability) shows the same on the running FMUs: the time response of the "
        "four cases with this delay, and of LSM beyond its limit.",
    ]


def _table(verdicts: Mapping[str, Verdict]) -> Table:
    header = (
        "case", "largest gain (dB)", "unstable poles, about -1", "unstable poles, about +1",
        "rightmost pole, 2-20 Hz (rad/s)", "delay limit (ms)", "by bisection (ms)", "v (41)", "estimate (42)",
    )  # fmt: skip
    rows = [
        (
            case,
            f"{v.margins.largest_gain_db:.2f}",
            f"{v.encirclements}",
            f"{v.unstable_poles}",
            f"{v.rightmost.real:.3f} {v.rightmost.imag:+.2f}i",
            _milliseconds(v.delay_limit),
            _milliseconds(v.bisected, f"none to {1e3 * LONGEST:g}"),
            f"{v.mobile_base_factor:.4f}",
            f"{v.mobile_base_estimate:.4f}",
        )
        for case, v in verdicts.items()
    ]
    return Table("The four cases with the paper's delay; the critical point of (48) is +1", header, rows)


def _milliseconds(delay: float, none: str = "none") -> str:
    return none if np.isinf(delay) else f"{1e3 * delay:.2f}"


def _entry(v: Verdict) -> dict[str, object]:
    return {
        "largest_gain_db": v.margins.largest_gain_db,
        "gain_crossings_hz": v.margins.gain_crossings,
        "phase_crossings_hz": v.margins.phase_crossings,
        "phase_margin_deg": v.margins.phase_margin,
        "unstable_poles_about_minus_one": v.encirclements,
        "unstable_poles": v.unstable_poles,
        "rightmost_pole_rad_s": [v.rightmost.real, v.rightmost.imag],
        "delay_limit_s": v.delay_limit,  # null: stable with any delay
        "delay_limit_by_bisection_s": v.bisected,
        "mobile_base_factor": v.mobile_base_factor,
        "mobile_base_estimate": v.mobile_base_estimate,
    }
