"""Signals over time of the cases of a run, as a figure that a notebook shows."""

from __future__ import annotations

import io
from collections.abc import Mapping
from itertools import cycle
from typing import TYPE_CHECKING

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure

from .style import ACTIVE, AXES, DOTS_PER_INCH, FAULT, PASSIVE, REFERENCE, STYLE, engineering, label, largest

if TYPE_CHECKING:
    from xarray import DataArray

_COLOURS = {
    name: colour for what in ("isolator", "loop") for name, colour in ((f"{what}_off", PASSIVE), (f"{what}_on", ACTIVE))
} | {"passive": PASSIVE, "active": ACTIVE}
_OTHERS = (*AXES, FAULT, REFERENCE)
_STYLES = ("-", "--", ":")


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
    rows = [""] if first.ndim == 1 else [str(name) for name in first[first.dims[1]].values]
    with rc_context(STYLE):
        figure = ShownFigure(figsize=(10.0, 1.2 + 2.3 * len(rows)), dpi=DOTS_PER_INCH, layout="constrained")
        grid = figure.subplots(len(rows), 1, sharex=True, squeeze=False)[:, 0]
        for place, (axes, row) in enumerate(zip(grid, rows, strict=True)):
            columns = {case: np.asarray(signal).reshape(len(signal), -1)[:, place] for case, signal in signals.items()}
            factor, unit = engineering(str(first.attrs.get("units", "")), largest(columns.values()))
            taken = {_COLOURS[case] for case in signals if case in _COLOURS}
            others = cycle((colour, style) for style in _STYLES for colour in _OTHERS if colour not in taken)
            for case, values in columns.items():
                colour, style = (_COLOURS[case], "-") if case in _COLOURS else next(others)
                axes.plot(signals[case]["time"], values * factor, style, color=colour, label=case, lw=1.0)
            label(axes, row or str(first.name), unit)
        grid[-1].set_xlabel("time (s)")
        grid[0].legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=len(signals))
        figure.suptitle(f"{first.name}: {first.attrs.get('long_name', '')}", fontsize=13.0, wrap=True)
    return figure
