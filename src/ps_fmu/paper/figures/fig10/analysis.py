"""Fig 10 and section 3.2.2: the internal loop with delay, in both readings, and which verdict survives."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from typing import TYPE_CHECKING

import numpy as np

from ....mechanism.dynamics import Dynamics, Pose, assemble
from ....mechanism.parameters import Array, Parameters
from ....pointing.poles import rightmost
from ....results.report import draw_pictures
from ....theory.transfer_matrices import Complex, Nominal, Practical, crowded
from ... import published
from ...command import Options
from ...result import Analysis, Finding
from ...support_modules import CASES, SUSPENSION, parameters_of
from . import SCENARIO
from .open_loop import SHAKING, OpenLoop, open_loops

if TYPE_CHECKING:
    from ....theory.loop import Loop, Margins
    from ...multisine import Shaking
    from .scenario import Response

LONGEST = 0.3  # s, of the search for a delay limit
BAND = (1.0, 30.0)  # Hz, around the suspension: what Fig 10 is about
WIDE = (0.05, 1000.0)  # Hz, from below the arrays to beyond the low-pass
AT_REST = 1e-6  # rad/s: the free base has poles at zero but for rounding


@dataclass(frozen=True)
class Peak:
    """The largest value over frequency."""

    value: float
    at: float
    """Hz."""


@dataclass(frozen=True, eq=False)
class Verdict:
    """What is to be said of one case with the paper's delay."""

    case: str
    loop: Loop
    margins: Margins
    """Of element (1, 1), read against -1 as the paper does, in :data:`BAND`."""
    wide: Margins
    """The same over :data:`WIDE`."""
    open_loop_poles: int
    """Poles of plant and isolator in the right half-plane."""
    encirclements: int
    """Poles in the right half-plane if the critical point were -1: what the paper's reading of the whole loop says."""
    unstable_poles: int
    """By the argument principle about +1: what equation (48) says."""
    poles: Complex
    """Of the closed loop, those to the right first, rad/s; see :meth:`.Loop.poles`."""
    delay_limit: float
    """s, infinite if stable with any delay."""
    bisected: float
    """The same by bisection of the number of unstable poles."""
    mobile_base_factor: float
    """v of (41)."""
    mobile_base_estimate: float
    """Its estimate (42)."""
    small_gain: Peak
    """sigma(T) |Delta| of (62) for the delay alone; stability is certain below one."""
    small_gain_bound: Peak
    """The same with the bound (64) for sigma(T)."""
    sensitivity: Peak
    """Largest singular value of S of the practical loop."""

    @property
    def rightmost(self) -> complex:
        """Pole farthest to the right of those of the fine legs' suspension, 2 to 20 Hz, rad/s."""
        return rightmost(self.poles, SUSPENSION)


