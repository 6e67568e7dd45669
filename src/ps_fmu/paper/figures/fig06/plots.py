"""Figures of the workspace analysis."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ....results.style import ACTIVE, PASSIVE, REFERENCE, draw
from ...published import ANGLES
from .results import CLAIMED_LIMIT, Reach, round_down

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def draw_envelope(path: Path, reach: Reach) -> None:
    """The surface in three dimensions, and its three projections with the largest cube."""
    from matplotlib import colormaps
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    angles = np.degrees(reach.surface.orientation)
    condition = reach.surface.condition
    scale = Normalize(condition.min(), condition.max())
    colours = ScalarMappable(scale, colormaps["viridis"])

    def paint(figure: Figure) -> None:
        parts: Any = figure.subfigures(2, 1, height_ratios=(1.9, 1.0))
        upper, lower = parts
        space = upper.add_subplot(projection="3d")
        for face in _faces(reach.surface.coarse_displacement):
            space.plot_surface(
                *np.moveaxis(angles[face], -1, 0), facecolors=colours.to_rgba(condition[face]),
                rstride=1, cstride=1, shade=False, linewidth=0.2, edgecolor="#00000040",
            )  # fmt: skip
        space.set(xlabel="roll (deg)", ylabel="pitch (deg)", zlabel="yaw (deg)")
        space.xaxis.labelpad = space.yaxis.labelpad = 12.0
        space.view_init(elev=22.0, azim=-52.0)
        space.set_box_aspect((1.0, 1.0, 1.0), zoom=0.95)
        upper.colorbar(colours, ax=space, label="condition number of the Jacobian", shrink=0.7, pad=0.08)
        a = reach.cube
        for axes, (i, j) in zip(lower.subplots(1, 3), combinations(range(3), 2), strict=True):
            axes.scatter(angles[:, i], angles[:, j], color=REFERENCE, s=1.5, label="surface")
            axes.plot([-a, a, a, -a, -a], [-a, -a, a, a, -a], color=PASSIVE, label=f"largest cube, ±{a:.1f} deg")
            axes.set(xlabel=f"{ANGLES[i]} (deg)", ylabel=f"{ANGLES[j]} (deg)", aspect="equal")
        lower.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=2, markerscale=4.0)
        figure.suptitle("Workspace with the fine legs at nominal length")

    draw(path, 11.0, 13.0, paint)


def _faces(displacement: np.ndarray) -> Iterator[np.ndarray]:
    """Places of the points of each face of the joint space, (n, n), neighbours side by side."""
    for axis in range(3):
        for end in (displacement.min(), displacement.max()):
            places = np.flatnonzero(displacement[:, axis] == end)
            n = round(places.size**0.5)
            yield places.reshape(n, n)


def draw_cone(path: Path, reach: Reach) -> None:
    """How far the boresight can be tilted, seen along z of B: direction and distance are those of the tilt."""
    all_round = np.linspace(0.0, 360.0, 361)
    cones = ((reach.cone, PASSIVE), (CLAIMED_LIMIT, REFERENCE), (reach.cone_with_free_twist, ACTIVE))
    labels = (
        f"any direction, no twist: {round_down(reach.cone)} deg",
        f"{CLAIMED_LIMIT:g} deg of the paper",
        f"any direction, best twist: {round_down(reach.cone_with_free_twist)} deg",
    )

    def paint(figure: Figure) -> None:
        axes = figure.add_subplot()
        axes.plot(*_close_curve(reach.rim_azimuth, reach.rim_tilt), color=ACTIVE, linewidth=2.4, label="best twist")
        axes.plot(*_close_curve(reach.azimuth, reach.tilt), color=PASSIVE, linewidth=2.4, label="no twist")
        for (tilt, colour), label in zip(cones, labels, strict=True):
            circle = _close_curve(all_round, np.full_like(all_round, tilt))
            axes.plot(*circle, color=colour, linestyle="--", linewidth=1.2, label=label)
        axes.set(xlabel="tilt towards x of B (deg)", ylabel="tilt towards y of B (deg)", aspect="equal")
        axes.set_title("Largest tilt of the boresight, by direction")
        figure.legend(loc="outside lower center", ncols=2)

    draw(path, 8.0, 8.6, paint)


def _close_curve(azimuth: np.ndarray, tilt: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points (x, y), deg, of the closed curve of tilts, deg, in the directions of azimuths, deg."""
    around, out = np.radians(np.append(azimuth, azimuth[0])), np.append(tilt, tilt[0])
    return out * np.cos(around), out * np.sin(around)
