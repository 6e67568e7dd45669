"""The icon, drawn by docs/draw_icons.py: bus with solar arrays, six legs, platform with telescope."""

from typing import Any

from matplotlib.axes import Axes
from matplotlib.patches import Polygon, Rectangle


def draw(axes: Axes, colours: Any) -> None:
    """Draw on a tile from 0 to 100 in x and y."""
    for x in (7, 71):
        axes.add_patch(Rectangle((x, 15), 22, 9, fc=colours.blue, ec=colours.ink, lw=1.5))
    axes.add_patch(Rectangle((33, 9), 34, 21, fc=colours.grey, ec=colours.ink, lw=2))
    for x_base, x_platform in ((37, 33), (53, 59), (63, 67)):
        axes.plot([x_base, x_platform], [30, 53], color=colours.ink, lw=2.4)
    for x_base, x_platform in ((42, 40), (47, 51), (58, 62)):
        axes.plot([x_base, x_platform], [30, 53], color=colours.orange, lw=1.6)
    axes.plot([29, 71], [55, 55], color=colours.ink, lw=3.6)
    axes.add_patch(Polygon([(37, 57), (63, 57), (60, 90), (40, 90)], fc="white", ec=colours.ink, lw=2))
    axes.plot([44, 56], [83, 83], color=colours.blue, lw=2.5)
