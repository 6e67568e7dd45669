"""A first look at any run: all columns over time, those of one unit in one panel."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from .style import draw, engineering, label, largest, shade

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

MOST_PANELS = 8
MOST_LINES = 6
MOST_POINTS = 4000
"""Of a line; a longer record is drawn as the lowest and highest value of each bin."""
_COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")  # M. Okabe, K. Ito (2008)


@dataclass(frozen=True)
class Line:
    """A column: its name, its unit ("1": none), whether it is held between its values, and what reads them (rows,).

    Only those that are drawn are read: to read all of thousands of columns of a file takes minutes.
    """

    name: str
    unit: str
    held: bool
    read: Callable[[], Array]


def draw_quick_plot(
    path: Path,
    time: Array,
    lines: Sequence[Line],
    *,
    title: str,
    shaded: Sequence[tuple[float, float]] = (),
) -> str:
    """Draw lines over ``time`` [s] into a PNG file; what is left out, "" for nothing.  ``shaded``: a fault acts [s].

    Each unit has a panel of its own, at most :data:`MOST_LINES` lines in each; values without a unit that are held
    (Integers, Booleans) have one, too.
    """
    panels: list[list[Line]] = []
    open_panels: dict[tuple[str, bool], list[Line]] = {}
    for line in lines:
        key = line.unit, line.held
        if key not in open_panels or len(open_panels[key]) == MOST_LINES:
            open_panels[key] = []
            panels.append(open_panels[key])
        open_panels[key].append(line)
    shown = panels[:MOST_PANELS]

    def paint(figure: Figure) -> None:
        grid = figure.subplots(len(shown), 1, sharex=True, squeeze=False)[:, 0]
        for axes, panel in zip(grid, shown, strict=True):
            _draw_panel(axes, time, panel)
            shade(axes, shaded)
        grid[-1].set_xlabel("time (s)")
        figure.suptitle(title, wrap=True)

    draw(path, 11.0, 1.0 + 2.4 * len(shown), paint)
    left = sum(map(len, panels[MOST_PANELS:]))
    return f"{left} of {len(lines)} columns are not in the plot: choose some with --observe" if left else ""


def _draw_panel(axes: Axes, time: Array, panel: Sequence[Line]) -> None:
    held, unit = panel[0].held, panel[0].unit
    columns = [line.read() for line in panel]
    factor, scaled = (1.0, unit) if held else engineering(unit, largest(columns))
    drawn = []
    for column, colour in zip(columns, _COLOURS, strict=False):
        at, values = _thin(time, column)
        drawn += axes.plot(at, values * factor, color=colour, drawstyle="steps-post" if held else "default")
    label(axes, "value", scaled)
    # With handles: a name that begins with an underscore would hide its line.
    names = [_shorten(line.name) for line in panel]
    axes.legend(drawn, names, loc="upper left", bbox_to_anchor=(1.0, 1.0), fontsize=9.0)
    axes.margins(x=0.0)


def _thin(time: Array, values: Array) -> tuple[Array, Array]:
    """At most some thousand points with the same look."""
    if len(time) <= MOST_POINTS:
        return time, values
    size = -(-2 * len(time) // MOST_POINTS)
    whole = len(time) // size * size
    bins = values[:whole].reshape(-1, size)
    both = np.column_stack([bins.min(axis=1), bins.max(axis=1)]).ravel()
    at = np.repeat(time[:whole:size], 2)
    return np.append(at, time[-1]), np.append(both, values[-1])


def _shorten(name: str) -> str:
    name = name.replace("$", r"\$")  # no formula
    return name if len(name) <= 36 else f"...{name[-33:]}"
