"""Table 2 and Fig 9: jitter, passive and active."""

from ....runs.scenario import SCENARIOS

SCENARIO = SCENARIOS["table2"]
