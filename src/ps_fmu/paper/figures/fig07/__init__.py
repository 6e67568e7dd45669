"""Fig 7: trajectories of the platform."""

from ....runs.scenario import SCENARIOS

SCENARIO = SCENARIOS["trajectories"]
