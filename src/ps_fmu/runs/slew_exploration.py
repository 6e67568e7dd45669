"""What the reports of slews let their readers explore: charts of both runs, and the moving mechanism."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..results.observers.envelope import Envelope
from ..results.page.content import Axis, Chart, ChartGroup, Curve, Exploration
from ..results.plots import shorten_name
from .exploration import HOW_TO_ZOOM, show_mechanism
from .setup import RunSystem
from .slew_report import CASES as GROUPS
from .slew_report import Slews

CASES = (("isolator off", "passive"), ("isolator on", "active"))


def explore_slews(slews: Slews, system: RunSystem, results: Path) -> Exploration:
    """Orientation, rotation of the bus and fine legs of both runs, and the mechanism as stored in ``results``.

    Raises ``OSError`` if that cannot be read.
    """
    off, on = slews.off, slews.on
    nominal = [Curve("nominal", "reference", np.degrees(middle)) for middle in on.orientation.middle]
    charts = [
        *_chart(off.relative, on.relative, unit="deg", factor=float(np.degrees(1.0)), more=nominal),
        *_chart(off.bus, on.bus),
        *_chart(off.fine, on.fine),
    ]
    group = ChartGroup(
        "The slew over time",
        "Orientation of the platform relative to the bus, rotation of the bus, elongation of the fine legs. "
        f"{HOW_TO_ZOOM}",
        Axis("time", "s", on.relative.time),
        charts,
    )
    runs = [(case, name) for (case, _), name in zip(CASES, GROUPS, strict=True)]
    return Exploration([group], mechanism=show_mechanism(system, results, runs))


def _chart(
    off: Envelope, on: Envelope, *, unit: str | None = None, factor: float = 1.0, more: list[Curve] | None = None
) -> list[Chart]:
    charts = []
    for row, name in enumerate(on.names):
        curves = [
            Curve(case, colour, factor * envelope.low[row], factor * envelope.high[row])
            for (case, colour), envelope in zip(CASES, (off, on), strict=True)
        ]
        curves += more[row : row + 1] if more else []
        charts.append(Chart(shorten_name(name), unit or on.units[row], curves))
    return charts
