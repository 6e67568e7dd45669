"""Figures of all cases of a study: distributions, what the outputs depend on, and the two strongest parameters."""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..results.page.cases import CaseColumn, CaseTable
from ..results.report import Picture
from ..results.style import ACTIVE, PASSIVE, draw, engineering, largest, pretty

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SHARE = "share of the variance that each explains by itself"
MOST_SHOWN = 9  # outputs of a figure
MOST_FACTORS = 12  # bars of an output
COLUMNS = 3
MARKED = "95 %"  # the percentile that is drawn


def draw_all(table: CaseTable, headlines: int, folder: Path) -> list[Picture]:
    """Draw all figures into a folder; the pictures with their captions.  Raises ``OSError``.

    ``headlines``: so many of the metrics, from the first one on, are shown.
    """
    shown = table.metrics[: min(headlines, MOST_SHOWN)]
    ranked = [metric for metric in shown if np.isfinite(metric.ranking).any()]
    pictures = []
    if len(table) > 1:
        path = folder / "distribution.png"
        _draw_grid(path, shown, 3.1, _draw_distribution)
        caption = f"Values of all cases. Blue: {MARKED} percentile; orange: limit of the requirement."
        pictures.append(Picture(path, caption))
    if ranked:
        path, names = folder / "sensitivity.png", [parameter.title for parameter in table.parameters]
        height = 1.5 + 0.32 * min(MOST_FACTORS, len(names))
        _draw_grid(path, ranked, height, lambda axes, metric: _draw_ranking(axes, metric, names, table.measure))
        pictures.append(Picture(path, f"What the outputs depend on: {table.measure}."))
        if len(names) > 1:
            path = folder / "scatter.png"
            _draw_scatter(path, table, ranked[0])
            caption = f"All cases over the two parameters that {ranked[0].title} depends on most."
            pictures.append(Picture(path, caption))
    return pictures


def _draw_grid(
    path: Path, metrics: Sequence[CaseColumn], height: float, paint: Callable[[Axes, CaseColumn], None]
) -> None:
    columns = min(COLUMNS, len(metrics))
    rows = -(-len(metrics) // columns)

    def paint_all(figure: Figure) -> None:
        grid = figure.subplots(rows, columns, squeeze=False).ravel()
        for axes, metric in zip(grid, metrics, strict=False):
            paint(axes, metric)
            axes.set_title(_wrap(metric.title), fontsize=10)
        for axes in grid[len(metrics) :]:
            axes.set_axis_off()

    draw(path, 4.8 * columns, 0.4 + height * rows, paint_all)


def _draw_distribution(axes: Axes, metric: CaseColumn) -> None:
    """A histogram with a percentile and the limit."""
    values = metric.values[np.isfinite(metric.values)]
    factor, unit = engineering(metric.unit, largest((values,)))
    axes.hist(factor * values, bins=min(60, max(5, round(2.0 * len(values) ** (1 / 3)))), color="#BBBBBB")
    for mark in metric.marks:
        if mark.label == MARKED:
            axes.axvline(factor * mark.value, color=ACTIVE)
    if metric.limit is not None:
        axes.axvline(factor * metric.limit, color=PASSIVE)
    axes.set_xlabel(unit or "1")
    axes.set_ylabel("cases")


def _draw_ranking(axes: Axes, metric: CaseColumn, names: Sequence[str], measure: str) -> None:
    """Bars of each parameter, the strongest on top."""
    order = [place for place in _order(metric) if np.isfinite(metric.ranking[place])][:MOST_FACTORS][::-1]
    axes.barh(range(len(order)), np.asarray(metric.ranking)[order], color=ACTIVE)
    axes.set_yticks(range(len(order)), [_wrap(names[place], 22) for place in order], fontsize=10)
    if measure == SHARE:
        axes.set_xlim(0.0, 1.0)
    axes.set_xlabel(_wrap(measure))


def _draw_scatter(path: Path, table: CaseTable, metric: CaseColumn) -> None:
    """All cases over the two strongest parameters, coloured by the metric."""
    x, y = (table.parameters[place] for place in _order(metric)[:2])
    there = np.isfinite(metric.values)
    factor, unit = engineering(metric.unit, largest((metric.values,)))

    def paint(figure: Figure) -> None:
        axes = figure.subplots()
        size = 36.0 if there.sum() < 500 else 9.0
        shown = axes.scatter(x.values[there], y.values[there], c=factor * metric.values[there], s=size, cmap="viridis")
        if not there.all():
            axes.scatter(x.values[~there], y.values[~there], color=PASSIVE, marker="x", label="no result")
            axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0))
        axes.set_xlabel(f"{x.title} ({pretty(x.unit) or '1'})")
        axes.set_ylabel(f"{y.title} ({pretty(y.unit) or '1'})")
        bar = figure.colorbar(shown, ax=axes)
        bar.set_label(f"{metric.title} ({unit or '1'})", fontsize=11)
        if metric.limit is not None:
            bar.ax.axhline(factor * metric.limit, color=PASSIVE)

    draw(path, 9.0, 6.0, paint)


def _order(metric: CaseColumn) -> list[int]:
    """Places of the parameters, the strongest first."""
    strength = np.nan_to_num(np.abs(np.asarray(metric.ranking, dtype=float)))
    return [int(place) for place in strength.argsort()[::-1]]


def _wrap(text: str, width: int = 38) -> str:
    """Lines of at most ``width`` characters; dots are places to break, too."""
    return "\n".join(line.replace(". ", ".") for line in textwrap.wrap(text.replace(".", ". "), width))
