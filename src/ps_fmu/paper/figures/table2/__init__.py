"""Table 2 and Fig 9: jitter, passive and active."""

from functools import partial

from ....runs.late import import_and_call
from ....runs.options import Scenario
from ...analysis import Analysis

SCENARIO = Scenario(
    "table2",
    "Table 2 of the paper: four orientations, passive and active",
    partial(import_and_call, f"{__name__}.scenario", "run"),
    duration_s=100.0,  # window of the statistics, at each orientation
    cases=partial(import_and_call, f"{__name__}.scenario", "list_cases"),
)
ANALYSIS = Analysis(
    "jitter",
    "Table 2 and Fig 9: RMS, rejection and image point, in closed form and co-simulated",
    partial(import_and_call, f"{__name__}.analysis", "analyse", scenario=SCENARIO),
    cost_s=28.0,
)
