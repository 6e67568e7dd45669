"""Fig 10: stability of the loop with delay."""

from ....runs.scenario import SCENARIOS

SCENARIO = SCENARIOS["stability"]
