"""Figures of the stability scenario: what follows the pulse, a panel per case."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ....mechanism.parameters import Array
from ....results.style import ACTIVE, PASSIVE, draw
from .pulse_response import PulseResponse

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLUMNS = 3
BIN_S = 0.2  # of an envelope: one cycle at 5 Hz


def response_figure(path: Path, responses: Sequence[PulseResponse], what: str) -> None:
    """``what``: "fine", envelope of the fine displacements, logarithmic; "payload", rotation of the payload."""
    names = list(dict.fromkeys(r.name for r in responses))

    def paint(figure: Figure) -> None:
        grid = figure.subplots(2, COLUMNS).reshape(-1)
        for axes, name in zip(grid, names, strict=False):
            for r in responses:
                if r.name == name or (not r.enabled and r.case == name.split(",")[0]):
                    (_fine if what == "fine" else _payload)(axes, r)
            axes.set_title(name)
            axes.set_xlabel("time (s)")
        for axes in grid[len(names) :]:
            axes.axis("off")
        for axes in grid[::COLUMNS]:
            axes.set_ylabel("fine displacement (µm)" if what == "fine" else "payload rotation (µrad)")
        grid[-1].legend(*grid[0].get_legend_handles_labels(), loc="center")
        figure.suptitle("After a pulse on the bus, isolator with 20 ms delay unless said otherwise")

    draw(path, 14.0, 8.0, paint)


def _fine(axes: Axes, r: PulseResponse) -> None:
    time, largest = _envelope(r.time, np.abs(r.fine).max(axis=1))
    axes.semilogy(time, 1e6 * largest, color=_colour(r), label=_label(r))
    if r.enabled:
        # Through the end of an unstable motion; through the start of a stable one, from the end of the pulse on.
        k = -1 if r.predicted.real > 0.0 else 2
        rate = largest[k] * np.exp(r.predicted.real * (time - time[k]))
        shown = (time >= time[2]) & (rate > 0.3 * largest.min())
        axes.semilogy(time[shown], 1e6 * rate[shown], "k--", lw=1.2, label="rate of the predicted pole")


def _payload(axes: Axes, r: PulseResponse) -> None:
    axes.plot(r.time, 1e6 * r.rotation[:, 0], color=_colour(r), lw=1.2, label=_label(r))


def _envelope(time: Array, values: Array) -> tuple[Array, Array]:
    """Largest value in each bin; the last one, which may not be full, is left out."""
    bins = (time / BIN_S + 1e-9).astype(int)
    starts = np.flatnonzero(np.diff(bins, prepend=-1))
    return time[starts[:-1]], np.maximum.reduceat(values, starts)[:-1]


def _colour(r: PulseResponse) -> str:
    return ACTIVE if r.enabled else PASSIVE


def _label(r: PulseResponse) -> str:
    return "isolator on" if r.enabled else "isolator off"
