"""A slew without disturbance, with the isolator off and on."""

from __future__ import annotations

from functools import partial

from ..late import import_and_call
from ..options import Scenario

SCENARIO = Scenario(
    "slew",
    "a slew without disturbance, the isolator off, then on",
    partial(import_and_call, "ps_fmu.runs.slew_scenario", "run"),
    duration_s=100.0,  # the profile, then at least 60 s to settle
    cases=partial(import_and_call, "ps_fmu.runs.slew_scenario", "list_cases"),
)
