"""``ps-fmu judge RESULTS.nc --requirements F.toml``: verdicts from stored rows."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from .terminal import read_output, reason


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``judge``."""
    parser.description = (
        "Judge the rows of one or more results.nc by requirements.  Several files are members of an ensemble: runs "
        "that differ in their seed.  Rows that were stored further apart than the steps of the run have a smaller "
        "bandwidth; ps-fmu run --requirements judges every step.  The exit code is 1 unless all requirements are met."
    )
    parser.add_argument("results", type=Path, nargs="+", metavar="RESULTS.nc")
    parser.add_argument(
        "--requirements", type=Path, required=True, metavar="F.toml", help="your file, or one of ps_fmu by name"
    )
    parser.add_argument("--output", type=read_output, metavar="F.json", help="also write the verdicts into this file")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Judge the files that the arguments name and print the verdicts; returns the exit code."""
    from .files.plain import write_atomically
    from .product.files import find_file
    from .requirements.requirement import RequirementError, read_requirements
    from .requirements.stored import ResultsError, judge_files
    from .requirements.verdict import format_verdicts
    from .results.summary import plain

    try:
        verdicts = judge_files(arguments.results, read_requirements(find_file(arguments.requirements)))
        print(format_verdicts(verdicts))
        if arguments.output is not None:
            content = {"verdicts": plain([verdict.as_dict() for verdict in verdicts], "verdicts")}
            write_atomically(arguments.output, json.dumps(content, indent=2, allow_nan=False) + "\n")
    except RequirementError as error:
        print(f"ps-fmu judge: --requirements: {error}", file=sys.stderr)
        return 2
    except (ResultsError, OSError) as error:
        print(f"ps-fmu judge: {reason(error)}", file=sys.stderr)
        return 1
    return 0 if all(verdict.met for verdict in verdicts) else 1
