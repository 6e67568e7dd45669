"""Reaction wheels that run through their speeds, without and with the isolator."""

from __future__ import annotations

from functools import partial

from ..late import import_and_call
from ..options import Scenario

SCENARIO = Scenario(
    "wheels",
    "reaction wheels run up, passive then active: waterfall and worst crossing",
    partial(import_and_call, "ps_fmu.runs.wheels.scenario", "run"),
    duration_s=120.0,
    cases=partial(import_and_call, "ps_fmu.runs.wheels.scenario", "list_cases"),
)
