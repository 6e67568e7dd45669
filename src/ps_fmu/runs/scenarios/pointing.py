"""A slew to a commanded inertial direction with the line-of-sight loop."""

from __future__ import annotations

from functools import partial

from ..late import import_and_call
from ..options import Scenario

SCENARIO = Scenario(
    "pointing",
    "a slew to an inertial direction with the line-of-sight loop, off, then on",
    partial(import_and_call, "ps_fmu.runs.pointing.scenario", "run"),
    duration_s=90.0,
    system="LineOfSight.ssd",
    cases=partial(import_and_call, "ps_fmu.runs.pointing.scenario", "list_cases"),
)
