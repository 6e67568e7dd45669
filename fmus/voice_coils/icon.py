"""The icon, drawn by docs/draw_icons.py: a coil in the gap of a magnet, and the force on it."""

from typing import Any

from matplotlib.axes import Axes
from matplotlib.patches import Circle, Rectangle


def draw(axes: Axes, colours: Any) -> None:
    """Draw on a tile from 0 to 100 in x and y."""
    for y in (12, 74):
        axes.add_patch(Rectangle((8, y), 54, 14, fc=colours.grey, ec=colours.ink, lw=2))
    axes.add_patch(Rectangle((8, 41), 54, 18, fc=colours.blue, ec=colours.ink, lw=2))
    axes.add_patch(Rectangle((8, 12), 12, 76, fc=colours.grey, ec=colours.ink, lw=2))
    for x in (34, 42, 50, 58):
        for y in (33, 67):
            axes.add_patch(Circle((x, y), 4.6, fc=colours.orange, ec=colours.ink, lw=1.2))
    axes.annotate("", xy=(95, 50), xytext=(66, 50), arrowprops={"arrowstyle": "-|>", "lw": 3.4, "color": colours.ink})
