"""The icon, drawn by docs/draw_icons.py: a mass between two springs in its case, and the arrow of its axis."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Rectangle


def draw(axes: Axes, colours: Any) -> None:
    """Draw on a tile from 0 to 100 in x and y."""
    axes.add_patch(Rectangle((10, 36), 80, 42, fc="white", ec=colours.ink, lw=2.4))
    axes.add_patch(Rectangle((38, 45), 24, 24, fc=colours.blue, ec=colours.ink, lw=2.0))
    coil = np.linspace(0.0, 1.0, 200)
    for first in (10, 62):
        axes.plot(first + 28 * coil, 57 + 7 * np.sin(2 * np.pi * 4 * coil), color=colours.grey, lw=2.0)
    axes.annotate("", (88, 20), (12, 20), arrowprops={"arrowstyle": "-|>", "color": colours.orange, "lw": 3.2})
