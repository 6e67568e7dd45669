"""What a step of the default system costs: our FMUs, the same in C, as stock pythonfmu FMUs, without FMUs at all.

C FMUs have all noise beforehand, or make it during the run as one writes that by hand (noise.c).  Beside our whole
system there is one that takes the noise from the former, to compare steps alone.

All run in turn, round by round, so that whatever else the machine does meets all of them; the figures are medians over
the rounds.  Then libcosim and Ecos, and two systems in two threads.  Exit code 1 if a target is missed.
"""

from __future__ import annotations

import platform
import sys
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from statistics import mean, median
from time import perf_counter
from typing import Any

import c_host
import numpy as np
import step_times
from c_fmus import build_c_fmus
from calls import measure_each_fmu, measure_fmpy_lists
from command import FMUS, ROOT, run_in_rounds
from contenders import Contender, CoSimulation, StockFmus, Textbook
from figures import find_missed, report
from importers import IMPORTERS, in_importer
from stock import build_probes, build_stock
from threads import measure_throughput
from tqdm import tqdm

from ps_fmu.cosim import System, read_system

SSD = ROOT / "system" / "SystemStructure.ssd"
ALL_FMUS = ROOT / "system" / "LineOfSight.ssd"
STEP = 1e-4  # s
STEPS = 8000  # a round; the disturbance source makes two tables in it
MOST_OF_OTHERS = 8
"""Rounds of the importers and of the threads, if there are not fewer in all."""
STEPS_OF_THREADS = 20_000  # a round; to start them takes as long as 100 steps
SAME = 1e-9
"""All must agree within this fraction of each output's largest value in the last round."""


def main(argv: Sequence[str] | None = None) -> int:
    """Measure, print, compare with the targets; returns the exit code."""
    return run_in_rounds(argv, __doc__, 25, f"{STEP * STEPS:g} s", measure_all, report, find_missed)


def measure_all(rounds: int, folder: Path) -> dict[str, Any]:
    """The figures of :func:`measure`, of all FMUs, of single steps, and what they were measured with."""
    result = measure(read_system(SSD, FMUS), rounds, folder)
    result["all_fmus_to_four"] = compare_systems(read_system(ALL_FMUS, FMUS), read_system(SSD, FMUS), rounds)
    result["us_per_single_step"] = step_times.measure(FMUS, repeats=min(rounds, step_times.REPEATS))
    result["us_of_reference"] = step_times.measure_reference()
    return result | {"python": platform.python_version(), "numpy": np.__version__, "machine": platform.machine()}


