"""Fig 7: trajectories of the platform."""

from functools import partial

from ....runs.late import import_and_call
from ....runs.options import Scenario
from ...analysis import Analysis

SCENARIO = Scenario(
    "trajectories",
    "Fig 7 of the paper: closed paths and a random walk, each with three solvers",
    partial(import_and_call, f"{__name__}.scenario", "run"),
    duration_s=60.0,  # up to 25 targets of a path
    step_s=0.001,
    cases=partial(import_and_call, f"{__name__}.scenario", "list_cases"),
)
ANALYSIS = Analysis(
    "trajectories",
    "Fig 7 and Table 1 through commander and plant: errors along paths, the limits of the angles",
    partial(import_and_call, f"{__name__}.analysis", "analyse", scenario=SCENARIO),
    cost_s=34.0,
)
