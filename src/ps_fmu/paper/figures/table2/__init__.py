"""Table 2 and Fig 9: jitter, passive and active."""

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
    "table2",
    "Table 2 of the paper: four orientations, passive and active",
    _run,
    duration_s=100.0,  # window of the statistics, at each orientation
)
ANALYSIS = Analysis(
    "jitter",
    "Table 2 and Fig 9: RMS, rejection and image point, in closed form and co-simulated",
    _analyse,
)
