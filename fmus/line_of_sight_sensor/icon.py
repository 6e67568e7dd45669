"""The icon, drawn by docs/draw_icons.py: a target in the field of view."""

from typing import Any

from matplotlib.axes import Axes
from matplotlib.patches import Circle, Rectangle


def draw(axes: Axes, colours: Any) -> None:
    """Draw on a tile from 0 to 100 in x and y."""
    axes.add_patch(Rectangle((18, 18), 64, 64, fill=False, ec=colours.grey, lw=2.0))
    axes.plot([50, 50], [10, 42], color=colours.blue, lw=2.4)
    axes.plot([50, 50], [58, 90], color=colours.blue, lw=2.4)
    axes.plot([10, 42], [50, 50], color=colours.blue, lw=2.4)
    axes.plot([58, 90], [50, 50], color=colours.blue, lw=2.4)
    axes.add_patch(Circle((61, 63), 6.5, fc=colours.orange, ec="none"))
