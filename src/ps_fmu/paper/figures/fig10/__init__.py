"""Fig 10: stability of the loop with delay."""

from functools import partial

from ....runs.late import import_and_call
from ....runs.options import Scenario
from ...analysis import Analysis

SCENARIO = Scenario(
    "stability",
    "Fig 10 of the paper: what follows a pulse on the bus, with delay in the loop",
    partial(import_and_call, f"{__name__}.scenario", "run"),
    duration_s=10.0,  # after the pulse, for each case
    cases=partial(import_and_call, f"{__name__}.scenario", "list_cases"),
)
ANALYSIS = Analysis(
    "stability",
    "Fig 10: the internal loop with delay, in the paper's reading and in that of its equation (48)",
    partial(import_and_call, f"{__name__}.analysis", "analyse", scenario=SCENARIO),
    cost_s=24.0,
)
