"""A first look at any run: all columns over time, those of one unit in one panel."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from .figures import draw_charts
from .page.content import Axis, Chart, ChartGroup, Curve, Spans

Array = NDArray[np.float64]

MOST_PANELS = 8
MOST_LINES = 6
_COLOURS = (*"xyz", "fault", "amber", "sky")


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
    charts = [Chart("", "1" if panel[0].held else panel[0].unit, _make_curves(panel)) for panel in panels[:MOST_PANELS]]
    faults = [Spans("a fault acts", shaded, "fault", 0.25)] if shaded else []
    draw_charts(path, ChartGroup(title, "", Axis("time", "s", time), charts, shaded=faults))
    left = sum(map(len, panels[MOST_PANELS:]))
    return f"{left} of {len(lines)} columns are not in the plot: choose some with --observe" if left else ""


def _make_curves(panel: Sequence[Line]) -> list[Curve]:
    return [
        Curve(_shorten(line.name), colour, line.read(), drawn="steps" if line.held else "line")
        for line, colour in zip(panel, _COLOURS, strict=False)
    ]


def _shorten(name: str) -> str:
    return name if len(name) <= 36 else f"...{name[-33:]}"
