"""Figures of a study: how outputs are distributed, what they depend on, the two parameters that matter most."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..results.report import Picture
from ..results.style import ACTIVE, PASSIVE, REFERENCE, draw, engineering, largest, pretty
from .outcome import CONFIDENCE, PROBABILITIES, Influence, Outcome, Output, Percentiles

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

MOST_SHOWN = 9  # outputs of a figure
MOST_FACTORS = 12  # bars of an output
COLUMNS = 3
UPPER = PROBABILITIES.index(0.95)  # the percentile that is drawn


def draw_all(outcome: Outcome, folder: Path, percentiles: Sequence[Percentiles],
             influences: Sequence[Influence]) -> list[Picture]:  # fmt: skip
    """Draw all figures into a folder; the pictures with their captions.  Raises ``OSError``."""
    shown = outcome.headlines[:MOST_SHOWN]
    names = {output.name for output in shown}
    pictures = []
    chosen = [found for found in percentiles if found.output.name in names]
    if chosen and len(outcome.table) > 1:
        path = folder / "distribution.png"
        draw_distributions(path, outcome, chosen)
        pictures.append(
            Picture(path, f"Values of all cases. Blue line: 95th percentile; blue band: its {100 * CONFIDENCE:g} % "
                    "interval, where there are cases enough for one; orange: limit of the requirement.")
        )  # fmt: skip
    ranked = [influence for influence in influences if influence.output.name in names]
    if ranked:
        path = folder / "sensitivity.png"
        draw_influences(path, outcome, ranked)
        pictures.append(Picture(path, _caption_influences(ranked[0])))
        if len(outcome.plan.factors) > 1:
            path = folder / "scatter.png"
            draw_scatter(path, outcome, ranked[0])
            pictures.append(
                Picture(path, f"All cases over the two parameters that {ranked[0].output.title} depends on most.")
            )
    return pictures


def draw_distributions(path: Path, outcome: Outcome, found: Sequence[Percentiles]) -> None:
    """A histogram for each output, with its 95th percentile and its limit."""

    def paint(figure: Figure) -> None:
        for axes, one in zip(_make_grid(figure, len(found)), found, strict=False):
            values = outcome.values(one.output)
            values = values[np.isfinite(values)]
            factor, unit = _find_scale(one.output, values)
            axes.hist(factor * values, bins=min(60, max(5, round(2.0 * len(values) ** (1 / 3)))), color="#BBBBBB")
            stated = one.stated[UPPER]
            if np.isfinite([stated.lower, stated.upper]).all():
                axes.axvspan(factor * stated.lower, factor * stated.upper, color=ACTIVE, alpha=0.25, lw=0)
            axes.axvline(factor * stated.value, color=ACTIVE)
            if one.output.limit is not None:
                axes.axvline(factor * one.output.limit, color=PASSIVE)
            axes.set_title(_wrap(one.output.title), fontsize=10)
            axes.set_xlabel(unit or "1")
            axes.set_ylabel("cases")

    draw(path, 4.6 * min(COLUMNS, len(found)), 0.4 + 3.1 * _count_rows(len(found)), paint)


def draw_influences(path: Path, outcome: Outcome, found: Sequence[Influence]) -> None:
    """Bars of each factor for each output, the strongest on top."""
    names = [factor.name for factor in outcome.plan.factors]

    def paint(figure: Figure) -> None:
        for axes, influence in zip(_make_grid(figure, len(found)), found, strict=False):
            order = np.argsort(influence.strength)[::-1][:MOST_FACTORS][::-1]
            places = np.arange(len(order))
            if "sobol_total" in influence.measures:
                _draw_sobol(axes, influence, order, places)
            elif "morris_mu_star" in influence.measures:
                axes.barh(places, influence.measures["morris_mu_star"][order], color=ACTIVE)
                axes.set_xlabel(f"\N{GREEK SMALL LETTER MU}* ({pretty(influence.output.unit) or '1'})")
            else:
                values = influence.rank_correlation[order]
                axes.barh(places, values, color=np.where(values < 0.0, PASSIVE, ACTIVE))
                axes.set_xlim(-1.0, 1.0)
                axes.axvline(0.0, color=REFERENCE, lw=0.8)
                axes.set_xlabel("rank correlation")
            axes.set_yticks(places, [_wrap(names[place], 22) for place in order], fontsize=10)
            axes.set_title(_wrap(influence.output.title), fontsize=10)

    bars = min(MOST_FACTORS, len(names))
    draw(path, 5.2 * min(COLUMNS, len(found)), 0.4 + (1.5 + 0.32 * bars) * _count_rows(len(found)), paint)


def draw_scatter(path: Path, outcome: Outcome, influence: Influence) -> None:
    """All cases over the two strongest factors, coloured by the output."""
    first, second = np.argsort(influence.strength)[::-1][:2]
    output = influence.output
    values = outcome.values(output)
    there = np.isfinite(values)
    factor, unit = _find_scale(output, values)

    def paint(figure: Figure) -> None:
        axes = figure.subplots()
        factors, draws = outcome.plan.factors, outcome.plan.draws
        x, y = draws[:, first], draws[:, second]
        shown = axes.scatter(x[there], y[there], c=factor * values[there], s=_find_size(there.sum()), cmap="viridis")
        if not there.all():
            axes.scatter(x[~there], y[~there], color=PASSIVE, marker="x", label="no result")
            axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0))
        axes.set_xlabel(_label_factor(factors[first].name, factors[first].unit))
        axes.set_ylabel(_label_factor(factors[second].name, factors[second].unit))
        bar = figure.colorbar(shown, ax=axes)
        bar.set_label(f"{output.title} ({unit or '1'})", fontsize=11)
        if output.limit is not None:
            bar.ax.axhline(factor * output.limit, color=PASSIVE)

    draw(path, 9.0, 6.0, paint)


def _draw_sobol(axes: Axes, influence: Influence, order: NDArray[np.intp], places: NDArray[np.intp]) -> None:
    for name, color, shift in (("sobol_total", ACTIVE, 0.2), ("sobol_first", PASSIVE, -0.2)):
        value = influence.measures[name][order]
        ends = [influence.measures[f"{name}_{end}"][order] for end in ("low", "high")]
        errors = np.maximum(np.array([value - ends[0], ends[1] - value]), 0.0)
        label = "total" if name == "sobol_total" else "first order"
        axes.barh(places + shift, value, height=0.38, xerr=errors, color=color, label=label, ecolor=REFERENCE)
    axes.set_xlabel("Sobol' index")
    axes.legend(fontsize=9, loc="lower right")  # beside the weakest


def _caption_influences(influence: Influence) -> str:
    if "sobol_total" in influence.measures:
        return f"Sobol' indices: share of the variance, with {100 * CONFIDENCE:g} % intervals (bootstrap)."
    if "morris_mu_star" in influence.measures:
        return "Morris' elementary effects: mean magnitude over the whole range of a parameter."
    return "Spearman's rank correlation with each parameter: blue where the output rises with it, orange where not."


def _make_grid(figure: Figure, count: int) -> list[Axes]:
    grid = figure.subplots(_count_rows(count), min(COLUMNS, count), squeeze=False).ravel()
    for axes in grid[count:]:
        axes.set_axis_off()
    return list(grid)


def _count_rows(count: int) -> int:
    return -(-count // min(COLUMNS, count))


def _find_scale(output: Output, values: Array) -> tuple[float, str]:
    return engineering(output.unit, largest((values,)))


def _find_size(count: int) -> float:
    return 36.0 if count < 500 else 9.0


def _label_factor(name: str, unit: str) -> str:
    return f"{name} ({pretty(unit) or '1'})"


def _wrap(text: str, width: int = 38) -> str:
    """Lines of at most ``width`` characters; dots are places to break, too."""
    return "\n".join(line.replace(". ", ".") for line in textwrap.wrap(text.replace(".", ". "), width))
