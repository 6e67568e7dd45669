"""What a step of the default system costs: our FMUs, and the same as stock pythonfmu FMUs.

Figures are medians over the rounds.  Exit code 1 if a limit is missed.
"""

from __future__ import annotations

import argparse
import sys
from functools import partial
from pathlib import Path
from statistics import median

import numpy as np
from contenders import CoSimulation, build_stock
from rounds import FMUS, SSD, STEP, Figures, Limit, compare, run_benchmark, take_turns, time

from ps_fmu.cosim import read_system

STEPS = 8000  # a round
SAME = 1e-9
"""All must agree within this fraction of each output's largest value in the last round."""

OURS = "our FMUs, our master"
STOCK = "pythonfmu's own accessors and library"
LIMITS = (
    Limit("us per step", lambda found: found["median_us"][OURS], 1.5),
    Limit("stock over our FMUs", lambda found: found["ratios"][STOCK], 30.0, at_least=True),
)


def measure(options: argparse.Namespace, folder: Path) -> Figures:
    """All figures.  Raises RuntimeError if not all compute the same."""
    rounds, steps = options.rounds, options.steps
    system = read_system(SSD, FMUS)
    ours = CoSimulation(system, STEP, steps)
    (folder / "stock").mkdir()
    build_stock(system, folder / "stock")
    contenders = {
        OURS: ours,
        STOCK: CoSimulation(read_system(SSD, folder / "stock"), STEP, steps),
    }
    costs = take_turns({name: partial(time, "wall", one.run) for name, one in contenders.items()}, rounds)
    costs = {name: [seconds / steps * 1e6 for seconds in values] for name, values in costs.items()}
    for name, contender in contenders.items():
        expect_same(name, contender, ours)
        contender.close()
    return {
        "median_us": {name: median(values) for name, values in costs.items()},
        "least_us": {name: min(values) for name, values in costs.items()},
        "ratios": {name: compare(costs, name, OURS) for name in costs},
        "rounds": rounds, "steps": steps,
    }


def expect_same(who: str, one: CoSimulation, ours: CoSimulation) -> None:
    """Compare the outputs of the last round with ours; raises RuntimeError."""
    largest = np.abs(ours.rows).max(axis=0)
    off = np.abs(one.rows - ours.rows).max(axis=0) / np.where(largest == 0.0, 1.0, largest)
    if not np.all(off <= SAME):
        name = ours.names[int(np.argmax(off))]
        raise RuntimeError(f"{who}: {name} is off by {off.max():.1e} of its largest value: not the same system")


def report(found: Figures) -> str:
    """The figures as text."""
    lines = [f"{'us per step of 1e-4 s, every output recorded':<62}  median   least    ours"]
    for name, middle in found["median_us"].items():
        share = f"x {found['ratios'][name]:.2f}"
        lines.append(f"  {name:<60}{middle:>8.2f}{found['least_us'][name]:>8.2f}{share:>8}")
    factor = STEP * 1e6 / found["median_us"][OURS]
    lines.append(f"  {factor:.0f} x real time; {found['rounds']} rounds of {found['steps']} steps, in turn.")
    return "\n".join(lines)


if __name__ == "__main__":
    sys.exit(run_benchmark(__doc__, measure, report, LIMITS, rounds=25, steps=STEPS))
