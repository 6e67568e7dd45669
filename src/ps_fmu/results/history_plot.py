"""Signals over time of the cases of a run, as a figure that a notebook shows."""

from __future__ import annotations

import io
from collections.abc import Mapping
from itertools import cycle
from typing import TYPE_CHECKING

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure

from .figures import paint_charts
from .page.content import Axis, Chart, ChartGroup, Curve
from .style import COLOURS, DOTS_PER_INCH, STYLE

if TYPE_CHECKING:
    from xarray import DataArray

_OWN = {
    "passive": "passive", "isolator_off": "passive", "loop_off": "passive",
    "active": "active", "isolator_on": "active", "loop_on": "active",
}  # fmt: skip
_OTHERS = [(colour, drawn) for drawn in ("line", "dashed", "dotted") for colour in (*"xyz", "fault", "reference")]


class ShownFigure(Figure):
    """A figure that notebooks show where it is the value of a cell, without matplotlib's pyplot."""

    def _repr_png_(self) -> bytes:
        image = io.BytesIO()
        self.savefig(image, format="png")
        return image.getvalue()


def plot_histories(signals: Mapping[str, DataArray]) -> ShownFigure:
    """Draw a signal (time,) or (time, components) of several cases over time, a row per component.

    Parameters
    ----------
    signals: by the name of the case; as :func:`ps_fmu.results.datasets.read_case` reads them.

    Raises ValueError if there is none, or they have different shapes.
    """
    if not signals or len({signal.sizes.get(d) for signal in signals.values() for d in signal.dims[1:]}) > 1:
        raise ValueError("expected one or more signals with the same components")
    first = next(iter(signals.values()))
    rows = [str(first.name)] if first.ndim == 1 else [str(name) for name in first[first.dims[1]].values]
    taken = {COLOURS[_OWN[case]] for case in signals if case in _OWN}
    others = cycle(other for other in _OTHERS if COLOURS[other[0]] not in taken)
    looks = {case: (_OWN[case], "line") if case in _OWN else next(others) for case in signals}
    time = max((np.asarray(signal["time"]) for signal in signals.values()), key=len)
    charts = [
        Chart(row, str(first.attrs.get("units", "1")), [
            Curve(case, looks[case][0], _take(signal, place, time), drawn=looks[case][1])
            for case, signal in signals.items()
        ])
        for place, row in enumerate(rows)
    ]  # fmt: skip
    title = f"{first.name}: {first.attrs.get('long_name', '')}"
    with rc_context(STYLE):
        figure = ShownFigure(figsize=(10.0, 1.4 + 2.3 * len(rows)), dpi=DOTS_PER_INCH, layout="constrained")
        paint_charts(figure, ChartGroup(title, "", Axis("time", "s", time), charts))
    return figure


def _take(signal: DataArray, component: int, time: np.ndarray) -> np.ndarray:
    """A component at times (n,), s, of the longest case; NaN after the end of a shorter one."""
    values = np.asarray(signal, dtype=float).reshape(len(signal), -1)[:, component]
    return np.interp(time, signal["time"], values, right=np.nan)