@cache
def judge(case: str, delay: float) -> Verdict:
    """All about one case; ``delay`` in s.  Cached: the errata ask for it too."""
    from ....theory.loop import delay_limit_by_bisection, element_margins, loop_at
    from ....theory.small_gain import largest_singular_value, nominal_loop_poles
    from ....theory.state_space import controller_system

    loop = loop_at(parameters_of(case), delay=delay)
    poles = loop.poles()
    opened = np.concatenate([loop.plant_poles(), controller_system(loop.controller).poles()])
    factor, estimate = mobile_base(case)
    at_T = crowded(nominal_loop_poles(nominal_system(parameters_of(case))), *WIDE, 2000)
    return Verdict(
        case=case,
        loop=loop,
        margins=element_margins(loop, BAND),
        wide=element_margins(loop, WIDE),
        open_loop_poles=int(np.sum(opened.real > AT_REST)),
        encirclements=loop.inverted().unstable_poles(),
        unstable_poles=loop.unstable_poles(),
        poles=poles,
        delay_limit=loop.delay_limit,
        bisected=delay_limit_by_bisection(loop, LONGEST, 1e-5),
        mobile_base_factor=factor,
        mobile_base_estimate=estimate,
        small_gain=_peak(lambda f: small_gain(case, f, delay)[0], at_T),
        small_gain_bound=_peak(lambda f: small_gain(case, f, delay)[1], at_T),
        sensitivity=_peak(
            lambda f: largest_singular_value(loop.sensitivity(2j * np.pi * f)), crowded(poles, *WIDE, 2000)
        ),
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


def small_gain(case: str, frequency: Array, delay: float) -> tuple[Array, Array]:
    """Left-hand side of (62), with T by (63) and with its bound (64), each (n,), over frequency (n,), Hz.

    Delta is that of the delay (s) alone; the modes of the bus have the damping of the parameter set.
    """
    from ....theory import small_gain as theory

    nominal, s = Practical(nominal_system(parameters_of(case))), 2j * np.pi * np.asarray(frequency)
    uncertainty = theory.delay_uncertainty(frequency, delay)
    T = theory.largest_singular_value(theory.nominal_complement(nominal, s))
    return np.asarray(T * uncertainty), np.asarray(theory.nominal_complement_bound(nominal, s) * uncertainty)


def analyse(
    options: Options,
    shaking: Shaking = SHAKING,
    duration_s: float | None = None,
    step_s: float | None = None,
) -> Analysis:
    """Judge the four cases, measure their open loop and their time response on the FMUs, draw and word it.

    ``duration_s`` and ``step_s`` of the time responses; those of the scenario by default.
    """
    from tqdm import tqdm

    from .plots import DRAWN, beyond_drawn, bode_figure, nyquist_figure, sensitivity_figure
    from .report import paragraphs, tables
    from .scenario import response_pictures

    delay = published()["text.delay"].value
    responses = time_responses(options, duration_s, step_s)
    opened = open_loops(options, delay, shaking)
    bar = tqdm(CASES, unit="case", disable=not options.progress, desc="stability")
    verdicts = {case: judge(case, delay) for case in bar}
    figures = (
        (
            "bode",
            "Fig 10: element (1, 1) of the loop transfer matrix with the delay; dots: measured on the FMUs.",
            partial(bode_figure, verdicts=verdicts, opened=opened),
        ),
        (
            "nyquist",
            "det(E - L) along the imaginary axis: stable if the curve does not go round the origin. Arrows: rising "
            f"frequency. What is not drawn, above {DRAWN:g} Hz, stays within {beyond_drawn(verdicts):.2f} of one.",
            partial(nyquist_figure, verdicts=verdicts),
        ),
        (
            "sensitivity",
            "Sensitivity S of (48), and the small-gain condition (62) with T of (63) and its bound (64).",
            partial(sensitivity_figure, verdicts=verdicts),
        ),
    )
    pictures = draw_pictures(options.output, "stability", figures)
    return Analysis(
        name="stability",
        title="Stability of the internal loop: Fig 10",
        text=paragraphs(verdicts, opened, responses),
        findings=findings(verdicts, opened, responses),
        tables=tables(verdicts, opened, responses),
        pictures=[*pictures, *response_pictures(options.output, responses)],
        data={
            "delay_s": delay,
            "cases": {case: _entry(v) for case, v in verdicts.items()},
            "open_loop": {case: loop.entry for case, loop in opened.items()},
            "responses": [r.entry for r in responses],
        },
    )


def time_responses(options: Options, duration_s: float | None, step_s: float | None) -> list[Response]:
    """What the scenario ``stability`` measures: a pulse on the bus in each case, and in one beyond its limit."""
    from ....runs.output import hold_folder
    from ...cosimulation import run_options
    from .scenario import measure

    run = run_options(options, SCENARIO, duration_s or SCENARIO.duration_s, step_s or SCENARIO.step_s)
    with hold_folder(run.output):
        return measure(run)


def findings(
    verdicts: Mapping[str, Verdict],
    opened: Mapping[str, OpenLoop] | None = None,
    responses: Sequence[Response] = (),
) -> list[Finding]:
    """The numbers of Fig 10, in the paper's reading, and its verdicts; co-simulated ones only if they were measured."""
    computed = _of_lighter(verdicts["LSM"].margins)
    measured = _of_lighter(opened["LSM"].margins) if opened else {}
    remarks = {"LSM_phase_margin": "against -1; the critical point is +1"}
    found = [Finding(f"fig10.{k}", computed[k], measured.get(k), remarks.get(k, "")) for k in computed]
    for case in ("OSM", "LDLSM"):
        v = verdicts[case]
        peak = opened[case].margins.largest_gain_db if opened else None
        found.append(Finding(f"fig10.{case}_peak", v.wide.largest_gain_db, peak, _where(v)))
    above = _gain_ratio_db(verdicts["LSM"].loop, verdicts["OSM"].loop)
    seen = opened["LSM"].least_ratio_db(opened["OSM"]) if opened else None
    found.append(Finding("fig10.LSM_above_OSM", above, seen, f"from {WIDE[0]:g} to {WIDE[1]:g} Hz"))
    found.append(Finding("fig10.open_loop_poles", max(v.open_loop_poles for v in verdicts.values())))
    found += [
        Finding(f"fig10.{case}_encirclements", verdicts[case].encirclements, remark="of det(E + L)")
        for case in ("OSM", "LSM", "LDLSM")
    ]
    with_delay = {r.case: r for r in responses if r.enabled and r.delay_s == verdicts[r.case].loop.delay}
    for case in ("OSM", "LSM", "LDLSM"):
        remark = "stable: the critical point is +1" if case == "LSM" else ""
        growth = with_delay[case].pole.real if responses else None
        found.append(Finding(f"fig10.{case}_growth", verdicts[case].rightmost.real, growth, remark))
    original = verdicts["OSM"].mobile_base_factor
    remark = f"OSM; LSM has {verdicts['LSM'].mobile_base_factor:.2f}"
    return [*found, Finding("text.mobile_base_factor", original, remark=remark)]


def _of_lighter(m: Margins) -> dict[str, float]:
    """What the paper says of LSM in Fig 10, by the keys of published.toml."""
    first, second = m.gain_crossings
    return {
        "LSM_first_crossing": first,
        "LSM_second_crossing": second,
        "LSM_phase_crossing": m.phase_crossings[0],
        "LSM_phase_margin": m.phase_margin,
        "LSM_phase_crossings": len(m.phase_crossings),
    }


def _where(v: Verdict) -> str:
    """Where the largest gain is, and that around the suspension if it is elsewhere."""
    at = f"at {v.wide.largest_gain_at:.4g} Hz"
    if BAND[0] <= v.wide.largest_gain_at <= BAND[1]:
        return at
    return f"{at}; {v.margins.largest_gain_db:.2f} dB from {BAND[0]:g} to {BAND[1]:g} Hz"


def _gain_ratio_db(above: Loop, below: Loop) -> float:
    """Least ratio of the gains of element (1, 1) over :data:`WIDE`, dB."""
    s = 2j * np.pi * crowded(np.concatenate([above.plant_poles(), below.plant_poles()]), *WIDE)
    gains = [np.abs(loop.transfer(s)[:, 0, 0]) for loop in (above, below)]
    return float(20.0 * np.log10(gains[0] / gains[1]).min())


def _peak(function: Callable[[Array], Array], frequency: Array) -> Peak:
    """Largest value of a function over frequencies (n,), Hz, followed between them."""
    from scipy.optimize import minimize_scalar

    top = int(np.clip(function(frequency).argmax(), 1, len(frequency) - 2))
    found = minimize_scalar(
        lambda f: -float(function(np.array([f]))[0]), bounds=(frequency[top - 1], frequency[top + 1]), method="bounded"
    )
    return Peak(-float(found.fun), float(found.x))


def _entry(v: Verdict) -> dict[str, object]:
    return {
        "largest_gain_db": v.wide.largest_gain_db,
        "largest_gain_at_hz": v.wide.largest_gain_at,
        "largest_gain_1_to_30_hz_db": v.margins.largest_gain_db,
        "gain_crossings_hz": v.margins.gain_crossings,
        "phase_crossings_hz": v.margins.phase_crossings,
        "phase_margin_deg": v.margins.phase_margin,
        "unstable_poles_of_open_loop": v.open_loop_poles,
        "unstable_poles_about_minus_one": v.encirclements,
        "unstable_poles": v.unstable_poles,
        "rightmost_pole_rad_s": [v.rightmost.real, v.rightmost.imag],
        "poles_rad_s": [[pole.real, pole.imag] for pole in v.poles if pole.imag >= 0.0],
        "delay_limit_s": v.delay_limit,  # null: stable with any delay
        "delay_limit_by_bisection_s": v.bisected,
        "mobile_base_factor": v.mobile_base_factor,
        "mobile_base_estimate": v.mobile_base_estimate,
        "small_gain": v.small_gain.value,  # stability is certain below one
        "small_gain_at_hz": v.small_gain.at,
        "small_gain_by_bound": v.small_gain_bound.value,
        "largest_sensitivity": v.sensitivity.value,
        "largest_sensitivity_at_hz": v.sensitivity.at,
    }
