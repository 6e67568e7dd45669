"""A slew without disturbance: from (0, 0, 0) to (8.5, 0, 0) deg, or to the target of a parameter file.

Twice, with the isolator off and on: where the platform arrives, how the bus reacts, what the slew shakes.
"""

from __future__ import annotations

import math
from functools import partial

from ..pointing.spectra import rejection_percent
from ..results.tables import format_angles, format_tables
from ..runs.cases import Case, run_case
from ..runs.options import OptionError
from ..runs.publish import Findings
from ..runs.run import Run
from .comparison import TARGET, describe_alone, explain_refusal, read_target
from .jitter_record import ROTATION
from .slew_exploration import explore_slews
from .slew_record import SLEW_SIGNALS, SlewRecord
from .slew_report import CASES, Slews, describe_run, draw_slews, list_results, make_tables
from .slew_verdict import (
    describe_reactions,
    find_reactions,
    list_requirements,
    list_verdicts,
    tabulate_reactions,
    tabulate_requirements,
)

DEFAULT_TARGET = (math.radians(8.5), 0.0, 0.0)
START_S = 1.0  # the target changes

DIRECTION = (
    "The nominal orientation is what the coarse legs set. The relative orientation, of the platform on the bus, "
    "includes the fine legs. With the isolator off they come back to rest, and it equals the nominal one. With the "
    "isolator on it does not, and must not: the slew turns the bus the other way (momentum is conserved), and the "
    "isolator keeps the payload's direction in inertial space, so on the turned bus the payload differs from the "
    "nominal orientation by the rotation of the bus. The fine legs add just that. The payload follows the bus slowly, "
    "by the high-pass of the isolator (1e-4 Hz by default): that is the rotation that is left to the payload."
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
        case = Case(name, {**at_rest, "isolator.enabled": enabled}, events)
        outcome, record = run_case(system, options, case, SlewRecord, needs=SLEW_SIGNALS)
        outcomes.append(outcome)
        found.append(record.result())
    if run.only:
        return describe_alone(outcomes, system.indices)
    slews = Slews(target, start_s, *found)

    required = list_requirements(slews) if slews.on.reachable else []
    reactions = find_reactions(system, slews)
    tables, text = make_tables(slews), describe_run(slews)
    shown = []
    if reactions:
        tables.insert(0, tabulate_reactions(reactions))
    if required:
        text += [*describe_reactions(reactions), DIRECTION]
        shown.append(tabulate_requirements(required))  # in the report they are the verdicts
    moved = slews.on.arrival.during is not None
    passive, active = (slew.during(ROTATION, "rms") for slew in (slews.off, slews.on))
    shaded = outcomes[-1].find_spans()
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
        draw=partial(draw_slews, slews, shaded=shaded),
        explore=partial(explore_slews, slews, system),
        refused="" if slews.on.reachable else explain_refusal(slews.target_deg),
    )
