"""Default scenario: what the isolator does at one orientation, by default the nominal one.  Passive, then active."""

from __future__ import annotations

from ...results.tables import Table, format_angles
from ..comparison import (
    CASES,
    HEADER,
    TargetError,
    compare,
    draw_comparison,
    explain_refusal,
    make_index_table,
    make_rows,
    read_target,
)
from ..exploration import explore_comparison
from ..options import RESULTS, RunOptions, Scenario
from ..publish import Findings, publish
from ..setup import load_system


def run(options: RunOptions) -> None:
    """Run the scenario; writes results.nc, summary.json, figures and report.html, prints the table.

    Raises :class:`TargetError` after that if the target is out of reach.
    """
    system = load_system(options)
    found = compare(system, options, read_target(system), explored=True)
    table = Table("Jitter of the payload: rotation by vibration, axes of P", HEADER, make_rows(found))
    print(table.to_text())

    rise = system.get_number("disturbance.rise_time")
    text = [
        "Four FMUs in co-simulation: plant, commander, isolator and disturbance source. The disturbance acts on the "
        "bus twice, without and with the feedforward isolator. Tables and figures cover the whole run; the "
        f"disturbance rises from zero over the first {rise:g} s.",
    ]
    refused = explain_refusal(found.target_deg)
    if not found.reachable:
        text.insert(0, refused)
    publish(
        options,
        system,
        Findings(
            title=f"Isolation at {format_angles(found.orientation_deg)} deg",
            text=text,
            tables=[table, make_index_table(found, system.indices)],
            pictures=draw_comparison(found, options.output) if options.figures else [],
            outcomes=found.outcomes,
            orientation_deg=found.orientation_deg,
            rms_passive_rad=found.rms_passive.tolist(),
            rms_active_rad=found.rms_active.tolist(),
            rejection_percent=found.rejection.tolist(),
            more=found.entry,
            explored=explore_comparison(found, system, options.output / RESULTS),
        ),
    )
    if not found.reachable:
        raise TargetError(refused)


SCENARIO = Scenario(
    "isolation",
    "what the isolator does at one orientation: passive, then active",
    run,
    duration_s=20.0,
    storage_step_s=1e-3,
    cases=CASES,
)
