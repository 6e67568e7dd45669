"""Fig 10 and section 3.2.2: the internal loop with delay, in both readings, and which verdict survives."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial

import numpy as np
from tqdm import tqdm

from ....analyses.finding import Finding
from ....analyses.options import AnalysisOptions
from ....analyses.result import AnalysisResult
from ....results.report import draw_pictures
from ....results.tables import Table
from ....runs.run import Run
from ....runs.scenario import Scenario
from ....scenarios.shaking import Shaking
from ....theory.loop import Margins
from ...bus_cases import CASES, SUSPENSION
from ...cosimulation import hold_run
from ...published import make_finding, published_numbers
from . import SCENARIO
from .open_loop import SHAKING, OpenLoop, measure_open_loops
from .plots import DRAWN, distance_beyond, draw_bode, draw_nyquist, draw_sensitivity
from .pulse_response import PulseResponse
from .results import BAND, LONGEST, WIDE, LoopVerdict, judge, least_gain_ratio_db
from .scenario import HOW, load_shaken_system, measure, response_pictures, response_table, verdict

ARRAYS = (0.2, SUSPENSION[0])  # Hz: modes of the bus
BEYOND = (SUSPENSION[1], 1000.0)  # Hz


def analyse(options: AnalysisOptions, scenario: Scenario = SCENARIO, shaking: Shaking = SHAKING) -> AnalysisResult:
    """Judge the four cases, measure their open loop and their time response on the FMUs, and draw them."""
    delay = published_numbers()["text.delay"].value
    with hold_run(options, scenario) as run:
        responses = measure(load_shaken_system(Run(run)), run)
    opened = measure_open_loops(options, delay, shaking)
    bar = tqdm(CASES, unit="case", disable=not options.progress, desc="stability")
    verdicts = {case: judge(case, delay) for case in bar}
    figures = (
        (
            "bode",
            "Fig 10: element (1, 1) of the loop transfer matrix with the delay; dots: measured on the FMUs.",
            partial(draw_bode, verdicts=verdicts, opened=opened),
        ),
        (
            "nyquist",
            "det(E - L) along the imaginary axis: stable if the curve does not go round the origin. Arrows: rising "
            f"frequency. What is not drawn, above {DRAWN:g} Hz, stays within {distance_beyond(verdicts):.2f} of one.",
            partial(draw_nyquist, verdicts=verdicts),
        ),
        (
            "sensitivity",
            "Sensitivity S of (48), and the small-gain condition (62) with T of (63) and its bound (64).",
            partial(draw_sensitivity, verdicts=verdicts),
        ),
    )
    pictures = draw_pictures(options.output, "stability", figures)
    return AnalysisResult(
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


def findings(
    verdicts: Mapping[str, LoopVerdict],
    opened: Mapping[str, OpenLoop] | None = None,
    responses: Sequence[PulseResponse] = (),
) -> list[Finding]:
    """The numbers of Fig 10, in the paper's reading, and its verdicts; co-simulated ones only if they were measured."""
    computed = _lighter_module(verdicts["LSM"].margins)
    measured = _lighter_module(opened["LSM"].margins) if opened else {}
    remarks = {"LSM_phase_margin": "against -1; the critical point is +1"}
    found = [make_finding(f"fig10.{k}", computed[k], measured.get(k), remarks.get(k, "")) for k in computed]
    for case in ("OSM", "LDLSM"):
        v = verdicts[case]
        peak = opened[case].margins.largest_gain_db if opened else None
        found.append(make_finding(f"fig10.{case}_peak", v.wide.largest_gain_db, peak, _describe_peak(v)))
    above = least_gain_ratio_db(verdicts["LSM"].loop, verdicts["OSM"].loop)
    seen = opened["LSM"].least_ratio_db(opened["OSM"]) if opened else None
    found.append(make_finding("fig10.LSM_above_OSM", above, seen, f"from {WIDE[0]:g} to {WIDE[1]:g} Hz"))
    found.append(make_finding("fig10.open_loop_poles", max(v.open_loop_poles for v in verdicts.values())))
    found += [
        make_finding(f"fig10.{case}_encirclements", verdicts[case].encirclements, remark="of det(E + L)")
        for case in ("OSM", "LSM", "LDLSM")
    ]
    with_delay = {r.case: r for r in responses if r.enabled and r.delay_s == verdicts[r.case].loop.delay}
    for case in ("OSM", "LSM", "LDLSM"):
        remark = "stable: the critical point is +1" if case == "LSM" else ""
        growth = with_delay[case].pole.real if responses else None
        found.append(make_finding(f"fig10.{case}_growth", verdicts[case].rightmost.real, growth, remark))
    original = verdicts["OSM"].mobile_base_factor
    remark = f"OSM; LSM has {verdicts['LSM'].mobile_base_factor:.2f}"
    return [*found, make_finding("text.mobile_base_factor", original, remark=remark)]


