"""Fig 10: stability of the loop with delay."""

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
    "stability",
    "Fig 10 of the paper: what follows a pulse on the bus, with delay in the loop",
    _run,
    duration_s=10.0,  # after the pulse, for each case
)
ANALYSIS = Analysis(
    "stability",
    "Fig 10: the internal loop with delay, in the paper's reading and in that of its equation (48)",
    _analyse,
)
