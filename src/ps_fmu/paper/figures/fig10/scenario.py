"""Fig 10 as a time response: the four cases with the paper's delay, and one beyond the limit, after a short pulse.

A pulse shakes the bus; then nothing does.  What follows shows on the running FMUs whether the internal loop - base
acceleration, isolator, fine force, base - is stable: its poles are found in the free motion of the fine legs and
compared with those that linear theory predicts.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np

from ....disturbance.recording import HEADER as RECORDING
from ....interface.parameter_sets import build_plant_and_isolator
from ....mechanism.parameters import Array
from ....results.report import Picture, draw_pictures
from ....results.tables import Table, format_number
from ....runs.cases import Case, run_case
from ....runs.options import OptionError, RunOptions
from ....runs.publish import Findings
from ....runs.run import Run
from ....runs.setup import NOISE, RECORDING_PATH, RunSystem
from ....scenarios.jitter_record import ORIENTATION, ROTATION
from ....theory.loop import Loop, loop_of
from ...bus_cases import CASES, case_start_values
from ...cosimulation import SampleRecord
from .plots import draw_response, explore_responses
from .pulse_response import PULSE_S, PulseResponse, paper_delay_s

BEYOND_S = 0.1  # delay of the fifth run of the lighter module: its limit is 0.0916 s, and 1000 steps are kept
PULSE_B = (0.5, 0.3, 0.2, 1.0, 0.7, 0.5)
"""Largest force (N) and torque (N.m): the fine legs swing by less than 30 um, so that poles are those of one model."""
SHORTEST_S = 3.0  # of a run: 5 Hz decays or grows visibly
SAMPLE_S = 0.01  # between the samples that the poles are found in
FINE = tuple(f"plant.fine_displacement_{leg}" for leg in (1, 2, 3))

HOW = (
    "A pulse of force and torque shakes the bus for 0.4 s; it has neither an impulse nor an offset, so that the bus "
    "is left where it was. Then the free motion of the fine legs is split into its modes (eigensystem realisation). "
    "The table shows the mode between 2 and 20 Hz that decays most slowly, or grows. Predicted: the same pole of "
    "the closed loop with the delay, and the communication step that the exchange takes."
)


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
        printed="\n".join([table.to_text(), *text[1:]]),
        text=text,
        tables=[table],
        outcomes=[r.outcome for r in responses],
        orientation_deg=(0.0, 0.0, 0.0),
        more={"responses": [r.entry for r in responses]},
        draw=lambda folder: response_pictures(folder, responses),
        explore=lambda _path: explore_responses(responses),
    )


def measure(system: RunSystem, options: RunOptions) -> list[PulseResponse]:
    """Run each case without and with the isolator, and the lighter module with a delay beyond its limit."""
    return [_respond(system, options, *each) for each in _list_wanted()]


def list_cases() -> tuple[str, ...]:
    """Names of the runs."""
    return tuple(_name_case(*each) for each in _list_wanted())


def load_shaken_system(run: Run) -> RunSystem:
    """The system with the pulse as recorded disturbance, which is written beside the results."""
    path = run.options.output / "pulse.csv"
    time = np.arange(0.0, PULSE_S + 0.5e-3, 1e-3)  # s
    np.savetxt(
        path, np.column_stack([time, np.outer(pulse(time), PULSE_B)]), fmt="%.10g", delimiter=",",
        header=",".join(RECORDING), comments="",
    )  # fmt: skip
    return run.load({NOISE: False, RECORDING_PATH: str(path)})


def pulse(time: Array) -> Array:
    """Second derivative of sin(pi t / T)^8, scaled to one at its middle: neither velocity nor displacement is left.

    So smooth that the modes of rods and truss, which samples 10 ms apart would show at a wrong frequency, stay at rest.
    """
    sine = np.sin(math.pi * time / PULSE_S)
    return np.asarray(sine**6 * (8.0 * sine**2 - 7.0))


def _list_wanted() -> list[tuple[str, float, bool]]:
    """Case of the bus, delay in s, isolator enabled."""
    delay_s = paper_delay_s()
    return [*((case, delay_s, enabled) for case in CASES for enabled in (False, True)), ("LSM", BEYOND_S, True)]


def _name_case(case: str, delay_s: float, enabled: bool) -> str:
    return f"{case}_{1e3 * delay_s:g}ms_active" if enabled else f"{case}_passive"


def _respond(system: RunSystem, options: RunOptions, case: str, delay_s: float, enabled: bool) -> PulseResponse:
    stride = max(round(SAMPLE_S / options.step_s), 1)
    rows = np.arange(0, options.steps + 1, stride)
    values = {**case_start_values(case), "isolator.enabled": enabled, "isolator.delay": delay_s if enabled else 0.0}
    names = (*FINE, *ROTATION, *ORIENTATION)
    run = Case(_name_case(case, delay_s, enabled), values)
    outcome, record = run_case(system, options, run, SampleRecord((names, rows.tolist())))
    (samples,) = record.observers
    plant, isolator = build_plant_and_isolator(system.structure.with_parameters(values))
    loop = loop_of(plant, isolator, samples.values(*ORIENTATION)[0], delay_s + options.step_s)
    return PulseResponse(
        case=case,
        delay_s=delay_s,
        enabled=enabled,
        outcome=outcome,
        time=np.asarray(rows * options.step_s),
        fine=samples.values(*FINE),
        rotation=samples.values(*ROTATION),
        loop=loop,
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


def response_pictures(folder: Path, responses: Sequence[PulseResponse]) -> list[Picture]:
    """Draw fine legs and payload into a folder."""
    figures = (
        (
            "fine",
            "Largest displacement of a fine leg; dashed: rate of the predicted pole. In the end only the modes of "
            "the arrays are left, with time constants of 20 to 70 s; with large damping from 0.6 s on.",
            partial(draw_response, responses=responses, what="fine"),
        ),
        (
            "payload",
            "Rotation of the payload about the first axis.",
            partial(draw_response, responses=responses, what="payload"),
        ),
    )
    return draw_pictures(folder, "stability", figures)


def response_table(responses: Sequence[PulseResponse]) -> Table:
    """Poles found in the motion beside those predicted."""
    header = (
        "case", "isolator", "delay (ms)", "pole in the motion (1/s)", "(Hz)", "predicted (1/s)", "(Hz)",
        "last second over first", "stable", "payload RMS (rad)",
    )  # fmt: skip
    rows = [
        (
            r.case,
            "on" if r.enabled else "off",
            f"{1e3 * r.delay_s:g}" if r.enabled else "-",
            f"{r.pole.real:+.4f}",
            f"{r.pole.imag / (2.0 * math.pi):.4f}",
            f"{r.predicted.real:+.4f}",
            f"{r.predicted.imag / (2.0 * math.pi):.4f}",
            format_number(r.growth, ".2e"),
            "yes" if r.stable else "no",
            f"{r.rms:.3e}",
        )
        for r in responses
    ]
    return Table("Free motion after a pulse: slowest pole of the fine legs' suspension", header, rows)