def measure(system: System, rounds: int, folder: Path) -> dict[str, Any]:
    """All figures.  Raises RuntimeError if not all compute the same."""
    print("building the FMUs to compare with ...", file=sys.stderr)
    for name in ("stock", "C", "structured", "noisy", "quiet"):
        (folder / name).mkdir()
    models = {component.source.stem for component in system.components}
    stock, probes = build_stock(folder / "stock", models), build_probes(folder)
    ours = CoSimulation(system, STEP, STEPS)
    fewer = min(rounds, MOST_OF_OTHERS)
    longest = max((rounds + 1) * STEPS, (2 * fewer + 3) * STEPS_OF_THREADS) + 1
    build_c_fmus(system, ours.initial_values, STEP, longest, folder / "C")
    build_c_fmus(system, ours.initial_values, STEP, longest, folder / "structured", structured=True)
    build_c_fmus(system, ours.initial_values, STEP, longest, folder / "noisy", synthesis=True)
    for component in system.components:
        fmu = component.source.name
        source = folder / "C" / fmu if component.name == "disturbance" else component.source.resolve()
        (folder / "quiet" / fmu).symlink_to(source)
    in_c = read_system(SSD, folder / "C")
    contenders: dict[str, Contender] = {
        "ours": ours,
        "ours, no synthesis": CoSimulation(read_system(SSD, folder / "quiet"), STEP, STEPS),
        "C FMUs": CoSimulation(in_c, STEP, STEPS),
        "C FMUs, structured": CoSimulation(read_system(SSD, folder / "structured"), STEP, STEPS),
        "C FMUs, synthesis": CoSimulation(read_system(SSD, folder / "noisy"), STEP, STEPS),
        "ours, loop in Python": CoSimulation(system, STEP, STEPS, compiled=False),
        "stock": StockFmus(system, stock, ours.columns, STEP, STEPS),
        "textbook": Textbook(ours.columns, ours.initial, STEP, STEPS, rounds + 1),
    }
    costs = take_turns(contenders, rounds)
    for name, contender in contenders.items():
        expect_same(name, dict(zip(ours.names, contender.rows.T, strict=True)), ours)
        contender.close()
    costs |= in_importers(system, fewer, folder)
    middle = {name: median(values) for name, values in costs.items()}
    threads = measure_throughput(system, in_c, STEP, STEPS_OF_THREADS, fewer)
    return {
        "us_per_step": middle["ours"],
        "ratios": {name: value / middle["ours"] for name, value in middle.items()},
        "ours_to_c_fmus": middle["ours, no synthesis"] / middle["C FMUs"],
        "ours_to_structured_c_fmus": middle["ours, no synthesis"] / middle["C FMUs, structured"],
        "mean_to_c_fmus": mean(costs["ours"]) / mean(costs["C FMUs, synthesis"]),
        "mean_to_c_fmus_with_table": mean(costs["ours"]) / mean(costs["C FMUs"]),
        "two_threads": {**asdict(threads), "is_judged": threads.is_judged},
        "real_time_factor": STEP * 1e6 / middle["ours"],
        "median_us": middle,
        "min_us": {name: min(values) for name, values in costs.items()},
        "mean_us": {name: mean(values) for name, values in costs.items()},
        "rounds": rounds,
        "steps_per_round": STEPS,
        "us_per_call": measure_each_fmu(system, STEP),
        "us_per_call_in_c_host": c_host.measure(
            system.component("plant").source.parent, min(2 * rounds, c_host.ROUNDS)
        ),
        "us_per_fmpy_call_of_30_reals": dict(zip(("stock", "ours"), map(measure_fmpy_lists, probes), strict=True)),
    }


def compare_systems(system: System, other: System, rounds: int) -> float:
    """Cost of a step of a system over that of another one: the median of rounds, in which one follows the other."""
    pair: dict[str, Contender] = {"one": CoSimulation(system, STEP, STEPS), "other": CoSimulation(other, STEP, STEPS)}
    costs = take_turns(pair, rounds)
    for contender in pair.values():
        contender.close()
    return median(one / other for one, other in zip(costs["one"], costs["other"], strict=True))


def take_turns(contenders: Mapping[str, Contender], rounds: int) -> dict[str, list[float]]:
    """Contender -> us per step in each round; each round begins with the next one, so that none is always the first."""
    costs: dict[str, list[float]] = {name: [] for name in contenders}
    order = deque(contenders)
    for _ in tqdm(range(rounds), unit="round", mininterval=1.0):
        order.rotate(-1)
        for name in order:
            begin = perf_counter()
            contenders[name].run()
            costs[name].append((perf_counter() - begin) / STEPS * 1e6)
    return costs


def in_importers(system: System, rounds: int, folder: Path) -> dict[str, list[float]]:
    """Importer -> us per step in each round; one more before them is left out: the FMUs are initialised in it."""
    ours = CoSimulation(system, STEP, (1 + rounds) * STEPS)
    ours.close()
    costs = {}
    for importer in IMPORTERS:
        times, values = in_importer(importer, system, STEP, STEPS, 1 + rounds, folder)
        costs[importer] = times[1:]
        expect_same(importer, {name: np.array([value]) for name, value in values.items()}, ours)
    return costs


def expect_same(who: str, outputs: Mapping[str, Any], ours: CoSimulation) -> None:
    """Compare the last rows of outputs, by name, with ours; raises RuntimeError."""
    for name, values in outputs.items():
        expected = ours.rows[-len(values) :, ours.names.index(name)]
        off = np.abs(values - expected).max() / (np.abs(ours.rows[:, ours.names.index(name)]).max() or 1.0)
        if not off <= SAME:
            raise RuntimeError(f"{who}: {name} is off by {off:.1e} of its largest value: not the same system")


if __name__ == "__main__":
    sys.exit(main())
