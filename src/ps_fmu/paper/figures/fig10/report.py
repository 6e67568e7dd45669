"""Fig 10: the internal loop with delay, read in both ways, and as it answers a pulse; which verdict survives."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from tqdm import tqdm

from ....analyses.result import AnalysisResult, Finding, paint_pictures, tabulate
from ....analyses.table import AnalysisOptions
from ....results.figures import draw_exploration
from ....results.tables import Table, format_number, format_tables
from ....runs.options import OptionError
from ....runs.publish import Findings
from ....runs.run import Run
from ....runs.scenario import SCENARIOS, Scenario
from ....runs.system import DISTURBED, RunSystem
from ....scenarios.shaking import Shaking
from ....theory.loop import Loop, Margins
from ...bus_cases import CASES, SUSPENSION
from ...cosimulation import hold_run
from ...published import make_finding
from . import plots
from .closed_form import BAND, LONGEST, WIDE, LoopVerdict, judge, least_gain_ratio_db
from .runs import (
    SHAKING,
    OpenLoop,
    PulseResponse,
    list_cases,
    load_shaken_system,
    measure,
    measure_open_loops,
    paper_delay_s,
)

__all__ = ["NEEDS", "analyse", "find", "list_cases"]

NEEDS = DISTURBED

SHORTEST_S = 3.0  # of a run: 5 Hz decays or grows visibly
HOW = (
    "A pulse of force and torque shakes the bus for 0.4 s; it has neither an impulse nor an offset, so that the bus "
    "is left where it was. Then the free motion of the fine legs is split into its modes (eigensystem realisation). "
    "The table shows the mode between 2 and 20 Hz that decays most slowly, or grows. Predicted: the same pole of "
    "the closed loop with the delay, and the communication step that the exchange takes."
)
ARRAYS = (0.2, SUSPENSION[0])  # Hz: modes of the bus
BEYOND = (SUSPENSION[1], 1000.0)  # Hz


def find(run: Run) -> Findings:
    """Run all cases; the poles found in their motion."""
    options = run.options
    if options.duration_s < SHORTEST_S:
        raise OptionError(f"--duration: poles need {SHORTEST_S:g} s at least, got {options.duration_s:g} s")
    system = load_shaken_system(run)
    responses = measure(system, options)
    table = response_table(responses)
    text = [HOW, *verdict(responses), *_unpredicted_text(system)]
    return Findings(
        title="Stability of the internal loop: time response",
        printed=format_tables([table], text[1:]),
        text=text,
        tables=[table],
        outcomes=[r.outcome for r in responses],
        orientation_deg=(0.0, 0.0, 0.0),
        more={"responses": [r.entry for r in responses]},
        draw=lambda folder: plots.draw_fine_legs(folder, responses),
        explore=lambda _path: plots.explore_responses(responses),
    )


def analyse(
    options: AnalysisOptions, scenario: Scenario = SCENARIOS["stability"], shaking: Shaking = SHAKING
) -> AnalysisResult:
    """Judge the four cases, measure their open loop and their time response on the FMUs, and draw them."""
    delay = paper_delay_s()
    with hold_run(options, scenario) as run:
        responses = measure(load_shaken_system(run), run.options)
    opened = measure_open_loops(options, delay, shaking)
    bar = tqdm(CASES, unit="case", disable=not options.progress, desc="stability")
    verdicts = {case: judge(case, delay) for case in bar}
    return AnalysisResult(
        name="stability",
        title="Stability of the internal loop: Fig 10",
        text=paragraphs(verdicts, opened, responses),
        findings=findings(verdicts, opened, responses),
        tables=tables(verdicts, opened, responses),
        pictures=[
            *paint_pictures(
                options.output,
                "stability",
                (
                    "bode", "Fig 10: element (1, 1) of the loop transfer matrix with the delay; dots: measured on the "
                    "FMUs.",
                    (10.0, 8.0), plots.paint_bode, verdicts, opened,
                ),
                (
                    "nyquist",
                    "det(E - L) along the imaginary axis: stable if the curve does not go round the origin. Arrows: "
                    f"rising frequency. What is not drawn, above {plots.DRAWN:g} Hz, stays within "
                    f"{plots.distance_beyond(verdicts):.2f} of one.",
                    (13.0, 10.5), plots.paint_nyquist, verdicts,
                ),
                (
                    "sensitivity",
                    "Sensitivity S of (48), and the small-gain condition (62) with T of (63) and its bound (64).",
                    (10.0, 9.0), plots.paint_sensitivity, verdicts,
                ),
            ),
            *plots.draw_fine_legs(options.output, responses),
            *draw_exploration(plots.explore_responses(responses), options.output),
        ],
        data={
            "delay_s": delay,
            "cases": {case: v.entry for case, v in verdicts.items()},
            "open_loop": {case: loop.entry for case, loop in opened.items()},
            "responses": [r.entry for r in responses],
        },
    )  # fmt: skip


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
    """What follows; docs/paper.md says how the open loop is measured."""
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
        _small_gain_text(verdicts),
        "The open loop of the running FMUs, L11, differs from the closed form with the communication step by at most "
        f"{deviation[0]:.3f} dB and {deviation[1]:.2f} deg, at the {checked} of {lines} lines with enough coherence.",
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


def verdict(responses: Sequence[PulseResponse]) -> list[str]:
    """Which cases are stable with the paper's delay, and what becomes of a longer one: sentences."""
    delay_s = paper_delay_s()
    active = [r for r in responses if r.enabled]
    with_paper_delay = [r for r in active if r.delay_s == delay_s]
    stable, unstable = (
        ", ".join(r.case for r in with_paper_delay if r.stable is wanted) or "none" for wanted in (True, False)
    )
    said = [f"With the delay of {delay_s:g} s, stable: {stable}; unstable: {unstable}. The paper calls LSM unstable."]
    for r in active:
        if r.delay_s != delay_s:
            said.append(
                f"{limit_text(r.loop)}, with {1e3 * r.delay_s:g} ms, the motion of {r.case} "
                f"{'decays' if r.stable else 'grows'}: {r.pole.real:+.3f} 1/s, predicted {r.predicted.real:+.3f} 1/s."
            )
    return said


