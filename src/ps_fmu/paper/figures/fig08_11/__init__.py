"""Figs 8 and 11: from base motion to payload rotation."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ...analysis import Analysis, AnalysisOptions

if TYPE_CHECKING:
    from ...analysis_result import AnalysisResult


def _analyse(options: AnalysisOptions) -> AnalysisResult:
    from .analysis import analyse  # the declaration costs nothing

    return analyse(options)


ANALYSIS = Analysis(
    "transmissibility",
    "Figs 8 and 11: singular values in closed form, and as measured on the running FMUs at each "
    "orientation and in each case (132 runs, about 2 minutes on two cores)",
    _analyse,
)
