"""Pictures of the jitter analysis."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from ....mechanism.parameters import Array
from ....results.style import ACTIVE, AXES, PASSIVE, REFERENCE
from ....results.tables import format_angles
from ....theory.sampled import LOOP_DELAY
from .runs import ORIENTATIONS, OrientationResult, compute_rms_below, published_value

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from ....results.observers.scatter import Scatter
    from ....theory.transmissibility import Jitter

DEVIATIONS = ((1.0, "-"), (3.0, "--"))  # standard deviations of the ellipses, and their lines


def paint_image(figure: Figure, results: Mapping[str, OrientationResult]) -> None:
    """Image points and hull of the runs, ellipses of the closed form; passive above, active below."""
    grid = figure.subplots(2, len(results), squeeze=False)
    for column, r in enumerate(results.values()):
        passive, active = grid[:, column]
        _draw_cloud(passive, r.measured.passive.scatter, r.theory[0], PASSIVE, 1e6, "µm")
        _draw_cloud(active, r.measured.active.scatter, r.delayed, ACTIVE, 1e9, "nm")
        passive.set_title(f"{format_angles(ORIENTATIONS[r.name])}°")
    grid[0, 0].set_ylabel("passive, y (µm)")
    grid[1, 0].set_ylabel("active, y (nm)")
    for row in grid:  # one scale for all orientations
        across, along = (
            1.05 * max(max(map(abs, limits)) for limits in found)
            for found in ([axes.get_xlim() for axes in row], [axes.get_ylim() for axes in row])
        )
        for axes in row:
            axes.set(xlim=(-across, across), ylim=(-along, along), aspect="equal")
    figure.legend(*active.get_legend_handles_labels(), loc="outside lower center", ncols=4, markerscale=4.0)
    figure.suptitle("Image point: co-simulated, and standard deviations in closed form")


def _draw_cloud(axes: Axes, scatter: Scatter, theory: Jitter, colour: str, factor: float, unit: str) -> None:
    points, hull = ((values - scatter.centre) * factor for values in (scatter.points, scatter.hull))
    axes.plot(*points.T, ".", color=colour, ms=2.0, alpha=0.4, mew=0.0, label="image points, thinned out")
    axes.plot(*np.concatenate((hull, hull[:1])).T, color=colour, label="convex hull of all points")
    for deviations, style in DEVIATIONS:
        ellipse = deviations * factor * _ellipse(theory.image_covariance)
        axes.plot(*ellipse, color="black", ls=style, lw=1.3, label=rf"{deviations:g} $\sigma$, closed form")
    axes.set_xlabel(f"x ({unit})")


def _ellipse(covariance: Array) -> Array:
    """Points (2, n) at one standard deviation."""
    turn = np.linspace(0.0, 2.0 * np.pi, 200)
    values, vectors = np.linalg.eigh(covariance)
    return np.asarray(vectors @ (np.sqrt(values)[:, None] * np.stack([np.cos(turn), np.sin(turn)])))


def paint_rms(figure: Figure, results: Mapping[str, OrientationResult]) -> None:
    """Bars for each orientation and axis: published, closed form, co-simulated; passive above, active below."""
    grid = figure.subplots(2, 1)
    for axes, what, factor, unit, colour in (
        (grid[0], "passive", 1e6, "µrad", PASSIVE),
        (grid[1], "active", 1e9, "nrad", ACTIVE),
    ):
        place = np.concatenate([3.6 * k + np.arange(3.0) for k in range(len(results))])
        which = 0 if what == "passive" else 1
        bars = (
            ("published", [published_value(name, what) for name in results], REFERENCE, ""),
            ("closed form", [r.theory[which].rms for r in results.values()], colour, "///"),
            (
                "co-simulated",
                [r.rms[which] for r in results.values()],
                colour,
                "",
            ),
        )
        for k, (text, values, fill, hatch) in enumerate(bars):
            axes.bar(
                place + 0.27 * (k - 1), factor * np.concatenate(values), 0.25, label=text,
                color="white" if hatch else fill, edgecolor=fill, hatch=hatch,
            )  # fmt: skip
        axes.set_xticks(place, ["axis 1", "2", "3"] * len(results))
        axes.set_ylabel(f"{what} RMS ({unit})")
        axes.grid(axis="x", visible=False)
        axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
    for k, name in enumerate(results):
        grid[0].text(3.6 * k + 1.0, 1.02, f"{format_angles(ORIENTATIONS[name])}°", ha="center", va="bottom",
                     transform=grid[0].get_xaxis_transform())  # fmt: skip
    figure.suptitle("RMS of the payload's rotation; active axis 2 is not reproduced")


def paint_cumulative(figure: Figure, densities: Sequence[tuple[Array, Array]]) -> None:
    """RMS of everything below a frequency, three axes; passive on the left, active on the right."""
    for axes, (frequency, density), case, factor, unit in zip(
        figure.subplots(1, 2), densities, ("passive", "active"), (1e6, 1e9), ("µrad", "nrad"), strict=True
    ):
        rms = factor * compute_rms_below(frequency, density)
        for i, colour in enumerate(AXES):
            axes.semilogx(frequency, rms[:, i], color=colour, label=f"axis {i + 1}")
        axes.set(xlabel="frequency (Hz)", ylabel=f"RMS below frequency ({unit})", title=case, ylim=(0.0, None))
        axes.set_xlim(frequency[0], frequency[-1])
    axes.legend(loc="lower right")
    figure.suptitle(f"Where the jitter comes from: closed form with {LOOP_DELAY:g} steps of delay, at (0, 0, 0)°")
