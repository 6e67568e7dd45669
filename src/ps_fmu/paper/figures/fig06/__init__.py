"""Table 1 and Fig 6: the workspace."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ...analysis import Analysis, AnalysisOptions

if TYPE_CHECKING:
    from ...analysis_result import AnalysisResult


def _analyse(options: AnalysisOptions) -> AnalysisResult:
    from .analysis import analyse  # the declaration costs nothing

    return analyse(options)


ANALYSIS = Analysis(
    "workspace",
    "Table 1 and Fig 6: the orientations within reach, singular values of the Jacobian",
    _analyse,
    needs_fmus=False,
)
