"""Draws the pictures of the documentation, as SVG, from the data of the program.

Usage: python docs/draw_pictures.py [NAME ...] [--output FOLDER]

Without a name it draws all.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE))  # the package beside this file

from pictures.mechanism import draw_host_frames, draw_mechanism  # noqa: E402
from pictures.packages import draw_packages  # noqa: E402
from pictures.quantities import draw_frequencies, draw_verdict, draw_windows  # noqa: E402
from pictures.signals import draw_instrument_flow, draw_loop  # noqa: E402
from pictures.steps import draw_step, draw_step_time, draw_workflow  # noqa: E402

PICTURES = {
    "mechanism": draw_mechanism,
    "host_frames": draw_host_frames,
    "loop": draw_loop,
    "instrument_flow": draw_instrument_flow,
    "frequencies": draw_frequencies,
    "windows": draw_windows,
    "verdict": draw_verdict,
    "workflow": draw_workflow,
    "step_time": draw_step_time,
    "step": draw_step,
    "packages": draw_packages,
}


def main() -> None:
    """Draw what the command line names."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"one of {', '.join(PICTURES)}")
    parser.add_argument("--output", type=Path, default=HERE, help="folder to write into")
    given = parser.parse_args()
    for name in given.names or PICTURES:
        (given.output / f"{name}.svg").write_text(PICTURES[name]().render(), encoding="utf-8")


if __name__ == "__main__":
    main()
