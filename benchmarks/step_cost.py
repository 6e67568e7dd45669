"""What a step of the default system costs: our FMUs, the same in C by hand, and as stock pythonfmu FMUs.

C FMUs have all noise beforehand, in a table.  Beside our whole system there is one that takes the noise from them, to
compare steps alone.  Figures are medians over the rounds.  Exit code 1 if a limit is missed.
"""

from __future__ import annotations

import argparse
import sys
from functools import partial
from pathlib import Path
from statistics import median

import numpy as np
from contenders import CoSimulation, build_c_fmus, build_stock
from rounds import FMUS, SSD, STEP, Figures, Limit, compare, run_benchmark, take_turns, time

from ps_fmu.cosim import System, read_system

STEPS = 8000  # a round; the disturbance source makes two tables in it
SAME = 1e-9
"""All must agree within this fraction of each output's largest value in the last round."""

OURS = "our FMUs, our master"
QUIET, IN_C = "our FMUs with the noise of the C FMUs", "hand-written C FMUs, dense, noise from a table"
STOCK = "pythonfmu's own accessors and library"
LIMITS = (
    Limit("us per step", lambda found: found["median_us"][OURS], 1.5),
    Limit("steps of our FMUs over C FMUs", lambda found: found["ours_to_c_fmus"], 1.0),
    Limit("stock over our FMUs", lambda found: found["ratios"][STOCK], 30.0, at_least=True),
)


def measure(options: argparse.Namespace, folder: Path) -> Figures:
    """All figures.  Raises RuntimeError if not all compute the same."""
    rounds, steps = options.rounds, options.steps
    system = read_system(SSD, FMUS)
    ours = CoSimulation(system, STEP, steps)
    in_c, quiet = build_systems(system, ours, (rounds + 1) * steps + 1, folder)
    (folder / "stock").mkdir()
    build_stock(system, folder / "stock")
    contenders = {
        OURS: ours,
        QUIET: CoSimulation(quiet, STEP, steps),
        IN_C: CoSimulation(in_c, STEP, steps),
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
        "ours_to_c_fmus": compare(costs, QUIET, IN_C),
        "rounds": rounds, "steps": steps,
    }


def build_systems(system: System, ours: CoSimulation, rows: int, folder: Path) -> tuple[System, System]:
    """A system in C for so many steps, and that of our FMUs but for the noise, which is from the table in C."""
    for name in ("C", "quiet"):
        (folder / name).mkdir()
    build_c_fmus(system, ours.initial_values, STEP, rows, folder / "C")
    for component in system.components:
        fmu = component.source.name
        source = folder / "C" / fmu if component.name == "disturbance" else component.source.resolve()
        (folder / "quiet" / fmu).symlink_to(source)
    return read_system(SSD, folder / "C"), read_system(SSD, folder / "quiet")


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
    lines.append(f"  Steps alone, the same noise: {found['ours_to_c_fmus']:.2f} of C FMUs")
    return "\n".join(lines)


if __name__ == "__main__":
    sys.exit(run_benchmark(__doc__, measure, report, LIMITS, rounds=25, steps=STEPS))
