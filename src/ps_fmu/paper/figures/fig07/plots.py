"""The figure of a path: targets, response, and the error at rest; the charts of the report."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ....results.page.content import Axis, Chart, ChartGroup, Curve, Exploration
from ....results.style import ACTIVE, AXES, PASSIVE, REFERENCE, draw
from ...published import ANGLES
from .results import EXACT, PLANES, PathResult

if TYPE_CHECKING:
    from matplotlib.figure import Figure

COLOURS = (ACTIVE, PASSIVE, AXES[2])


def draw_path(path: Path, results: Sequence[PathResult]) -> None:
    """One path with several methods: targets and response in each plane that the path uses; below the errors."""
    first = results[0]
    planes = [PLANES[first.path]] if first.path in PLANES else list(PLANES.values())

    def paint(figure: Figure) -> None:
        grid = figure.add_gridspec(2, len(planes), height_ratios=(2.0, 1.0))
        for column, (i, j) in enumerate(planes):
            axes = figure.add_subplot(grid[0, column])
            motion, target = np.degrees(first.motion), np.degrees(first.target)
            axes.plot(motion[:, i], motion[:, j], color=ACTIVE, label="response")
            axes.plot(target[:, i], target[:, j], "o", color=REFERENCE, fillstyle="none", label="target")
            axes.set(xlabel=f"{ANGLES[i]} (deg)", ylabel=f"{ANGLES[j]} (deg)", aspect="equal")
            if column == 0:
                axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2)
        errors = figure.add_subplot(grid[1, :])
        for result, colour in zip(results, COLOURS, strict=False):
            number = np.arange(1, len(result.error) + 1)
            shown = result.error > 0.0  # none at all at the nominal pose, which a logarithm cannot show
            error = np.degrees(result.error[shown])
            errors.semilogy(number[shown], error, "o-", color=colour, markersize=4.0, label=result.method)
        errors.axhspan(1e-9, 1e-8, color=REFERENCE, alpha=0.25, label="published")
        errors.set(xlabel="number of the target", ylabel="error at rest (deg)", ylim=(1e-15, 1e-2))
        errors.legend(ncols=4 if len(planes) > 1 else 2, loc="lower center", bbox_to_anchor=(0.5, 1.0))
        figure.suptitle(f"Path: {first.path}")

    draw(path, 7.5 if len(planes) == 1 else 14.0, 9.5, paint)


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
