"""The icon, drawn by docs/draw_icons.py: noise, and the wheel that makes some of it."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Circle


def draw(axes: Axes, colours: Any) -> None:
    """Draw on a tile from 0 to 100 in x and y."""
    noise = np.random.default_rng(7).standard_normal(23)
    force = 30 + 17 * noise / np.abs(noise).max()
    axes.plot(np.linspace(9, 91, 23), force, color=colours.blue, lw=2.4, solid_joinstyle="round")
    axes.add_patch(Circle((50, 72), 17, fc="white", ec=colours.ink, lw=3))
    for angle in np.radians([20, 140, 260]):
        axes.plot([50, 50 + 15 * np.cos(angle)], [72, 72 + 15 * np.sin(angle)], color=colours.ink, lw=2)
    axes.add_patch(Circle((50, 72), 4.5, fc=colours.orange, ec=colours.ink, lw=1.5, zorder=3))
