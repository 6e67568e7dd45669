"""Default scenario: what the isolator does at one orientation, by default the nominal one.  Passive, then active."""

from __future__ import annotations

from functools import partial

from ..results.tables import format_angles, format_tables
from ..runs.publish import Findings
from ..runs.run import Run
from .amplification import explain_worse
from .comparison import (
    CASES,
    NEEDS,
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

__all__ = ["NEEDS", "find", "list_cases"]


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
    table = make_jitter_table(found, system.judge)
    refused = "" if found.reachable else explain_refusal(found.target_deg)
    return Findings(
        title=f"Isolation at {format_angles(found.orientation_deg)} deg",
        printed=format_tables([table]),
        text=[*filter(None, (refused, worse)), describe_runs(system, found.outcomes)],
        tables=[table],
        tabulate=lambda: [make_index_table(found, system)],
        outcomes=found.outcomes,
        orientation_deg=found.orientation_deg,
        rms_passive_rad=found.rms_passive.tolist(),
        rms_active_rad=found.rms_active.tolist(),
        rejection_percent=found.rejection.tolist(),
        more=found.entry,
        explore=partial(explore_comparisons, {"": found}, system),
        refused=refused,
    )
