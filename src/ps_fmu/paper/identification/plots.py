"""Figures of ``ps-fmu identify``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ...mechanism import workspace
from ...mechanism.parameters import Array, Geometry, Parameters, load
from ...results.style import ACTIVE, PASSIVE, REFERENCE, draw
from ..figures.fig10.plots import break_jumps
from ..figures.fig10.results import BAND
from ..figures.table2.closed_form import ORIENTATIONS
from ..published import ANGLES, published_numbers
from . import geometry, noise, suspension
from .fit import targets

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from .steps import Identification

COARSE, FINE = ACTIVE, PASSIVE


def draw_candidates(path: Path, found: Identification) -> None:
    """Plan view of the joints, and outlines of all workspaces that meet Table 1 in the box of Table 1."""
    low, high = targets(geometry.KEYS).reshape(3, 2).T

    def paint(figure: Figure) -> None:
        plan, *planes = figure.subplots(1, 3)
        _draw_plan(plan, found.original.manipulator.geometry)
        for axes, (i, j) in zip(planes, ((0, 1), (1, 2)), strict=True):
            box = [low[i], high[i], high[i], low[i], low[i]], [low[j], low[j], high[j], high[j], low[j]]
            axes.plot(*box, color=REFERENCE, linestyle="--", label="Table 1")
            axes.set(xlabel=f"{ANGLES[i]} (deg)", ylabel=f"{ANGLES[j]} (deg)", aspect="equal")
            axes.set_title("outlines of workspaces")
        for candidate in sorted(found.candidates, key=lambda candidate: candidate is found.geometry):
            points = np.degrees(workspace.sample(candidate.geometry, workspace.surface(candidate.geometry)).orientation)
            chosen = candidate is found.geometry
            label, colour, width = ("chosen geometry", "black", 2.5) if chosen else ("others", "#009E73", 1.2)
            for axes, pair in zip(planes, ([0, 1], [1, 2]), strict=True):
                axes.plot(*_outline(points[:, pair]).T, color=colour, linewidth=width, label=label)
        labels = dict(
            pair for axes in (plan, planes[0]) for pair in zip(*axes.get_legend_handles_labels()[::-1], strict=True)
        )
        figure.legend(labels.values(), labels.keys(), loc="outside lower center", ncols=4)
        figure.suptitle("Six numbers do not fix a geometry: all of these meet Table 1")

    draw(path, 16.0, 7.5, paint)


def _draw_plan(axes: Axes, joints: Geometry) -> None:
    for name, colour, legs in (("coarse", COARSE, slice(0, 3)), ("fine", FINE, slice(3, 6))):
        base, platform = joints.base_joints_B[legs], joints.platform_joints_P[legs]
        axes.plot(*np.stack([base[:, :2], platform[:, :2]]).transpose(2, 0, 1), color=colour)
        axes.plot(*base[:, :2].T, "o", color=colour, markersize=9.0, label=f"{name}, on the base")
        style: dict[str, Any] = {"color": colour, "markersize": 9.0, "markerfacecolor": "white"}
        axes.plot(*platform[:, :2].T, "s", label=f"{name}, on the platform", **style)
    axes.set(xlabel="x of B (m)", ylabel="y of B (m)", aspect="equal", title="joints from above")


def _outline(points: Array) -> Array:
    """Convex outline of points in a plane, closed."""
    from scipy.spatial import ConvexHull

    corners = ConvexHull(points).vertices
    return points[np.append(corners, corners[0])]


def draw_loop(path: Path, found: Identification) -> None:
    """Gain and phase of L11 of the lighter support module, and the four numbers of Fig 10."""
    from ...theory.loop import loop_at

    first, second, turning, margin = targets(suspension.KEYS)
    delay = published_numbers()["text.delay"].value
    frequency = np.geomspace(*BAND, 3000)

    def curve(p: Parameters) -> Array:
        return np.asarray(loop_at(p, delay=delay).transfer(2j * np.pi * frequency)[:, 0, 0])

    def paint(figure: Figure) -> None:
        gain, phase = figure.subplots(2, 1, sharex=True)
        for p, label, width, colour in (
            (load(bus="LSM"), "paper.toml", 3.5, "#BBBBBB"),
            (found.lighter, "identified", 1.6, ACTIVE),
        ):
            L = curve(p)
            gain.semilogx(frequency, 20.0 * np.log10(np.abs(L)), color=colour, linewidth=width, label=label)
            phase.semilogx(frequency, break_jumps(np.degrees(np.angle(L))), color=colour, linewidth=width)
        gain.plot([first, second], [0.0, 0.0], "o", color=PASSIVE, label="Fig 10")
        phase.plot([turning, second], [-180.0, margin + 180.0], "o", color=PASSIVE)
        gain.axhline(0.0, color=REFERENCE, linestyle="--", linewidth=1.0)
        gain.set(ylabel="gain of L11 (dB)", ylim=(-50.0, 25.0))
        phase.set(ylabel="phase of L11 (deg)", xlabel="frequency (Hz)", yticks=np.arange(-180.0, 181.0, 90.0))
        phase.set_xticks([1, 2, 5, 10, 20, 30], ["1", "2", "5", "10", "20", "30"])
        gain.legend(ncols=3, loc="lower center", bbox_to_anchor=(0.5, 1.0))
        figure.suptitle("Loop of the lighter support module, delay 0.02 s")

    draw(path, 10.0, 8.0, paint)


def draw_rms(path: Path, found: Identification) -> None:
    """Passive and active RMS of Table 2, published and reached."""
    labels = [f"({roll:g}, {pitch:g}, {yaw:g})°" for roll, pitch, yaw in ORIENTATIONS.values()]

    def paint(figure: Figure) -> None:
        panels = figure.subplots(1, 3, sharey=True)
        place = np.arange(len(labels))
        for k, axes in enumerate(panels):
            for keys, reached, colour, what in (
                (noise.KEYS, found.passive_rms, PASSIVE, "passive"),
                (noise.ACTIVE_KEYS, found.active_rms, ACTIVE, "active"),
            ):
                axes.semilogy(place, 1e6 * targets(keys)[k::3], "_", color=colour, markersize=26.0, markeredgewidth=2.5,
                              label=f"{what}, Table 2")  # fmt: skip
                axes.semilogy(place, 1e6 * reached[k::3], "o", color=colour, markersize=7.0, label=f"{what}, reached")
            axes.set(title=f"axis {k + 1}", xlim=(-0.6, len(labels) - 0.4))
            axes.set_xticks(place, labels, rotation=30.0)
        panels[0].set_ylabel("RMS of the payload's rotation (µrad)")
        figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=4)
        figure.suptitle("Table 2 with the parameter set that was found")

    draw(path, 13.0, 6.0, paint)
