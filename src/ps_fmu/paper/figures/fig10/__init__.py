"""Fig 10: stability of the loop with delay."""

from __future__ import annotations

from ....runs.options import RunOptions, Scenario


def run(options: RunOptions) -> None:
    """Run the scenario; what it needs is imported here, so that its declaration costs nothing."""
    from . import scenario

    scenario.run(options)


SCENARIO = Scenario(
    "stability",
    "Fig 10 of the paper: what follows a pulse on the bus, with delay in the loop",
    run,
    duration_s=10.0,  # after the pulse, for each case
)
