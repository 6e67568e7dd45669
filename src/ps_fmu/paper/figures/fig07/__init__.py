"""Fig 7: trajectories of the platform."""

from __future__ import annotations

from ....runs.options import RunOptions, Scenario


def run(options: RunOptions) -> None:
    """Run the scenario; what it needs is imported here, so that its declaration costs nothing."""
    from . import scenario

    scenario.run(options)


SCENARIO = Scenario(
    "trajectories",
    "Fig 7 of the paper: closed paths and a random walk, each with three solvers",
    run,
    duration_s=60.0,  # up to 25 targets of a path
    step_s=0.001,
)
