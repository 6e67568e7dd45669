"""A slew without disturbance: from (0, 0, 0) to (8.5, 0, 0) deg, or to the target of a parameter file.

Twice, with the isolator off and on: where the platform arrives, how the bus reacts, what the slew shakes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from ..cosim.recording.decimate import PASS_BAND
from ..pointing.spectra import rejection_percent
from ..results.datasets import open_results
from ..results.observers.bins import Envelope
from ..results.page.content import Axis, Chart, ChartGroup, Curve, Exploration, Spans, Still
from ..results.tables import format_angles, format_tables
from ..runs.cases import Case, run_case
from ..runs.options import OptionError
from ..runs.publish import Findings
from ..runs.run import Run
from ..runs.system import RunSystem
from .comparison import DRIVEN, ENABLED, TARGET, describe_alone, explain_refusal, read_target
from .exploration import (
    FEWEST_ROWS,
    MOST_ROWS,
    chart_envelopes,
    chart_settled,
    shade_faults,
    shorten_name,
    show_mechanism,
)
from .jitter_record import ROTATION
from .slew_record import NEEDS as RECORDED
from .slew_record import SLEW_SIGNALS, SlewRecord
from .slew_results import (
    ANGLES,
    CASES,
    Slews,
    describe_reactions,
    describe_run,
    find_reactions,
    list_groups,
    list_requirements,
    list_results,
    list_verdicts,
    tabulate_reactions,
    tabulate_requirements,
)

DEFAULT_TARGET = (math.radians(8.5), 0.0, 0.0)
START_S = 1.0  # the target changes
NEEDS = (*DRIVEN, *RECORDED)
SHOWN = (("isolator off", "passive"), ("isolator on", "active"))
"""What charts call the cases, and their colours."""

DIRECTION = (
    "The nominal orientation is what the coarse legs set. The relative orientation, of the platform on the bus, "
    "includes the fine legs. Where nothing else acts and the isolator is off, they come back to rest, and it equals "
    "the nominal one. With the isolator on it does not, and must not: the slew turns the bus the other way (momentum "
    "is conserved), and the isolator keeps the payload's direction in inertial space, so on the turned bus the payload "
    "differs from the nominal orientation by the rotation of the bus. The fine legs add that, less what the payload "
    "turns: it follows the bus slowly, by the high-pass of the isolator."
)


def list_cases() -> tuple[str, ...]:
    """Names of the runs."""
    return CASES


def find(run: Run) -> Findings:
    """Run both cases; where the platform arrives, and what that shakes."""
    options = run.options
    start_s = math.ceil(START_S / options.step_s - 1e-6) * options.step_s
    if options.duration_s <= start_s:
        raise OptionError(f"--duration: the slew begins at {start_s:g} s, got {options.duration_s:g} s")
    system = run.load({"disturbance.noise.enabled": False})
    given = read_target(system)
    target = given if any(given) else DEFAULT_TARGET
    found, outcomes = [], []
    for name, enabled in zip(CASES, (False, True), strict=True):
        at_rest = dict.fromkeys(TARGET, 0.0)
        events = [(start_s, port, angle) for port, angle in zip(TARGET, target, strict=True)]
        if not run.wants(name):
            continue
        case = Case(name, {**at_rest, ENABLED: enabled}, events)
        outcome, record = run_case(system, options, case, SlewRecord, needs=SLEW_SIGNALS)
        outcomes.append(outcome)
        found.append(record.result())
    if run.only:
        return describe_alone(outcomes, system.indices)
    slews = Slews(target, start_s, *found)

    required = list_requirements(slews) if slews.on.reachable else []
    reactions = find_reactions(system, slews)
    tables, text = [group.tabulate(slews) for group in list_groups(target)], describe_run(slews)
    shown = []
    if reactions:
        tables.insert(0, tabulate_reactions(reactions))
    if required:
        text += [*describe_reactions(reactions), DIRECTION]
        shown.append(tabulate_requirements(required))  # in the report they are the verdicts
    moved = slews.on.arrival.during is not None
    passive, active = (slew.during(ROTATION, "rms") for slew in (slews.off, slews.on))
    shaded = shade_faults(outcomes[-1])
    return Findings(
        title=f"Slew from (0, 0, 0) to {format_angles(slews.target_deg)} deg",
        printed=format_tables([*shown, *tables], text),
        text=text,
        tables=tables,
        outcomes=outcomes,
        orientation_deg=slews.orientation_deg,
        rms_passive_rad=passive.tolist() if moved else None,
        rms_active_rad=active.tolist() if moved else None,
        rejection_percent=rejection_percent(passive, active).tolist() if moved else None,
        more={"slew": {**list_results(slews), **list_verdicts(required, reactions)}},
        verdicts=[one.show() for one in required],
        explore=partial(explore_slews, slews, shaded, system),
        refused="" if slews.on.reachable else explain_refusal(slews.target_deg),
    )


def explore_slews(slews: Slews, shaded: Sequence[Spans], system: RunSystem, results: Path) -> Exploration:
    """Orientation, rotation of the bus and fine legs of both runs, and the mechanism as stored in ``results``.

    Raises ``OSError`` if that cannot be read.
    """
    off, on = slews.off, slews.on
    degrees, goal = float(np.degrees(1.0)), np.array(slews.target)[:, None]
    nominal = [Curve("nominal", "reference", degrees * middle, drawn="dashed") for middle in on.orientation.middle]
    relative = _chart(off.relative, on.relative, unit="deg", factor=degrees)
    errors = [replace(one.relative, low=one.relative.low - goal, high=one.relative.high - goal) for one in (off, on)]
    magnitudes = [replace(error, low=error.magnitude, high=error.magnitude) for error in errors]
    names = [f"magnitude of the error, {angle}" for angle in ANGLES]
    ended_s, title = on.arrival.ended_s, f"Slew to {format_angles(slews.target_deg)} deg"
    group = ChartGroup(
        title,
        "Orientation of the platform relative to the bus, magnitude of its error, rotation of the bus, elongation of "
        "the fine legs.",
        Axis("time", "s", on.relative.time),
        [
            *(replace(chart, curves=[*chart.curves, more]) for chart, more in zip(relative, nominal, strict=True)),
            *(replace(c, logarithmic=True) for c in _chart(*magnitudes, names=names, unit="deg", factor=degrees)),
            *_chart(off.bus, on.bus),
            *_chart(off.fine, on.fine),
        ],
        shaded=shaded,
        marked=[] if ended_s is None else [("end of the profile", ended_s)],
        stills=[
            Still(
                f"slew_{name}.png", f"{title}, {label}", (label, "nominal"),
                caption=f"The slew over time, {label}: orientation relative to the bus and the magnitude of its error, "
                "rotation of the bus, elongation of the fine legs.",
            )
            for name, (label, _) in zip(CASES, SHOWN, strict=True)
        ],
    )  # fmt: skip
    settled = _chart_settled(slews, results)
    runs = [(label, name) for (label, _), name in zip(SHOWN, CASES, strict=True)]
    return Exploration([group, *settled], mechanism=show_mechanism(system, runs))


def _chart(off: Envelope, on: Envelope, **more: Any) -> list[Chart]:
    """Charts of both runs, see :func:`chart_envelopes`."""
    return chart_envelopes([(*shown, one) for shown, one in zip(SHOWN, (off, on), strict=True)], **more)


def _chart_settled(slews: Slews, results: Path) -> list[ChartGroup]:
    """Rotation of the payload after the profile, from the stored rows; none if the run ends before, or has none."""
    began_s = slews.on.arrival.ended_s
    if slews.on.arrival.after is None or began_s is None:
        return []
    rows, span, step_s, highest = [], (began_s, began_s), 1.0, None
    with open_results(results) as file:
        for (label, colour), name in zip(SHOWN, CASES, strict=True):
            group = file[name]
            if not set(ROTATION) <= group.variables.keys():
                return []
            time = np.asarray(group["time"])
            first = max(int(np.searchsorted(time, began_s, side="right")), len(time) - MOST_ROWS)
            if len(time) - first < FEWEST_ROWS:
                return []
            rows.append((label, colour, np.column_stack([np.asarray(group[axis][first:]) for axis in ROTATION])))
            span, step_s = (float(time[first]), float(time[-1])), float(time[-1] - time[0]) / (len(time) - 1)
            highest = 0.5 * PASS_BAND / step_s if step_s > 1.5 * float(group.step_s) else None
    names = [shorten_name(name) for name in ROTATION]
    return chart_settled("rotation of the payload by vibration, axes of P", names, span, rows, step_s, highest)
