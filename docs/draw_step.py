"""Draws step.svg: who makes a step, and what launcher and slave share.

Usage: python docs/draw_step.py [OUTPUT.svg|OUTPUT.png]
"""

import sys
from pathlib import Path

from matplotlib import rc_context
from matplotlib.figure import Figure
from matplotlib.patches import FancyBboxPatch

INK, FILL, SHARED, NATIVE, PYTHON = "#222222", "#EEF4FA", "#F3F3EC", "#0072B2", "#D55E00"

# Corner, width and height of each box in hundredths of the figure's width; colour; title and text.
BOXES = {
    "Host": ((2.0, 23.0, 15.0, 17.0), FILL, "fmi2SetReal\nfmi2DoStep\nfmi2GetReal"),
    "Launcher": (
        (33.0, 23.0, 25.0, 17.0),
        FILL,
        "takes and gives values,\nmakes plain steps:\n[y; x] = M [x; u; a]\nor the next row; limits",
    ),
    "Slave, in Python": (
        (76.0, 23.0, 22.0, 17.0),
        FILL,
        "event()   step_map(h)\nrows()\nchecks and messages",
    ),
    "Words of the instance": (
        (33.0, 2.0, 65.0, 11.0),
        SHARED,
        "buffer [y | x | u | a | events | parameters | memory]     M     table     limits\n"
        "expected time and step size     steps so far     is an event due?",
    ),
}


def box(axes, title):
    """A rounded box with its title and its text."""
    (x, y, width, height), colour, text = BOXES[title]
    shape = FancyBboxPatch((x, y), width, height, boxstyle="round,pad=0,rounding_size=1", fc=colour, ec=INK, lw=1.6)
    axes.add_patch(shape)
    axes.text(x + width / 2, y + height - 1.3, title, ha="center", va="top", weight="bold", size=13)
    axes.text(x + width / 2, y + (height - 3.4) / 2, text, ha="center", va="center", size=11, linespacing=1.4)


def arrow(axes, start, end, colour, style="-|>"):
    """A straight arrow."""
    line = {"arrowstyle": style, "color": colour, "lw": 2.0, "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", end, start, arrowprops=line)


def draw(path):
    """Write the drawing to ``path``; the suffix gives the format."""
    with rc_context({"svg.hashsalt": "step", "svg.fonttype": "path", "font.family": "DejaVu Sans"}):
        figure = Figure(figsize=(12.0, 5.04), dpi=100)
        axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
        axes.set_xlim(0.0, 100.0)
        axes.set_ylim(0.0, 42.0)
        axes.axis("off")
        for title in BOXES:
            box(axes, title)
        arrow(axes, (17.0, 32.0), (33.0, 32.0), NATIVE)
        axes.text(25.0, 32.6, "each call", ha="center", va="bottom", size=11, color=NATIVE)
        arrow(axes, (58.0, 32.0), (76.0, 32.0), PYTHON)
        axes.text(67.0, 32.6, "all else:", ha="center", va="bottom", size=11, color=PYTHON)
        reasons = "first step, event,\nanother step size,\nend of a table,\nwhatever is refused"
        axes.text(67.0, 31.3, reasons, ha="center", va="top", size=11, color=PYTHON, linespacing=1.3)
        arrow(axes, (45.5, 23.0), (45.5, 13.0), NATIVE, "<|-|>")
        axes.text(46.5, 18.0, "0.1 to 0.2 us a step,\nwithout Python's lock", va="center", size=11, color=NATIVE)
        arrow(axes, (87.0, 23.0), (87.0, 13.0), PYTHON, "<|-|>")
        figure.savefig(path, metadata={"Date": None} if path.suffix == ".svg" else None)


if __name__ == "__main__":
    draw(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).with_name("step.svg"))
