"""What outputs cost that nobody needs: steps of a system that reads all of them, some, and those of connections alone.

Masters run in turn, round by round.  Figures are medians over the rounds: us a step of the loop's processor time, and
the ratio to the master that reads all, each in the round in which both ran.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Collection, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from statistics import median
from time import thread_time

from ps_fmu.cosim import Master, System, read_system
from ps_fmu.runs.built_fmus import ensure_built
from ps_fmu.runs.jitter_record import JITTER_SIGNALS

ROOT = Path(__file__).resolve().parents[1]
SYSTEMS = ("SystemStructure.ssd", "LineOfSight.ssd")
STEP = 1e-4  # s
CHOICES: Mapping[str, Collection[str] | None] = {"all": None, "isolation": JITTER_SIGNALS, "connections": ()}


def main(argv: Sequence[str] | None = None) -> int:
    """Measure and print; returns the exit code."""
    p = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    p.add_argument("--rounds", type=int, default=9, metavar="N", help="rounds (%(default)s)")
    p.add_argument("--steps", type=int, default=5000, metavar="N", help="steps of a round (%(default)s)")
    arguments = p.parse_args(argv)
    if arguments.rounds < 1 or arguments.steps < 1:
        p.error("--rounds, --steps: expected at least 1")
    fmus = ROOT / "build" / "fmus"
    ensure_built(fmus, ROOT)
    print(f"{'system':<22}{'outputs read':<14}{'columns':>8}{'us a step':>11}{'ratio':>7}")
    for name in SYSTEMS:
        found = measure(read_system(ROOT / "system" / name, fmus), arguments.rounds, arguments.steps)
        for choice, (columns, cost, ratio) in found.items():
            print(f"{name:<22}{choice:<14}{columns:>8}{cost:>11.2f}{ratio:>7.2f}")
    return 0


def measure(system: System, rounds: int, steps: int) -> dict[str, tuple[int, float, float]]:
    """Choice -> columns, us a step, and the ratio to all."""
    with ExitStack() as stack:
        masters = {name: stack.enter_context(Master(system, STEP, only=only)) for name, only in CHOICES.items()}
        for master in masters.values():
            master.initialise()
            master.run(steps * STEP)  # first maps and tables
        costs: dict[str, list[float]] = {name: [] for name in masters}
        for _ in range(rounds):
            for name, master in masters.items():
                begin = thread_time()
                master.run(steps * STEP)
                costs[name].append((thread_time() - begin) / steps * 1e6)
        return {
            name: (
                len(master.columns), median(costs[name]),
                median(own / all_ for own, all_ in zip(costs[name], costs["all"], strict=True)),
            )
            for name, master in masters.items()
        }  # fmt: skip


if __name__ == "__main__":
    sys.exit(main())
