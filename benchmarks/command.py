"""The command line of benchmarks that measure round by round: how many rounds there are, and where the figures go."""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TypeVar

from ps_fmu.runs.built_fmus import ensure_built

ROOT = Path(__file__).resolve().parents[1]
FMUS = ROOT / "build" / "fmus"

Result = TypeVar("Result", bound=Mapping[str, object])


def run_in_rounds(
    argv: Sequence[str] | None,
    about: str | None,
    rounds: int,
    simulated: str,
    measure: Callable[[int, Path], Result],
    report: Callable[[Result], str],
    find_missed: Callable[[Result], list[str]] = lambda result: [],
) -> int:
    """Build the FMUs, measure, print, and write the figures where they are asked for; returns the exit code.

    Parameters
    ----------
    argv: arguments; by default those of the process.
    about: docstring of the benchmark; its first line goes into the help.
    rounds: how many there are by default.
    simulated: how long a round is, for example ``"5 s"``.
    measure: takes the number of rounds and a folder for temporary files.
    report: the figures as text.
    find_missed: what the figures miss of the targets; 1 is returned if there is anything.
    """
    p = argparse.ArgumentParser(description=about.splitlines()[0] if about else None)
    help_ = f"rounds of {simulated} simulated (%(default)s)"
    p.add_argument("--rounds", type=int, default=rounds, metavar="N", help=help_)
    p.add_argument("--output", type=Path, metavar="FILE", help="write the figures as JSON")
    arguments = p.parse_args(argv)
    if arguments.rounds < 1:
        p.error(f"--rounds: expected at least 1, got {arguments.rounds}")
    ensure_built(FMUS, ROOT)
    with tempfile.TemporaryDirectory(prefix="ps_fmu_bench_") as folder:
        result = measure(arguments.rounds, Path(folder))
    print(report(result))
    if arguments.output is not None:
        arguments.output.write_text(json.dumps(result, indent=2) + "\n", encoding="utf-8")
    texts = find_missed(result)
    print(*texts, sep="\n", end="\n" if texts else "", file=sys.stderr)
    return 1 if texts else 0
