"""Fig 7: trajectories of the platform."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ....runs.options import RunOptions, Scenario
from ...analysis import Analysis, AnalysisOptions

if TYPE_CHECKING:
    from ...analysis_result import AnalysisResult

# The functions import their modules when they are called: the declarations cost nothing.


def _run(options: RunOptions) -> None:
    from .scenario import run

    run(options)


def _analyse(options: AnalysisOptions) -> AnalysisResult:
    from .analysis import analyse

    return analyse(options, SCENARIO)


SCENARIO = Scenario(
    "trajectories",
    "Fig 7 of the paper: closed paths and a random walk, each with three solvers",
    _run,
    duration_s=60.0,  # up to 25 targets of a path
    step_s=0.001,
)
ANALYSIS = Analysis(
    "trajectories",
    "Fig 7 and Table 1 through commander and plant: errors along paths, the limits of the angles",
    _analyse,
)
