"""The icon, drawn by docs/draw_icons.py: a vibration that ends."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes


def draw(axes: Axes, colours: Any) -> None:
    """Draw on a tile from 0 to 100 in x and y."""
    t = np.linspace(0.0, 1.0, 400)
    shake = 24 * np.sin(2 * np.pi * 6.5 * t) * np.exp(-((t / 0.52) ** 6))
    axes.plot([8, 92], [50, 50], color=colours.grey, lw=1.5)
    axes.plot(8 + 84 * t, 50 + shake, color=colours.blue, lw=2.6, solid_joinstyle="round")
    axes.plot([66, 92], [50, 50], color=colours.orange, lw=3.4, solid_capstyle="round")
