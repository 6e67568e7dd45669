"""Fig 10 and section 3.2.2: the internal loop with delay, in both readings, and which verdict survives."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial

from tqdm import tqdm

from ....results.report import draw_pictures
from ....runs.options import Scenario
from ....theory.margins import Margins
from ...analysis import AnalysisOptions
from ...analysis_result import AnalysisResult
from ...bus_cases import CASES
from ...cosimulation import hold_run
from ...finding import Finding
from ...published import published_numbers
from ...shaking import Shaking
from .open_loop import SHAKING, OpenLoop, open_loops
from .plots import DRAWN, bode_figure, distance_beyond, nyquist_figure, sensitivity_figure
from .pulse_response import PulseResponse
from .report import paragraphs, tables
from .results import BAND, WIDE, LoopVerdict, judge, least_gain_ratio_db
from .scenario import load_shaken_system, measure, response_pictures


def analyse(options: AnalysisOptions, scenario: Scenario, shaking: Shaking = SHAKING) -> AnalysisResult:
    """Judge the four cases, measure their open loop and their time response on the FMUs, and draw them."""
    delay = published_numbers()["text.delay"].value
    with hold_run(options, scenario) as run:
        responses = measure(load_shaken_system(run), run)
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
            f"frequency. What is not drawn, above {DRAWN:g} Hz, stays within {distance_beyond(verdicts):.2f} of one.",
            partial(nyquist_figure, verdicts=verdicts),
        ),
        (
            "sensitivity",
            "Sensitivity S of (48), and the small-gain condition (62) with T of (63) and its bound (64).",
            partial(sensitivity_figure, verdicts=verdicts),
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
    found = [Finding(f"fig10.{k}", computed[k], measured.get(k), remarks.get(k, "")) for k in computed]
    for case in ("OSM", "LDLSM"):
        v = verdicts[case]
        peak = opened[case].margins.largest_gain_db if opened else None
        found.append(Finding(f"fig10.{case}_peak", v.wide.largest_gain_db, peak, _describe_peak(v)))
    above = least_gain_ratio_db(verdicts["LSM"].loop, verdicts["OSM"].loop)
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


def _lighter_module(m: Margins) -> dict[str, float]:
    """The numbers of LSM in Fig 10, by the keys of published.toml."""
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
