"""The figure of the comparison: each index over its closed form, with its intervals."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ...results.style import AXES, REFERENCE, draw
from .closed_form import ORIENTATIONS, SIGNALS
from .measured import Comparison

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_SHOWN = dict(zip(SIGNALS[:3], zip(AXES, (-0.22, 0.0, 0.22), strict=True), strict=True))  # colour and place in a row

_RANGE = (0.6, 1.6)  # of the ratio: intervals of slow indices go on beyond it


def draw_comparisons(path: Path, compared: Sequence[Comparison]) -> None:
    """A panel for each orientation, passive above and active below; x, y, z of the payload side by side."""
    names = list(dict.fromkeys(each.index for each in compared))

    def paint(figure: Figure) -> None:
        panels = figure.subplots(2, len(ORIENTATIONS), sharex=True, sharey=True)
        for row, active in zip(panels, (False, True), strict=True):
            for axes, (name, angles) in zip(row, ORIENTATIONS.items(), strict=True):
                own = [each for each in compared if (each.orientation, each.active) == (name, active)]
                _paint(axes, own, names)
                mode = "active" if active else "passive"
                axes.set_title("{}: ({:g}, {:g}, {:g})\N{DEGREE SIGN}".format(mode, *angles))
        panels[0, 0].set_yticks(np.arange(len(names)), names)
        panels[0, 0].invert_yaxis()
        panels[0, 0].set_xlim(*_RANGE)
        for axes in panels[1]:
            axes.set_xlabel("RMS on the FMUs over closed form")
        handles = panels[0, 0].get_legend_handles_labels()
        figure.legend(*handles, loc="outside lower center", ncols=len(_SHOWN), title="payload rotation about")
        figure.suptitle("Pointing indices: FMUs over closed form, intervals of 95 % (thick) and of all together (thin)")

    draw(path, 16.0, 15.0, paint)


def _paint(axes: Axes, own: Sequence[Comparison], names: Sequence[str]) -> None:
    axes.axvline(1.0, color=REFERENCE, lw=1.2)
    for signal, (colour, shift) in _SHOWN.items():
        found = {each.index: each for each in own if each.signal == signal}
        place = np.arange(len(names)) + shift
        value, low, high, lowest, highest = np.array(
            [
                np.array([e.stated.value, e.usual.lower, e.usual.upper, e.stated.lower, e.stated.upper]) / e.expected
                for e in (found[name] for name in names)
            ]
        ).T
        axes.hlines(place, lowest, highest, color=colour, lw=0.8)
        axes.hlines(place, low, high, color=colour, lw=2.6)
        axes.plot(value, place, "o", color=colour, ms=4, label=signal.rpartition(".")[2])
