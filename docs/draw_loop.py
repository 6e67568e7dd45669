"""Draws loop.svg: the four FMUs as boxes and the signals between them.

Usage: python docs/draw_loop.py [OUTPUT.svg|OUTPUT.png]
"""

import sys
from pathlib import Path

from matplotlib import rc_context
from matplotlib.figure import Figure
from matplotlib.patches import FancyBboxPatch

INK, FILL, WIRE, MEASURED = "#222222", "#EEF4FA", "#0072B2", "#D55E00"

# Centre and size of each box, in hundredths of the figure's width.
BOXES = {
    "PointingCommander": ((16.0, 46.0), "target orientation\nto coarse-leg lengths"),
    "DisturbanceSource": ((16.0, 23.0), "noise, wheels, sines,\nrecorded forces"),
    "ManipulatorPlant": ((57.0, 34.5), "bus, six legs,\npayload, line of sight"),
    "FeedforwardIsolator": ((57.0, 7.5), "eq (55): base acceleration\nto fine forces"),
}
WIDTH, HEIGHT, TALL = 24.0, 10.0, 33.0


def box(axes, name):
    """A rounded box with the name of the FMU and what it does."""
    (x, y), text = BOXES[name]
    height = TALL if name == "ManipulatorPlant" else HEIGHT
    corner = (x - WIDTH / 2, y - height / 2)
    rounded = "round,pad=0,rounding_size=1"
    shape = FancyBboxPatch(corner, WIDTH, height, boxstyle=rounded, fc=FILL, ec=INK, lw=1.6)
    axes.add_patch(shape)
    axes.text(x, y + 1.9, name, ha="center", va="center", weight="bold", size=13)
    axes.text(x, y - 1.9, text, ha="center", va="center", size=11)


def wire(axes, points, text, place, colour=WIRE, align="center"):
    """A line through ``points`` with an arrow at its end, and the names of its signals at ``place``."""
    xs, ys = zip(*points, strict=True)
    axes.plot(xs[:-1], ys[:-1], color=colour, lw=2.0, solid_capstyle="butt")
    head = {"arrowstyle": "-|>", "color": colour, "lw": 2.0, "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", points[-1], points[-2], arrowprops=head)
    axes.text(*place, text, ha=align, va="bottom", size=10.5, color=colour, linespacing=1.3)


def draw(path):
    """Write the drawing to ``path``; the suffix gives the format."""
    with rc_context({"svg.hashsalt": "loop", "svg.fonttype": "path", "font.family": "DejaVu Sans"}):
        figure = Figure(figsize=(12.0, 6.6), dpi=100)
        axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
        axes.set_xlim(0.0, 100.0)
        axes.set_ylim(0.0, 55.0)
        axes.axis("off")
        for name in BOXES:
            box(axes, name)
        left, right = 16.0 + WIDTH / 2, 57.0 - WIDTH / 2
        middle = (left + right) / 2
        wire(axes, [(left, 46.0), (right, 46.0)], "coarse_command_1..3", (middle, 46.6))
        wire(axes, [(left, 23.0), (right, 23.0)], "base_force.x/y/z\nbase_torque.x/y/z", (middle, 23.6))
        plant = 57.0 + WIDTH / 2
        wire(
            axes,
            [(plant, 24.0), (92.0, 24.0), (92.0, 7.5), (plant, 7.5)],
            "base_acceleration.x/y/z\nbase_angular_acceleration.x/y/z\norientation.roll/pitch/yaw",
            (plant + 1.0, 24.6),
            MEASURED,
            "left",
        )
        wire(
            axes,
            [(right, 7.5), (35.5, 7.5), (35.5, 20.0), (right, 20.0)],
            "fine_force_1..3",
            (34.5, 12.0),
            align="right",
        )
        wire(
            axes,
            [(plant, 44.0), (96.0, 44.0)],
            "payload_rotation.x/y/z\nlos.x, los.y",
            (plant + 1.0, 44.6),
            INK,
            "left",
        )
        wire(axes, [(16.0, 54.0), (16.0, 51.0)], "target.roll/pitch/yaw", (17.0, 52.0), INK, "left")
        wire(axes, [(57.0, 0.2), (57.0, 2.5)], "enabled", (58.0, 0.0), INK, "left")
        figure.savefig(path, metadata={"Date": None} if path.suffix == ".svg" else None)


if __name__ == "__main__":
    draw(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).with_name("loop.svg"))
