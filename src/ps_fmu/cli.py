"""The command ``ps-fmu``.

A subcommand is a function that takes the parsed arguments and returns an exit code.  What users can put right
is raised as one of ``EXPECTED`` and printed as one line.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

EXIT_OK = 0
EXIT_FAILED = 1  # argparse exits with 2 on arguments that it does not understand


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; the exit code."""
    options = parser().parse_args(arguments)
    code: int = options.run(options)
    return code


def parser() -> argparse.ArgumentParser:
    """The command line's grammar."""
    top = argparse.ArgumentParser(prog="ps-fmu", description="FMUs of a pointing manipulator.")
    commands = top.add_subparsers(title="commands", required=True, metavar="COMMAND")
    _add_build(commands)
    return top


def _add_build(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    build = commands.add_parser(
        "build", help="build the FMUs", description="Build the FMUs of this checkout."
    )
    build.add_argument(
        "--output", type=Path, default=Path("build/fmus"), metavar="DIR", help="default: %(default)s"
    )
    build.add_argument(
        "--only", action="append", default=[], metavar="NAME", help="folder in fmus/; may be repeated"
    )
    build.add_argument(
        "--fmus", type=Path, metavar="DIR", help="folder of the sources (default: fmus/ of the checkout)"
    )
    build.add_argument(
        "--interpreter",
        type=Path,
        metavar="PYTHON",
        help="note this Python in the FMUs, for hosts that do not run one; ties them to this machine",
    )
    build.set_defaults(run=_build)


def _build(options: argparse.Namespace) -> int:
    from .fmu.build import BuildError, build_one, default_fmus, find

    try:
        for folder in find(options.fmus or default_fmus(), options.only):
            fmu = build_one(folder, options.output, options.interpreter)
            print(f"{fmu}  {fmu.stat().st_size / 1e3:.0f} kB", flush=True)
    except (BuildError, OSError) as error:
        print(f"ps-fmu build: {error}", file=sys.stderr)
        return EXIT_FAILED
    return EXIT_OK


if __name__ == "__main__":
    sys.exit(main())
