"""What the reports of slews let their readers explore: charts of both runs, and the moving mechanism."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..cosim.recording.decimate import PASS_BAND
from ..reduction.columns import NETCDF_LOCK
from ..results.observers.envelope import Envelope
from ..results.page.content import Axis, Chart, ChartGroup, Curve, Exploration
from ..results.plots import shorten_name
from ..runs.setup import RunSystem
from .exploration import HOW_TO_ZOOM, show_mechanism
from .jitter_record import ROTATION
from .slew_report import CASES as GROUPS
from .slew_report import Slews
from .spectra_charts import FEWEST_ROWS, MOST_ROWS, chart_settled

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
    settled = _chart_settled(slews, system, results)
    runs = [(case, name) for (case, _), name in zip(CASES, GROUPS, strict=True)]
    return Exploration([group, *settled], mechanism=show_mechanism(system, results, runs))


def _chart_settled(slews: Slews, system: RunSystem, results: Path) -> list[ChartGroup]:
    """Rotation of the payload after the profile, from the stored rows; none if the run ends before, or has none."""
    began_s = slews.on.arrival.ended_s
    if slews.on.arrival.after is None or began_s is None:
        return []
    rows, span, step_s, highest = [], (began_s, began_s), 1.0, None
    import netCDF4

    with NETCDF_LOCK, netCDF4.Dataset(results) as file:
        for (label, colour), name in zip(CASES, GROUPS, strict=True):
            group = file[name]
            if not set(ROTATION) <= group.variables.keys():
                return []
            time = np.asarray(group["time"])
            first = max(int(np.searchsorted(time, began_s, side="right")), len(time) - MOST_ROWS)
            if len(time) - first < FEWEST_ROWS:
                return []
            rows.append((label, colour, np.column_stack([np.asarray(group[axis][first:]) for axis in ROTATION])))
            span, step_s = (float(time[first]), float(time[-1])), float(time[-1] - time[0]) / (len(time) - 1)
            highest = 0.5 * PASS_BAND / step_s if step_s > 1.5 * float(group.step_s) else None
    names = [shorten_name(name) for name in ROTATION]
    return chart_settled("rotation of the payload by vibration, axes of P", names, span, rows, step_s, highest)


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
