"""Reaction wheels that run through their speeds, without and with the isolator: the waterfall and its worst crossing.

By default one wheel runs up from 0 to 6000 rpm over the whole run.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from ..cosim import Value
from ..results.report import Picture
from ..results.tables import Table, format_tables
from ..results.waterfall import Waterfall, draw_waterfall
from ..runs.options import OptionError, RunOptions
from ..runs.publish import Findings
from ..runs.run import Run
from ..runs.setup import NOISE, RunSystem
from .comparison import (
    CASES,
    HEADER,
    Comparison,
    compare,
    describe_alone,
    draw_comparison,
    explain_refusal,
    make_index_table,
    make_rows,
    read_target,
    run_cases,
)
from .exploration import explore_comparison
from .wheel_crossings import Wheel, find_crossings, measure_crossings
from .wheel_report import (
    CaseLines,
    describe_speed,
    describe_worst,
    list_worst,
    make_waterfall,
    tabulate_crossings,
)
from .wheel_setup import build_loop, list_modes, make_response, read_wheels
from .wheel_spectrogram import FEWEST_ROWS, make_spectrogram

TOP_SPEED = 6000.0 * 2.0 * np.pi / 60.0  # rad/s
BEYOND = 2.0  # times the highest mode: how far the waterfall goes; higher lines move the payload little

ABOUT = (
    "Each harmonic of a wheel shakes the bus with an amplitude that grows with the square of the speed. Where its "
    "frequency crosses a natural mode, the payload answers most. The peak amplitude of a crossing is that of the one "
    "harmonic in the run; beside it stands what a wheel that stayed at this speed would make, in closed form for plant "
    "and isolator. A fast run-up ends below it, because a resonance takes time to build up."
)


def list_cases() -> tuple[str, ...]:
    """Names of the runs."""
    return CASES


def find(run: Run) -> Findings:
    """Run both cases; the waterfall and the crossings of harmonics with modes."""
    options = run.options
    if options.steps < FEWEST_ROWS:
        raise OptionError(f"--duration: expected {FEWEST_ROWS} steps at least, got {options.steps}")
    system = run.load(make_defaults(options.duration_s))
    wheels = read_wheels(system)
    target = read_target(system)
    if run.only:
        alone = run_cases(system, options, target, only=run.only)
        return describe_alone([outcome for outcome, _ in alone], system.indices)
    found = compare(system, options, target, explored=True, history=True)
    cases, waterfall = analyse(system, options, found, wheels)
    jitter = Table("Jitter of the payload: rotation by vibration, axes of P", HEADER, make_rows(found))
    crossings = tabulate_crossings(cases)
    worst = [describe_worst(name, case.crossings) for name, case in cases.items()]
    refused = [] if found.reachable else [explain_refusal(found.target_deg)]
    return Findings(
        title=f"Reaction wheels: {', '.join(describe_speed(wheel, options.duration_s) for wheel in wheels)}",
        printed="\n".join([jitter.to_text(), "", format_tables([crossings], worst)]),
        text=[*refused, *worst, ABOUT],
        tables=[crossings, jitter],
        tabulate=lambda: [make_index_table(found, system.indices)],
        outcomes=found.outcomes,
        orientation_deg=found.orientation_deg,
        rms_passive_rad=found.rms_passive.tolist(),
        rms_active_rad=found.rms_active.tolist(),
        rejection_percent=found.rejection.tolist(),
        more={**found.entry, "worst_crossing": list_worst(cases)},
        draw=partial(draw_wheels, found, waterfall),
        explore=lambda path: replace(explore_comparison(found, system, path), waterfalls=[waterfall]),
        refused="".join(refused),
    )


def draw_wheels(found: Comparison, waterfall: Waterfall, folder: Path) -> list[Picture]:
    """Draw the waterfall and the pictures of the comparison as PNG files in ``folder``."""
    path = folder / "waterfall.png"
    draw_waterfall(path, waterfall)
    return [Picture(path, waterfall.caption), *draw_comparison(found, folder)]


def make_defaults(duration_s: float) -> dict[str, Value]:
    """Start values without a parameter file: the first wheel runs up over the whole run, and nothing else acts."""
    wheel: dict[str, Value] = {
        "enabled": True, "initial_speed": 0.0, "final_speed": TOP_SPEED, "ramp_start": 0.0, "ramp_duration": duration_s,
    }  # fmt: skip
    return {NOISE: False, **{f"disturbance.wheel_1.{name}": value for name, value in wheel.items()}}


def analyse(
    system: RunSystem, options: RunOptions, found: Comparison, wheels: Sequence[Wheel]
) -> tuple[dict[str, CaseLines], Waterfall]:
    """Spectrogram and crossings of both runs by their names, and the waterfall of both."""
    step = options.step_s
    loop = build_loop(system, np.radians(found.orientation_deg).tolist())
    modes = list_modes(loop, step)
    lines = max(wheel.highest for wheel in wheels)
    highest = BEYOND * max((mode.frequency for mode in modes), default=lines)
    cases = {}
    for name, record in zip(CASES, (found.passive, found.active), strict=True):
        crossings = find_crossings(
            wheels, modes, options.duration_s, make_response(loop, step, active=name == "active")
        )
        spectrogram = make_spectrogram(record.rotation, step, highest)
        cases[name] = CaseLines(spectrogram, measure_crossings(crossings, record.rotation, step))
    return cases, make_waterfall(cases, wheels, modes, "Waterfall: rotation of the payload")
