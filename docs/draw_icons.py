"""Draws the icons of the four FMUs, ``fmus/<name>/icon.png``: model.png in the FMU.

Usage: python docs/draw_icons.py [FOLDER]
"""

import sys
from pathlib import Path

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure
from matplotlib.patches import Circle, FancyBboxPatch, Polygon, Rectangle

INK, TILE, BLUE, ORANGE, GREY = "#222222", "#F7FAFD", "#0072B2", "#D55E00", "#9AA5B1"
PIXELS = 128


def plant(axes):
    """Bus with solar arrays, six legs, platform with telescope."""
    for x in (7, 71):
        axes.add_patch(Rectangle((x, 15), 22, 9, fc=BLUE, ec=INK, lw=1.5))
    axes.add_patch(Rectangle((33, 9), 34, 21, fc=GREY, ec=INK, lw=2))
    for x_base, x_platform in ((37, 33), (53, 59), (63, 67)):
        axes.plot([x_base, x_platform], [30, 53], color=INK, lw=2.4)
    for x_base, x_platform in ((42, 40), (47, 51), (58, 62)):
        axes.plot([x_base, x_platform], [30, 53], color=ORANGE, lw=1.6)
    axes.plot([29, 71], [55, 55], color=INK, lw=3.6)
    axes.add_patch(Polygon([(37, 57), (63, 57), (60, 90), (40, 90)], fc="white", ec=INK, lw=2))
    axes.plot([44, 56], [83, 83], color=BLUE, lw=2.5)


def commander(axes):
    """A smooth motion from one orientation to another."""
    tau = np.linspace(0.0, 1.0, 60)
    s = tau**4 * (35 - 84 * tau + 70 * tau**2 - 20 * tau**3)
    axes.plot([12, 12, 90], [90, 12, 12], color=GREY, lw=2)
    axes.plot(12 + 46 * tau, 20 + 50 * s, color=BLUE, lw=3.4, solid_capstyle="round")
    for radius, colour in ((16, ORANGE), (11, "white"), (5, ORANGE)):
        axes.add_patch(Circle((76, 70), radius, fc=colour, ec="none"))


def isolator(axes):
    """A vibration that ends."""
    t = np.linspace(0.0, 1.0, 400)
    shake = 24 * np.sin(2 * np.pi * 6.5 * t) * np.exp(-((t / 0.52) ** 6))
    axes.plot([8, 92], [50, 50], color=GREY, lw=1.5)
    axes.plot(8 + 84 * t, 50 + shake, color=BLUE, lw=2.6, solid_joinstyle="round")
    axes.plot([66, 92], [50, 50], color=ORANGE, lw=3.4, solid_capstyle="round")


def disturbance(axes):
    """Noise, and the wheel that makes some of it."""
    noise = np.random.default_rng(7).standard_normal(23)
    force = 30 + 17 * noise / np.abs(noise).max()
    axes.plot(np.linspace(9, 91, 23), force, color=BLUE, lw=2.4, solid_joinstyle="round")
    axes.add_patch(Circle((50, 72), 17, fc="white", ec=INK, lw=3))
    for angle in np.radians([20, 140, 260]):
        axes.plot([50, 50 + 15 * np.cos(angle)], [72, 72 + 15 * np.sin(angle)], color=INK, lw=2)
    axes.add_patch(Circle((50, 72), 4.5, fc=ORANGE, ec=INK, lw=1.5, zorder=3))


DRAWINGS = {
    "manipulator_plant": plant,
    "pointing_commander": commander,
    "feedforward_isolator": isolator,
    "disturbance_source": disturbance,
}


def draw(name, path):
    """One icon on its tile, as a PNG file."""
    with rc_context({"figure.dpi": PIXELS, "savefig.dpi": PIXELS}):
        figure = Figure(figsize=(1.0, 1.0))
        axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
        axes.set(xlim=(0, 100), ylim=(0, 100))
        axes.axis("off")
        tile = "round,pad=0,rounding_size=12"
        axes.add_patch(FancyBboxPatch((1.5, 1.5), 97, 97, boxstyle=tile, fc=TILE, ec=GREY, lw=1.5))
        DRAWINGS[name](axes)
        figure.savefig(path, transparent=True, metadata={"Software": None})


if __name__ == "__main__":
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parents[1] / "fmus"
    for name in DRAWINGS:
        draw(name, folder / name / "icon.png")
