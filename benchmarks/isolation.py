"""What isolation costs: a step of two FMUs in C in processes of their own, and the same inside of the master's process.

``python benchmarks/isolation.py`` runs both in turn, round by round, so that whatever else the machine does meets both.
The FMUs do nothing but pass numbers on, so a step is the exchange alone.  Times are those of the wall, since the
processes wait for one another.  Figures are medians over the rounds.  Exit code 1 if the target is missed.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from contextlib import ExitStack
from pathlib import Path
from statistics import median
from time import perf_counter

from many_fmus import build_fmu, write_system

from ps_fmu.cosim import Master, read_system
from ps_fmu.cosim.isolation.instance import Isolation

FMUS, PORTS = 2, 16
STEP = 1e-3  # s
MOST_US = 15.0
"""Of isolation, in a step of two FMUs [us]."""


def measure(rounds: int, steps: int) -> dict[str, list[float]]:
    """Wall time of a step [us] in each round, by where the FMUs are."""
    kinds = {"inside": None, "isolated": Isolation()}
    with tempfile.TemporaryDirectory() as name, ExitStack() as stack:
        build_fmu(Path(name), PORTS)
        system = read_system(write_system(Path(name), PORTS, FMUS))
        masters = {
            kind: stack.enter_context(Master(system, STEP, isolation=isolation)) for kind, isolation in kinds.items()
        }
        for master in masters.values():
            master.initialise()
            master.run(100 * STEP)
        found: dict[str, list[float]] = {kind: [] for kind in masters}
        for _ in range(rounds):
            for kind, master in masters.items():
                begin = perf_counter()
                master.run(steps * STEP)
                found[kind].append(1e6 * (perf_counter() - begin) / steps)
        return found


def find_missed(found: dict[str, list[float]]) -> list[str]:
    """Targets that are missed."""
    cost = median(found["isolated"]) - median(found["inside"])
    return [f"isolation: {cost:.1f} us a step, {MOST_US:g} are the target"] if cost > MOST_US else []


def main() -> int:
    """Print the table; returns the exit code."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--rounds", type=int, default=25, metavar="N", help="(%(default)s)")
    parser.add_argument("--steps", type=int, default=2000, metavar="N", help="of a round (%(default)s)")
    arguments = parser.parse_args()
    found = measure(arguments.rounds, arguments.steps)
    print("FMUs       median [us a step]  least  greatest")
    for kind, costs in found.items():
        print(f"{kind:10} {median(costs):18.2f} {min(costs):6.2f} {max(costs):9.2f}")
    missed = find_missed(found)
    print(*missed, sep="\n", end="\n" if missed else "", file=sys.stderr)
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