def _lighter_module(m: Margins) -> dict[str, float]:
    """The numbers of LSM in Fig 10, by the keys of published.csv."""
    first, second = m.gain_crossings
    return {
        "LSM_first_crossing": first,
        "LSM_second_crossing": second,
        "LSM_phase_crossing": m.phase_crossings[0],
        "LSM_phase_margin": m.phase_margin,
        "LSM_phase_crossings": len(m.phase_crossings),
    }


def _describe_peak(v: LoopVerdict) -> str:
    """Where the largest gain is, and that around the suspension if it is elsewhere."""
    at = f"at {v.wide.largest_gain_at:.4g} Hz"
    if BAND[0] <= v.wide.largest_gain_at <= BAND[1]:
        return at
    return f"{at}; {v.margins.largest_gain_db:.2f} dB from {BAND[0]:g} to {BAND[1]:g} Hz"


def paragraphs(
    verdicts: Mapping[str, LoopVerdict], opened: Mapping[str, OpenLoop], responses: Sequence[PulseResponse]
) -> list[str]:
    """What was computed and measured, and what follows."""
    lsm = verdicts["LSM"]
    others = ", ".join(case for case, v in verdicts.items() if case != "LSM" and np.isinf(v.delay_limit))
    deviation = [max(loop.deviation[k] for loop in opened.values()) for k in (0, 1)]
    checked = sum(loop.checked.sum() for loop in opened.values())
    lines = sum(len(loop.values) for loop in opened.values())
    return [
        f"The loop is base acceleration - isolator - fine force - base, with a delay of {lsm.loop.delay:g} s. The "
        "numbers of Fig 10 are those of element (1, 1) of +C K read against the point -1, and they are reproduced. But "
        "by equation (48) the sensitivity is S = (E - C K)^-1: the feedback is positive and the critical point is +1.",
        "The published verdict that the lighter support module (LSM) is unstable with this delay does not survive: "
        f"det(E - L) does not go round the origin ({lsm.unstable_poles} poles in the right half-plane), and the "
        f"slowest pole of the suspension is at {_complex_text(lsm.rightmost)} rad/s. It becomes unstable beyond a "
        f"delay of {1e3 * lsm.delay_limit:.1f} ms.",
        f"The other verdicts, and the trend, survive: {others} are stable with any delay. A lighter bus brings the "
        "loop closer to instability, more damping in the fine legs takes it away again. Of LDOSM the paper states no "
        "number.",
        f"The largest gain of element (1, 1) is stated twice: around the suspension, {_band_text(BAND)}, and over "
        f"{_band_text(WIDE)}. With large damping the second is larger, at a mode of the coarse rods.",
        _small_gain_text(verdicts),
        "Open loop on the running FMUs: the disturbance shakes the base of one plant FMU, the isolator FMU gets "
        "only the first component of its acceleration, and its forces act on a second plant FMU; L11 is the "
        "acceleration of the second base over that of the first. The communication step is in it: a delay of one step "
        "near the resonance, of 1.5 steps well above. Against the closed form with the step it is within "
        f"{deviation[0]:.3f} dB and {deviation[1]:.2f} deg at the {checked} of {lines} lines with enough coherence.",
        f"Time response on the running FMUs (scenario stability). {HOW}",
        *verdict(responses),
    ]


def _small_gain_text(verdicts: Mapping[str, LoopVerdict]) -> str:
    certain = [case for case, v in verdicts.items() if v.small_gain.value < 1.0]
    rest = [f"{case} ({v.small_gain.value:.2f})" for case, v in verdicts.items() if case not in certain]
    return (
        "The small-gain condition (62) is sufficient only. For the delay alone, on the nominal system with the "
        f"damping of its bus modes, sigma(T) |Delta| stays below one for {', '.join(certain) or 'none'}, so that these "
        f"are certainly stable as far as the delay goes; it says nothing of {', '.join(rest) or 'none'}, which is "
        "stable all the same. Without damping of the bus modes, as in the paper's equations, T is infinite at the "
        "free modes of the arrays, and (62) holds in no case."
    )


def tables(
    verdicts: Mapping[str, LoopVerdict], opened: Mapping[str, OpenLoop], responses: Sequence[PulseResponse]
) -> list[Table]:
    """All tables."""
    return [
        _verdict_table(verdicts),
        _gain_table(verdicts),
        _pole_table(verdicts),
        _open_loop_table(opened),
        response_table(responses),
    ]


