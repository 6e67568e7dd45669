"""Draws the icons of the FMUs, ``fmus/<name>/icon.png``, as ``icon.py`` beside them says: model.png in the FMU.

Usage: python docs/draw_icons.py [FOLDER]
"""

import runpy
import sys
from pathlib import Path
from types import SimpleNamespace

from matplotlib import rc_context
from matplotlib.figure import Figure
from matplotlib.patches import FancyBboxPatch

COLOURS = SimpleNamespace(ink="#222222", tile="#F7FAFD", blue="#0072B2", orange="#D55E00", grey="#9AA5B1")
FMUS = Path(__file__).parents[1] / "fmus"
PIXELS = 128


def find_icons():
    """Names of the folders of FMUs that hold an icon.py."""
    return [path.parent.name for path in sorted(FMUS.glob("*/icon.py"))]


def draw(name, path):
    """One icon on its tile, as a PNG file."""
    drawing = runpy.run_path(str(FMUS / name / "icon.py"))["draw"]
    with rc_context({"figure.dpi": PIXELS, "savefig.dpi": PIXELS}):
        figure = Figure(figsize=(1.0, 1.0))
        axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
        axes.set(xlim=(0, 100), ylim=(0, 100))
        axes.axis("off")
        tile = "round,pad=0,rounding_size=12"
        axes.add_patch(FancyBboxPatch((1.5, 1.5), 97, 97, boxstyle=tile, fc=COLOURS.tile, ec=COLOURS.grey, lw=1.5))
        drawing(axes, COLOURS)
        figure.savefig(path, transparent=True, metadata={"Software": None})


if __name__ == "__main__":
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else FMUS
    for name in find_icons():
        draw(name, folder / name / "icon.png")
