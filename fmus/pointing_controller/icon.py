"""The icon, drawn by docs/draw_icons.py: an error that goes to zero, and stays there."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes


def draw(axes: Axes, colours: Any) -> None:
    """Draw on a tile from 0 to 100 in x and y."""
    t = np.linspace(0.0, 1.0, 200)
    step = 1.0 - np.exp(-7.0 * t) * (np.cos(11.0 * t) + 0.3 * np.sin(11.0 * t))
    axes.plot([8, 92], [68, 68], color=colours.orange, lw=2.4, ls=(0, (3, 2)))
    axes.plot([8, 92], [24, 24], color=colours.grey, lw=1.5)
    axes.plot(8 + 84 * t, 24 + 44 * step, color=colours.blue, lw=3.0, solid_joinstyle="round")