def _verdict_table(verdicts: Mapping[str, LoopVerdict]) -> Table:
    header = (
        "case", "unstable poles, about -1", "unstable poles, about +1", "slowest pole of the suspension (rad/s)",
        "delay limit (ms)", "by bisection (ms)",
    )  # fmt: skip
    rows = [
        (
            case,
            f"{v.encirclements}",
            f"{v.unstable_poles}",
            _complex_text(v.rightmost),
            _milliseconds_text(v.delay_limit),
            _milliseconds_text(v.bisected, f"none to {1e3 * LONGEST:g}"),
        )
        for case, v in verdicts.items()
    ]
    return Table("The four cases with the paper's delay; the critical point of (48) is +1", header, rows)


def _gain_table(verdicts: Mapping[str, LoopVerdict]) -> Table:
    header = (
        "case", f"gain of L11, {_band_text(BAND)} (dB)", f"{_band_text(WIDE)} (dB)", "at (Hz)", "sigma(S)", "at (Hz)",
        "sigma(T) |Delta|", "at (Hz)", "with bound (64)", "(62) holds", "v (41)", "estimate (42)",
    )  # fmt: skip
    rows = [
        (
            case,
            f"{v.margins.largest_gain_db:.2f}",
            f"{v.wide.largest_gain_db:.2f}",
            f"{v.wide.largest_gain_at:.2f}",
            f"{v.sensitivity.value:.3f}",
            f"{v.sensitivity.at:.2f}",
            f"{v.small_gain.value:.3f}",
            f"{v.small_gain.at:.2f}",
            f"{v.small_gain_bound.value:.3f}",
            "yes" if v.small_gain.value < 1.0 else "no",
            f"{v.mobile_base_factor:.4f}",
            f"{v.mobile_base_estimate:.4f}",
        )
        for case, v in verdicts.items()
    ]
    return Table(f"Largest values over frequency; without a band: {_band_text(WIDE)}", header, rows)


def _pole_table(verdicts: Mapping[str, LoopVerdict]) -> Table:
    groups = {"arrays": ARRAYS, "suspension": SUSPENSION}
    columns = [
        [*(pole for band in groups.values() for pole in _oscillating_poles(v, band)), _oscillating_poles(v, BEYOND)[0]]
        for v in verdicts.values()
    ]
    names = [f"{name} {k}" for name, count in (("arrays", 6), ("suspension", 3)) for k in range(1, count + 1)]
    poles = zip([*names, "next"], zip(*columns, strict=True), strict=True)
    rows = [(name, *map(_complex_text, row)) for name, row in poles]
    return Table(
        "Poles of the closed loop with the delay (rad/s), those above the real axis, slowest first. Left out: the "
        'free base and the high-pass, below 0.01 rad/s; whatever is to the left of "next" (delay and low-pass), and '
        "what is beyond 600 rad/s (rods, truss). The count about +1 shows that none of these is in the right "
        "half-plane",
        ("pole", *verdicts),
        rows,
    )


def _oscillating_poles(v: LoopVerdict, band: tuple[float, float]) -> list[complex]:
    """Poles above the real axis with an imaginary part in a band, Hz, slowest first."""
    low, high = (2.0 * np.pi * f for f in band)
    return [complex(pole) for pole in v.poles if low < pole.imag < high]


def _open_loop_table(opened: Mapping[str, OpenLoop]) -> Table:
    header = (
        "case", "lines", "lowest coherence", "deviation of the gain (dB)", "of the phase (deg)", "largest gain (dB)",
        "at (Hz)",
    )  # fmt: skip
    rows = [
        (
            case,
            f"{loop.checked.sum()}",
            f"{loop.response.coherence.min():.6f}",
            f"{loop.deviation[0]:.4f}",
            f"{loop.deviation[1]:.3f}",
            f"{loop.margins.largest_gain_db:.2f}",
            f"{loop.margins.largest_gain_at:.2f}",
        )
        for case, loop in opened.items()
    ]
    f = next(iter(opened.values())).response.frequency
    caption = f"L11 on the FMUs with the loop open, {f[0]:.3g} to {f[-1]:.3g} Hz, against the closed form with the step"
    return Table(caption, header, rows)


def _band_text(band: tuple[float, float]) -> str:
    return f"{band[0]:g} to {band[1]:g} Hz"


def _complex_text(value: complex) -> str:
    return f"{value.real:.3f} {value.imag:+.2f}i"


def _milliseconds_text(delay: float, none: str = "none") -> str:
    return none if np.isinf(delay) else f"{1e3 * delay:.2f}"


def _entry(v: LoopVerdict) -> dict[str, object]:
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
