"""A slew to a commanded inertial direction with the line-of-sight loop, under noise and reaction wheels.

The target's attitude in inertial space goes to the tracker, and the roll, pitch and yaw that lead there from the base's
initial attitude go to the commander, which knows nothing of the motion of the base.  Twice, with the loop off and on.
For five seconds something hides the target.
"""

from __future__ import annotations

from functools import partial

import numpy as np
from tqdm import tqdm

from ..results.tables import format_tables
from ..runs.cases import Case, Outcome, run_case
from ..runs.options import OptionError, RunOptions
from ..runs.publish import Findings
from ..runs.run import Run
from ..runs.scenario import list_needs
from ..runs.system import DISTURBED, RunSystem
from ..theory.line_of_sight import PointingLoop
from .comparison import (
    ATTITUDE,
    IN_CLOSED_FORM,
    LOOP,
    TARGET,
    Orientation,
    describe_alone,
    explain_refusal,
    find_attitude,
    read_target,
    to_degrees,
)
from .exploration import shade_faults
from .pointing_loop import MeasuredLoop, build_loop, make_shaking, measure_loop, read_tracker
from .pointing_record import NAMES, Plan, PointingRecord, RecordMaker
from .pointing_record import NEEDS as RECORDED
from .pointing_report import CASES, Pointing, describe, explore_pointing, list_results, make_tables

DEFAULT_TARGET = (float(np.radians(8.5)), 0.0, 0.0)
START_S = 1.0  # the target changes
HIDDEN_AT, HIDDEN_S = 2.0 / 3.0, 5.0  # of the duration; s
SHORTEST_S = 3.0
VISIBLE = "tracker.target_visible"
NEEDS = (
    *list_needs("input", *TARGET, *ATTITUDE),
    *list_needs("input", VISIBLE, LOOP, type="Boolean"),
    *RECORDED,
    *IN_CLOSED_FORM,
    *list_needs(
        "parameter", "pointing.loop.crossover_frequency", "pointing.delay", "tracker.latency",
        purpose="the closed form beside the run is that of PointingController and LineOfSightSensor; the scenario "
        "isolation has none",
    ),
    *DISTURBED,
)
WHEEL = {"disturbance.wheel_1.enabled": True}

HOW = (
    "The isolator holds the payload by its accelerometers above the crossover frequency, and the line-of-sight loop "
    "holds it below. The tracker gets the target's attitude in inertial space; the commander gets the roll, pitch and "
    "yaw that lead there from the initial attitude of the base. While the target is hidden, or out of the tracker's "
    "field, the loop keeps its last force."
)


def list_cases() -> tuple[str, ...]:
    """Names of the runs."""
    return CASES


def find(run: Run) -> Findings:
    """Run both cases and the loop cut open; how well the payload points."""
    options = run.options
    if options.duration_s < SHORTEST_S:
        raise OptionError(f"--duration: expected {SHORTEST_S:g} s at least, got {options.duration_s:g} s")
    system = run.load(WHEEL)
    make_shaking(options.step_s, read_tracker(system).sample_time)  # refuses steps that cannot measure the loop
    given = read_target(system)
    target = given if any(given) else DEFAULT_TARGET
    plan = make_plan(system, options, target)
    outcomes: list[Outcome] = []
    records: list[PointingRecord] = []
    for name, enabled in zip(CASES, (False, True), strict=True):
        if not run.wants(name):
            continue
        outcome, record = run_case(
            system, options, make_case(name, enabled, plan, target), RecordMaker(plan, options.step_s), needs=NAMES
        )
        outcomes.append(outcome)
        records.append(record.result())
    if run.only:
        return describe_alone(outcomes, system.indices)
    off, on = records
    tracker = read_tracker(system)
    there = target if on.reachable else (0.0, 0.0, 0.0)
    loop = build_loop(system, np.array(there), options.step_s)
    measured = _measure(system, options, loop, make_plan(system, options, there), there)
    pointing = Pointing(off, on, tracker, loop, measured, to_degrees(target))
    text, tables = [HOW, *describe(pointing)], make_tables(pointing)
    return Findings(
        title="Pointing: a slew with the line-of-sight loop",
        printed=format_tables(tables, text[1:]),
        text=text,
        tables=tables,
        outcomes=outcomes,
        orientation_deg=to_degrees(target),
        more={"pointing": list_results(pointing)},
        explore=partial(explore_pointing, pointing, shade_faults(outcomes[-1]), system),
        refused="" if on.reachable else explain_refusal(to_degrees(target)),
    )


def make_plan(system: RunSystem, options: RunOptions, target: Orientation) -> Plan:
    """When the target moves and is hidden, and the attitude it has then."""
    step = options.step_s
    start_s = np.ceil(START_S / step - 1e-6) * step
    hidden_s = round(HIDDEN_AT * options.duration_s / step) * step
    hidden = (float(hidden_s), float(hidden_s + round(HIDDEN_S / step) * step))
    attitude = find_attitude(system, target)
    return Plan(float(start_s), hidden if hidden[1] < options.duration_s else None, options.duration_s, attitude)


def make_case(name: str, enabled: bool, plan: Plan, target: Orientation) -> Case:
    """One run: at first the target is where the payload looks."""
    values = {**dict.fromkeys(TARGET, 0.0), LOOP: enabled}
    events: list[tuple[float, str, float | bool]] = [
        *((plan.start_s, port, angle) for port, angle in zip(TARGET, target, strict=True)),
        *((plan.start_s, port, number) for port, number in zip(ATTITUDE, plan.target, strict=True)),
    ]
    if plan.hidden:
        events += [(plan.hidden[0], VISIBLE, False), (plan.hidden[1], VISIBLE, True)]
    return Case(name, values, events)


def _measure(
    system: RunSystem, options: RunOptions, loop: PointingLoop, plan: Plan, target: Orientation
) -> dict[str, MeasuredLoop]:
    """The loop measured on the FMUs at the target, with nothing but the shaking; nothing of an unstable one."""
    if len(loop.unstable):
        return {}
    shaking = make_shaking(options.step_s, read_tracker(system).sample_time)
    values = dict(zip(TARGET, target, strict=True))
    with tqdm(total=3 * shaking.seeds, unit="run", disable=not options.progress, desc="loop cut open") as bar:
        return measure_loop(system.structure, loop, shaking, values, plan.target, options.seed or 0, bar.update)
