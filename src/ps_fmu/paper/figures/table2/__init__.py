"""Table 2 and Fig 9: jitter, passive and active."""

from __future__ import annotations

from ....runs.options import RunOptions, Scenario


def run(options: RunOptions) -> None:
    """Run the scenario; what it needs is imported here, so that its declaration costs nothing."""
    from . import scenario

    scenario.run(options)


SCENARIO = Scenario(
    "table2",
    "Table 2 of the paper: four orientations, passive and active",
    run,
    duration_s=100.0,  # window of the statistics, at each orientation
)
