"""Default scenario: what the isolator does at the nominal orientation.  Passive, then active."""

from __future__ import annotations

from ..pointing.report import Report, Table
from ..pointing.summary import RunSummary, versions
from .common import fmu_files, given_parameters, load_system, text_table
from .comparison import HEADER, compare, draw, index_table, rows
from .options import REPORT, SUMMARY, RunOptions

NOMINAL = (0.0, 0.0, 0.0)  # deg


def run(options: RunOptions) -> None:
    """Run the scenario; writes results.nc, summary.json, figures and report.html, prints the table."""
    system = load_system(options)
    found = compare(system, options, NOMINAL)
    table = Table("Jitter of the payload", HEADER, rows(found))
    print(text_table(table.header, table.rows))

    factor = sum(o.simulated_s for o in found.outcomes) / sum(o.wall_s for o in found.outcomes)
    fmus = fmu_files(system)
    RunSummary(
        scenario=options.scenario,
        orientation_deg=NOMINAL,
        step_s=options.step_s,
        duration_s=options.duration_s,
        seed=options.seed,
        rms_passive_rad=found.rms_passive.tolist(),
        rms_active_rad=found.rms_active.tolist(),
        rejection_percent=found.rejection.tolist(),
        real_time_factor=factor,
        fmus=fmus,
        more={"scheme": options.scheme, "warnings": found.warnings},
    ).write(options.output / SUMMARY)
    indices = index_table(found)
    Report(
        title="Isolation at the nominal orientation",
        text=(
            "Four FMUs in co-simulation: plant, commander, isolator and disturbance source. The disturbance acts on "
            "the bus twice, without and with the feedforward isolator.",
        ),
        tables=[table] if indices is None else [table, indices],
        pictures=draw(found, options.output),
        parameters=given_parameters(options),
        fmus=fmus,
        versions=versions(),
        warnings=found.warnings,
    ).write(options.output / REPORT)
    print(f"{factor:.1f} x real time; results in {options.output}")
