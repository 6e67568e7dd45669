"""A picture of a mechanism from its parameters: legs and joints with names, frames, centre of mass of the payload.

Two views along axes of B at the nominal pose: from the side (x to the right, z up) and from above (x to the right, y
up).  Lengths are to scale.
"""

from __future__ import annotations

import io
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..files.plain import write_atomically
from ..mechanism.parameters import Parameters
from ..mechanism.quantities import Array

if TYPE_CHECKING:
    from matplotlib.figure import Figure

HOLLOW: dict[str, Any] = {"color": "#4b5563", "markerfacecolor": "white", "linestyle": ""}
COARSE, FINE, BODY = "#c2410c", "#1d4ed8", "#4b5563"
VIEWS = (("from the side", 0, 2), ("from above", 0, 1))
AXES = "xyz"


def draw_instrument(p: Parameters, path: Path) -> None:
    """Draw the mechanism of a parameter set into a file, as its ending says (``.svg``, ``.png``, ``.pdf``).

    Raises OSError where it cannot be written, ValueError for another ending.
    """
    from matplotlib import rc_context

    content = io.BytesIO()
    metadata = {"Date": None} if path.suffix == ".svg" else None
    with rc_context({"svg.hashsalt": "ps_fmu"}):  # the same bytes each time
        make_figure(p).savefig(content, format=path.suffix.lstrip("."), metadata=metadata)
    write_atomically(path, content.getvalue())


def make_figure(p: Parameters) -> Figure:
    """The picture of the mechanism of a parameter set."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

    figure = Figure(figsize=(11.0, 6.4), layout="constrained")
    FigureCanvasAgg(figure)
    geometry = p.manipulator.geometry
    lower, upper = geometry.base_joints_B, geometry.nominal_translation_B + geometry.platform_joints_P
    com = geometry.nominal_translation_B + p.payload.com_P
    size = float(np.ptp(np.vstack([lower, upper, com, np.zeros((1, 3))]), axis=0).max())
    panels = figure.subplots(1, 2)
    for axes, (title, right, up) in zip(panels, VIEWS, strict=True):
        view = [right, up]
        _draw_bodies(axes, lower[:, view], upper[:, view])
        for k in range(6):
            name, colour = (f"c{k + 1}", COARSE) if k < 3 else (f"f{k - 2}", FINE)
            ends = np.array([lower[k, view], upper[k, view]])
            axes.plot(*(1e3 * ends.T), color=colour, linewidth=4.0 if k < 3 else 2.2, zorder=3)
            for end, shape in zip(ends, ("o", "s"), strict=True):
                axes.plot(*(1e3 * end), shape, color=colour, markerfacecolor="white", markersize=6.5, zorder=4)
            _name(axes, ends, 0.3 if k < 3 else 0.65, name, colour)
        _draw_frame(axes, np.zeros(2), view, "B", size, (-10, -10))
        _draw_frame(axes, geometry.nominal_translation_B[view], view, "P", size, (-10, 10))
        axes.plot(*(1e3 * com[view]), marker="P", color="black", markersize=9.0, linestyle="", zorder=5)
        axes.set_title(f"{title}: {AXES[right]} and {AXES[up]} of B")
        axes.set_xlabel(f"{AXES[right]} (mm)")
        axes.set_ylabel(f"{AXES[up]} (mm)")
        axes.set_aspect("equal")
        axes.margins(0.16)
        axes.grid(color="#e5e7eb")
    low, high = 1e3 * geometry.coarse_stroke
    lengths = 1e3 * geometry.nominal_lengths
    marks = (
        ({"color": COARSE, "linewidth": 4.0}, f"coarse legs c1 to c3, {_range(lengths[:3])}, {low:g} to {high:g} mm"),
        ({"color": FINE, "linewidth": 2.2}, f"fine legs f1 to f3, {_range(lengths[3:])}"),
        ({"marker": "o", **HOLLOW}, "base_joint_B"),
        ({"marker": "s", **HOLLOW}, "platform_joint_P"),
        ({"marker": "P", "color": "black", "linestyle": ""}, f"centre of mass of the payload, {p.payload.mass:g} kg"),
    )
    lines = [Line2D([], [], label=label, **style) for style, label in marks]
    figure.legend(handles=lines, loc="outside lower center", ncols=3, fontsize=9)
    return figure


def _range(lengths: Array) -> str:
    low, high = f"{lengths.min():.1f}", f"{lengths.max():.1f}"
    return f"{low} mm" if low == high else f"{low} to {high} mm"


def _draw_bodies(axes: Any, lower: Array, upper: Array) -> None:
    """Outlines of the two rings of joints."""
    from scipy.spatial import ConvexHull, QhullError

    for points in (lower, upper):
        try:
            corners = points[ConvexHull(points).vertices]
        except QhullError:  # in a line, as seen from the side
            order = np.argsort(points @ (np.ptp(points, axis=0) >= np.ptp(points, axis=0).max()))
            corners = points[order[[0, -1]]]
        axes.fill(*(1e3 * corners.T), facecolor="#f3f4f6", edgecolor=BODY, linewidth=1.2, zorder=1)


def _name(axes: Any, ends: Array, share: float, name: str, colour: str) -> None:
    """The name of a leg beside it, where a ``share`` of its length is below."""
    along = ends[1] - ends[0]
    length = float(np.linalg.norm(along))
    aside = 12.0 * np.array([-along[1], along[0]]) / length if length > 0.0 else np.array([8.0, 8.0])
    at = 1e3 * (ends[0] + share * along)
    axes.annotate(
        name, at, aside, textcoords="offset points", color=colour, ha="center", va="center", fontsize=10, zorder=6,
        bbox={"boxstyle": "round,pad=0.1", "facecolor": "white", "edgecolor": "none", "alpha": 0.8},
    )  # fmt: skip


def _draw_frame(axes: Any, at: Array, view: list[int], name: str, size: float, shift: tuple[int, int]) -> None:
    """The axes of a frame that lie in the view."""
    arrow = {"arrowstyle": "-|>", "color": "black", "linewidth": 1.4}
    for k, axis in enumerate(view):
        tip = np.zeros(2)
        tip[k] = 0.16 * size
        axes.annotate("", 1e3 * (at + tip), 1e3 * at, zorder=5, arrowprops=arrow)
        axes.annotate(AXES[axis], 1e3 * (at + 1.12 * tip), ha="center", va="center", fontsize=8, zorder=6)
    axes.annotate(name, 1e3 * at, shift, textcoords="offset points", fontsize=11, weight="bold", zorder=6)
