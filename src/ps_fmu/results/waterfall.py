"""A waterfall: amplitude over frequency and speed, with the lines of harmonics and the frequencies of modes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from .style import draw, engineering

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

RANGE_DB = 100.0  # from the largest amplitude down: some 60 lie between the largest line and the smallest
SHOWN = 1.35  # times the highest mode: how far the picture goes
_COLOURS = "magma"
_BESIDE = 0.045  # of the width: names that are nearer than this are written as one


@dataclass(frozen=True, eq=False)
class Harmonic:
    """A harmonic: ``frequency`` (rows,), Hz, at each ordinate."""

    wheel: str
    order: float
    frequency: Array


@dataclass(frozen=True)
class ModeLine:
    """A natural mode of the structure, Hz."""

    name: str
    frequency: float


@dataclass(frozen=True)
class Place:
    """A place that is pointed out: the worst crossing of a case."""

    frequency: float
    ordinate: float
    text: str


@dataclass(frozen=True, eq=False)
class CasePanel:
    """The ``amplitude`` (rows, bins) of a case, and the place that is pointed out in it."""

    case: str
    amplitude: Array
    mark: Place | None = None


@dataclass(frozen=True, eq=False)
class Waterfall:
    """Panels of one size with common axes, both equally spaced: ``ordinate`` (rows,) and ``frequency`` (bins,), Hz.

    Raises ``ValueError`` for panels that do not fit.
    """

    title: str
    caption: str
    label: str
    """Of the ordinate."""
    ordinate_unit: str
    unit: str
    """Of the amplitudes."""
    ordinate: Array
    frequency: Array
    panels: Sequence[CasePanel]
    lines: Sequence[Harmonic]
    modes: Sequence[ModeLine]
    file: str = "waterfall.png"

    def __post_init__(self) -> None:
        expected = len(self.ordinate), len(self.frequency)
        for panel in self.panels:
            if panel.amplitude.shape != expected:
                raise ValueError(f"case {panel.case!r}: expected amplitudes of shape {expected}")

    @property
    def largest(self) -> float:
        """The largest amplitude; 1 where nothing moves."""
        return max((float(panel.amplitude.max(initial=0.0)) for panel in self.panels), default=0.0) or 1.0

    @property
    def shown(self) -> float:
        """How far pictures go, Hz: a third above the highest mode; what is further moves the payload little."""
        highest = max([mode.frequency for mode in self.modes], default=np.inf)
        return min(SHOWN * highest, float(self.frequency[-1]))

    def levels(self, panel: CasePanel) -> Array:
        """Of a panel in dB of the largest amplitude, not below ``-RANGE_DB``, (rows, bins)."""
        floor = self.largest * 10.0 ** (-RANGE_DB / 20.0)
        return np.asarray(20.0 * np.log10(np.maximum(panel.amplitude, floor) / self.largest))


def draw_waterfall(path: Path, shown: Waterfall) -> None:
    """The panels beside each other up to a third above the highest mode, colours in dB, lines and modes drawn in."""
    end = shown.shown

    def paint(figure: Figure) -> None:
        grid = figure.subplots(1, len(shown.panels), sharex=True, sharey=True, squeeze=False)[0]
        factor, unit = engineering(shown.unit, shown.largest)
        for axes, panel in zip(grid, shown.panels, strict=True):
            bins = np.flatnonzero(shown.frequency <= end)
            image = axes.pcolormesh(
                shown.frequency[bins], shown.ordinate, shown.levels(panel)[:, bins],
                cmap=_COLOURS, vmin=-RANGE_DB, vmax=0.0, shading="nearest", rasterized=True,
            )  # fmt: skip
            axes.grid(False)
            _draw_lines(axes, shown, end)
            _name_modes(axes, shown.modes, end)
            if panel.mark is not None:
                _point_out(axes, panel.mark, end)
            axes.set_xlim(0.0, end)
            axes.set_ylim(shown.ordinate[0], shown.ordinate[-1])
            axes.set_xlabel("frequency (Hz)")
            axes.text(
                0.985, 0.98, panel.case, transform=axes.transAxes, color="white", fontsize=16, ha="right", va="top",
                fontweight="bold",
            )  # fmt: skip
        grid[0].set_ylabel(f"{shown.label} ({shown.ordinate_unit})")
        bar = figure.colorbar(image, ax=list(grid), pad=0.01, aspect=40)
        bar.set_label(f"amplitude (dB, 0 dB = {factor * shown.largest:.3g} {unit})")
        figure.suptitle(shown.title)

    draw(path, 1.5 + 7.0 * len(shown.panels), 8.0, paint)


def _draw_lines(axes: Axes, shown: Waterfall, end: float) -> None:
    """Each harmonic dotted, with its order where it leaves the picture; orders that nearly agree are one label."""
    placed: list[tuple[float, float]] = []
    height = abs(shown.ordinate[-1] - shown.ordinate[0])
    for line in sorted(shown.lines, key=lambda each: each.order):
        axes.plot(line.frequency, shown.ordinate, color="white", lw=1.1, ls=(0, (1, 3)), alpha=0.9)
        inside = np.flatnonzero(line.frequency <= 0.985 * end)
        if not inside.size or not line.frequency.max() > 0.0:
            continue
        at = inside[np.argmax(line.frequency[inside])]
        x, y = float(line.frequency[at]), float(shown.ordinate[at])
        if all(abs(x - a) > 0.03 * end or abs(y - b) > 0.03 * height for a, b in placed):
            placed.append((x, y))
            axes.annotate(
                f"{line.order:g}", (x, y), xytext=(-2, -3), textcoords="offset points", color="white", fontsize=11,
                ha="right", va="top",
            )  # fmt: skip


def _name_modes(axes: Axes, modes: Sequence[ModeLine], end: float) -> None:
    """A line at each mode's frequency, and the names above the picture; neighbours share a label."""
    groups: list[list[ModeLine]] = []
    for mode in sorted(modes, key=lambda each: each.frequency):
        if mode.frequency > end:
            continue
        axes.axvline(mode.frequency, color="#7FDBFF", lw=0.8, alpha=0.8)
        if groups and mode.frequency - groups[-1][0].frequency < _BESIDE * end:
            groups[-1].append(mode)
        else:
            groups.append([mode])
    for group in groups:
        axes.annotate(
            name_group(group), (float(np.mean([mode.frequency for mode in group])), 1.0),
            xycoords=("data", "axes fraction"), xytext=(0, 4), textcoords="offset points", rotation=35.0, fontsize=12,
            ha="left", va="bottom", rotation_mode="anchor", annotation_clip=False,
        )  # fmt: skip


def name_group(modes: Sequence[ModeLine]) -> str:
    """One label for modes beside each other: the name of a single one, or the kinds of several."""
    if len(modes) == 1:
        return modes[0].name
    kinds = dict.fromkeys(mode.name.rsplit(" ", 1)[0] for mode in modes)
    return ", ".join(kind + ("s" if kind.endswith("mode") else "") for kind in kinds)


def _point_out(axes: Axes, mark: Place, end: float) -> None:
    axes.plot([mark.frequency], [mark.ordinate], marker="o", ms=12, mfc="none", mec="white", mew=1.8)
    right = mark.frequency < 0.6 * end
    axes.annotate(
        mark.text, (mark.frequency, mark.ordinate), xytext=(14 if right else -14, 0), textcoords="offset points",
        color="white", fontsize=11, ha="left" if right else "right", va="center",
        bbox={"boxstyle": "round", "fc": "#000000", "ec": "none", "alpha": 0.6},
    )  # fmt: skip
