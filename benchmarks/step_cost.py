"""What a step of the default system costs: ours, pythonfmu's own accessors under FMPy, a textbook loop without FMUs.

All three run in turn, round by round, so that whatever else the machine does meets all of them; the figures are
medians over the rounds.  Exit code 1 if a target is missed.
"""

from __future__ import annotations

import argparse
import json
import platform
import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from statistics import median
from time import perf_counter
from typing import Any

import c_host
import numpy as np
from calls import of_each_fmu, of_fmpy_lists
from contenders import Contender, CoSimulation, StockFmus, Textbook
from stock import build_probes, build_stock
from tqdm import tqdm

from ps_fmu.cosim import System, read_system
from ps_fmu.scenarios.sources import ensure_built

ROOT = Path(__file__).resolve().parents[1]
STEP = 1e-4  # s
STEPS = 1000  # a round
OURS, STOCK, TEXTBOOK = "FMUs under our master", "stock accessors, FMPy lists", "textbook loop, no FMUs"
SAME = 1e-9
"""All three must agree within this fraction of each output's largest value in the last round."""

# Ratio of medians, or us, at most.
TARGETS = {"ours/stock": 0.25, "ours/textbook": 2.5, "us_per_step": 100.0, "us_added_by_launcher": 1.5}


def main(argv: Sequence[str] | None = None) -> int:
    """Measure, print, compare with the targets; returns the exit code."""
    p = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    p.add_argument("--rounds", type=int, default=200, metavar="N", help="rounds of 0.1 s simulated (%(default)s)")
    p.add_argument("--output", type=Path, metavar="FILE", help="write the figures as JSON")
    arguments = p.parse_args(argv)
    if arguments.rounds < 1:
        p.error(f"--rounds: expected at least 1, got {arguments.rounds}")

    fmus = ROOT / "build" / "fmus"
    ensure_built(fmus, ROOT)
    system = read_system(ROOT / "system" / "SystemStructure.ssd", fmus)
    with tempfile.TemporaryDirectory(prefix="ps_fmu_bench_") as folder:
        print("building the FMUs to compare with ...", file=sys.stderr)
        stock, probes = build_stock(Path(folder)), build_probes(Path(folder))
        times = measure(system, stock, arguments.rounds)
        fmu_calls = of_each_fmu(system, STEP)
        list_calls = dict(zip(("stock", "ours"), map(of_fmpy_lists, probes), strict=True))

    result = summary(times)
    result |= {"us_per_call": fmu_calls, "us_per_fmpy_call_of_30_reals": list_calls}
    c_calls = c_host.measure(fmus)
    result |= {"us_per_call_in_c_host": c_calls, "us_added_by_launcher": c_host.overhead(c_calls)}
    result |= {"python": platform.python_version(), "numpy": np.__version__, "machine": platform.machine()}
    print(report(result))
    if arguments.output is not None:
        arguments.output.write_text(json.dumps(result, indent=2) + "\n", encoding="utf-8")
    missed = {name: limit for name, limit in TARGETS.items() if not result[name] <= limit}
    for name, limit in missed.items():
        print(f"MISSED: {name} is {result[name]:.3g}; the target is at most {limit:g}", file=sys.stderr)
    return 1 if missed else 0


def measure(system: System, stock: Mapping[str, Path], rounds: int) -> dict[str, list[float]]:
    """Contender -> us per step in each round.  Raises RuntimeError if they do not compute the same."""
    ours = CoSimulation(system, STEP, STEPS)
    contenders: dict[str, Contender] = {
        OURS: ours,
        STOCK: StockFmus(system, stock, ours.columns, STEP, STEPS),
        TEXTBOOK: Textbook(ours.columns, ours.initial, STEP, STEPS, rounds + 1),
    }
    times: dict[str, list[float]] = {name: [] for name in contenders}
    for _ in tqdm(range(rounds), unit="round"):
        for name, contender in contenders.items():
            begin = perf_counter()
            contender.run()
            times[name].append((perf_counter() - begin) / STEPS * 1e6)
    largest = np.abs(ours.rows).max(axis=0)
    for name, contender in contenders.items():
        off = np.abs(contender.rows - ours.rows).max(axis=0) / np.where(largest > 0.0, largest, 1.0)
        if not off.max() <= SAME:
            column = ours.columns[int(off.argmax())].name
            raise RuntimeError(f"{name}: {column} is off by {off.max():.1e} of its largest value: not the same system")
        contender.close()
    return times


def summary(times: Mapping[str, list[float]]) -> dict[str, Any]:
    """The figures that the targets are about."""
    middle = {name: median(values) for name, values in times.items()}
    return {
        "us_per_step": middle[OURS],
        "ours/stock": middle[OURS] / middle[STOCK],
        "ours/textbook": middle[OURS] / middle[TEXTBOOK],
        "real_time_factor": STEP * 1e6 / middle[OURS],
        "median_us": middle,
        "min_us": {name: min(values) for name, values in times.items()},
        "rounds": len(times[OURS]),
        "steps_per_round": STEPS,
    }


def report(result: Mapping[str, Any]) -> str:
    """The figures as text."""
    lines = [f"us per macro step of {STEP:g} s, every output recorded      median      min     ours"]
    for name, middle in result["median_us"].items():
        share = f"{result['us_per_step'] / middle:.2f} x"
        lines.append(f"  {name:<48}{middle:>8.1f} {result['min_us'][name]:>8.1f} {share:>8}")
    lines.append(f"  {result['real_time_factor']:.1f} x real time; {result['rounds']} rounds of {STEPS} steps, in turn")
    lines.append("\nus per call, in the order of a step")
    for component, calls in result["us_per_call"].items():
        lines.append(f"  {component:<14}" + "  ".join(f"{name} {cost:.2f}" for name, cost in calls.items()))
    lines.append("\nus per FMPy call with lists of 30 Reals")
    for name, calls in result["us_per_fmpy_call_of_30_reals"].items():
        lines.append(f"  {name:<14}" + "  ".join(f"{call} {cost:.1f}" for call, cost in calls.items()))
    lines.append(f"\n{c_host.report(result['us_per_call_in_c_host'])}")
    return "\n".join(lines)


if __name__ == "__main__":
    sys.exit(main())
