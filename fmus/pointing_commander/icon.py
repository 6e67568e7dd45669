"""The icon, drawn by docs/draw_icons.py: a smooth motion from one orientation to another."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Circle


def draw(axes: Axes, colours: Any) -> None:
    """Draw on a tile from 0 to 100 in x and y."""
    tau = np.linspace(0.0, 1.0, 60)
    s = tau**4 * (35 - 84 * tau + 70 * tau**2 - 20 * tau**3)
    axes.plot([12, 12, 90], [90, 12, 12], color=colours.grey, lw=2)
    axes.plot(12 + 46 * tau, 20 + 50 * s, color=colours.blue, lw=3.4, solid_capstyle="round")
    for radius, colour in ((16, colours.orange), (11, "white"), (5, colours.orange)):
        axes.add_patch(Circle((76, 70), radius, fc=colour, ec="none"))
