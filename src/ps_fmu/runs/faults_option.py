"""The option ``--faults`` of runs."""

from __future__ import annotations

import argparse
from pathlib import Path

from ..product.files import find_file


def add_faults_option(parser: argparse._ActionsContainer) -> None:
    """Add the option to a parser."""
    parser.add_argument(
        "--faults", type=Path, metavar="FILE",
        help="JSON or YAML in libcosim's grammar: signals that freeze, drop out, get noise, ... at given times",
    )  # fmt: skip


def find_faults(path: Path | None) -> Path | None:
    """The user's file, or one of ps_fmu of that name."""
    return None if path is None else find_file(path)
