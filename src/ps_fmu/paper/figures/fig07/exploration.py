"""What the report of the trajectories lets its reader explore: the platform on its way."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ....results.page.content import Axis, Chart, ChartGroup, Curve, Exploration
from ...published import ANGLES
from .results import EXACT, PathResult


def explore_paths(results: Sequence[PathResult]) -> Exploration:
    """Charts of target and response along each path, deg; by trilateration, which the others do not differ from."""
    return Exploration([_chart_path(result) for result in results if result.method == EXACT])


def _chart_path(result: PathResult) -> ChartGroup:
    charts = [
        Chart(
            angle,
            "deg",
            [
                Curve("target", "reference", np.degrees(result.held[:, k])),
                Curve("response", "active", np.degrees(result.motion[:, k])),
            ],
        )
        for k, angle in enumerate(ANGLES)
    ]
    caption = "The coarse legs follow each target at their rate limit, and rest at it."
    return ChartGroup(f"Path: {result.path}", caption, Axis("time", "s", result.time), charts)
