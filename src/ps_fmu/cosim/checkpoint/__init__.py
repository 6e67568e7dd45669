"""Checkpoints: all that a run needs to go on where it was, in files that a kill at any moment leaves whole."""

from __future__ import annotations

import argparse
from pathlib import Path


def add_checkpoint_options(parser: argparse._ActionsContainer) -> None:
    """Add the options of a run that can be gone on with, or that begins where another one was, to a parser."""
    parser.add_argument(
        "--checkpoint", type=float, metavar="S",
        help="keep the state of the run each S seconds of simulation, and at its end, in the folder checkpoint of the "
        "results, but never so often that it takes more than 2 %% of the time: then the next one waits",
    )  # fmt: skip
    parser.add_argument(
        "--from", dest="source", type=Path, metavar="CHECKPOINT",
        help="begin in the state of a checkpoint, or of a run by the folder of its results",
    )  # fmt: skip
    parser.add_argument(
        "--anew", nargs="+", action="extend", default=[], metavar="NAME",
        help="with --from: FMUs that begin anew, without their state, and so with other fixed parameters",
    )  # fmt: skip
