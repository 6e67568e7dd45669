"""Default scenario: what the isolator does at one orientation, by default the nominal one.  Passive, then active.

Where FMUs replace components, the active case runs once more with the components of the system: the case original.
"""

from __future__ import annotations

from functools import partial

from ..cosim import CosimError
from ..results.tables import Table, format_angles, format_tables
from ..runs.publish import Findings
from ..runs.run import Run
from ..runs.scenario import ORIGINAL
from .amplification import explain_worse
from .comparison import (
    AXES,
    CASES,
    NEEDS,
    Comparison,
    compare,
    describe_alone,
    describe_runs,
    explain_refusal,
    make_index_table,
    make_jitter_table,
    read_target,
    run_cases,
)
from .exploration import explore_comparisons
from .jitter_record import JitterRecord

__all__ = ["NEEDS", "find", "list_cases"]

AROUND = ("plant", "commander", "disturbance")
"""Components that are not compared: what an isolator, its sensors and its actuators work with."""


def list_cases() -> tuple[str, ...]:
    """Names of the runs."""
    return CASES


def find(run: Run) -> Findings:
    """Run both cases; the jitter of the payload without and with the isolator."""
    system = run.load()
    target = read_target(system)
    runs = run_cases(system, run.options, target, explored=True, only=run.only)
    if run.only:
        return describe_alone([outcome for outcome, _ in runs], system.indices)
    found = compare(target, runs)
    if worse := explain_worse(found, system, run.options):
        system.warnings.add(worse)
    tables = [make_jitter_table(found, system.judge)]
    outcomes, systems = list(found.outcomes), {}
    if (own := run.load_original(AROUND)) is not None:
        try:
            ((outcome, original),) = run_cases(own, run.options, target, only=(ORIGINAL,))
        except CosimError as error:
            system.warnings.add(f"The case {ORIGINAL} is left out, since it failed: {error}")
        else:
            outcomes.append(outcome)
            systems[ORIGINAL] = own
            tables.append(_tabulate_original(found, original, run))
    refused = "" if found.reachable else explain_refusal(found.target_deg)
    return Findings(
        title=f"Isolation at {format_angles(found.orientation_deg)} deg",
        printed=format_tables(tables),
        text=[*filter(None, (refused, worse)), describe_runs(system, found.outcomes)],
        tables=tables,
        tabulate=lambda: [make_index_table(found, system)],
        outcomes=outcomes,
        orientation_deg=found.orientation_deg,
        rms_passive_rad=found.rms_passive.tolist(),
        rms_active_rad=found.rms_active.tolist(),
        rejection_percent=found.rejection.tolist(),
        more=found.entry,
        explore=partial(explore_comparisons, {"": found}, system),
        refused=refused,
        systems=systems,
    )


def _tabulate_original(found: Comparison, original: JitterRecord, run: Run) -> Table:
    """The active case beside that with the components of the system in place of one's own."""
    both = found.rms_active, original.statistics.rms
    unit, factor = run.system.judge.choose_unit("rad")
    form = ".3e" if factor == 1.0 else ".4g"
    rows = [
        (axis, f"{factor * mine:{form}}", f"{factor * theirs:{form}}", f"{mine / theirs:.3g}")
        for axis, mine, theirs in zip(AXES, *both, strict=True)
    ]
    mine = ", ".join(path.name for path in run.options.replace.values())
    header = ("axis", f"active RMS ({unit})", f"original RMS ({unit})", "active / original")
    return Table(f"Active: with {mine}; original: with the components of the system in their places", header, rows)