def _unpredicted_text(system: RunSystem) -> list[str]:
    """What the system has and the prediction has not, as a sentence."""
    found = [name for name in ("isolator.sample_time", "isolator.force_limit") if system.get_number(name)]
    return [f"Not in the predictions: {', '.join(found)}."] if found else []


def limit_text(loop: Loop) -> str:
    """Whether the delay of a loop is beyond its limit: the start of a sentence."""
    limit_s = loop.delay_limit
    if math.isinf(limit_s):
        return "Stable with any delay by theory"
    return f"{'Beyond' if loop.delay > limit_s else 'Within'} the limit of {1e3 * limit_s:.1f} ms"


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
    return tabulate(
        "The four cases with the paper's delay; the critical point of (48) is +1",
        verdicts.values(),
        (
            ("case", lambda v: v.case),
            ("unstable poles, about -1", lambda v: f"{v.encirclements}"),
            ("unstable poles, about +1", lambda v: f"{v.unstable_poles}"),
            ("slowest pole of the suspension (rad/s)", lambda v: _complex_text(v.rightmost)),
            ("delay limit (ms)", lambda v: _milliseconds_text(v.delay_limit)),
            ("by bisection (ms)", lambda v: _milliseconds_text(v.bisected, f"none to {1e3 * LONGEST:g}")),
        ),
    )


def _gain_table(verdicts: Mapping[str, LoopVerdict]) -> Table:
    return tabulate(
        f"Largest values over frequency; without a band: {_band_text(WIDE)}",
        verdicts.values(),
        (
            ("case", lambda v: v.case),
            (f"gain of L11, {_band_text(BAND)} (dB)", lambda v: f"{v.margins.largest_gain_db:.2f}"),
            (f"{_band_text(WIDE)} (dB)", lambda v: f"{v.wide.largest_gain_db:.2f}"),
            ("at (Hz)", lambda v: f"{v.wide.largest_gain_at:.2f}"),
            ("sigma(S)", lambda v: f"{v.sensitivity.value:.3f}"),
            ("at (Hz)", lambda v: f"{v.sensitivity.at:.2f}"),
            ("sigma(T) |Delta|", lambda v: f"{v.small_gain.value:.3f}"),
            ("at (Hz)", lambda v: f"{v.small_gain.at:.2f}"),
            ("with bound (64)", lambda v: f"{v.small_gain_bound.value:.3f}"),
            ("(62) holds", lambda v: "yes" if v.small_gain.value < 1.0 else "no"),
            ("v (41)", lambda v: f"{v.mobile_base_factor:.4f}"),
            ("estimate (42)", lambda v: f"{v.mobile_base_estimate:.4f}"),
        ),
    )


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
    f = next(iter(opened.values())).response.frequency
    return tabulate(
        f"L11 on the FMUs with the loop open, {f[0]:.3g} to {f[-1]:.3g} Hz, against the closed form with the step",
        opened.items(),
        (
            ("case", lambda of: of[0]),
            ("lines", lambda of: f"{of[1].checked.sum()}"),
            ("lowest coherence", lambda of: f"{of[1].response.coherence.min():.6f}"),
            ("deviation of the gain (dB)", lambda of: f"{of[1].deviation[0]:.4f}"),
            ("of the phase (deg)", lambda of: f"{of[1].deviation[1]:.3f}"),
            ("largest gain (dB)", lambda of: f"{of[1].margins.largest_gain_db:.2f}"),
            ("at (Hz)", lambda of: f"{of[1].margins.largest_gain_at:.2f}"),
        ),
    )


def response_table(responses: Sequence[PulseResponse]) -> Table:
    """Poles found in the motion beside those predicted."""
    return tabulate(
        "Free motion after a pulse: slowest pole of the fine legs' suspension",
        responses,
        (
            ("case", lambda r: r.case),
            ("isolator", lambda r: "on" if r.enabled else "off"),
            ("delay (ms)", lambda r: f"{1e3 * r.delay_s:g}" if r.enabled else "-"),
            ("pole in the motion (1/s)", lambda r: f"{r.pole.real:+.4f}"),
            ("(Hz)", lambda r: f"{r.pole.imag / (2.0 * math.pi):.4f}"),
            ("predicted (1/s)", lambda r: f"{r.predicted.real:+.4f}"),
            ("(Hz)", lambda r: f"{r.predicted.imag / (2.0 * math.pi):.4f}"),
            ("last second over first", lambda r: format_number(r.growth, ".2e")),
            ("stable", lambda r: "yes" if r.stable else "no"),
            ("payload RMS (rad)", lambda r: f"{r.rms:.3e}"),
        ),
    )


def _band_text(band: tuple[float, float]) -> str:
    return f"{band[0]:g} to {band[1]:g} Hz"


def _complex_text(value: complex) -> str:
    return f"{value.real:.3f} {value.imag:+.2f}i"


def _milliseconds_text(delay: float, none: str = "none") -> str:
    return none if np.isinf(delay) else f"{1e3 * delay:.2f}"
