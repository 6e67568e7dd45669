"""What all benchmarks share: contenders that take turns, medians and ratios, limits, the command line, a C compiler.

Contenders run in turn, round by round, so that whatever else the machine does meets all of them.  Each round begins
with the next one, so that none is always the first.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import subprocess
import sys
import tempfile
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from statistics import median
from time import perf_counter, process_time, thread_time
from typing import Any

import fmpy
from tqdm import tqdm

from ps_fmu.runs.built_fmus import ensure_built

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent
FMUS = ROOT / "build" / "fmus"
SSD = ROOT / "system" / "SystemStructure.ssd"
ALL_FMUS = ROOT / "system" / "LineOfSight.ssd"
STEP = 1e-4  # s
RECORD = HERE / "record.json"
"""What ``make bench`` found last, by script: ../docs/developers/speed.md is made of it."""
CLOCKS = {"wall": perf_counter, "processor": process_time, "thread": thread_time}

Figures = dict[str, Any]
Costs = Mapping[str, Sequence[float]]  # contender -> cost of each round


@dataclass(frozen=True)
class Limit:
    """What a figure may be at most, or has to be ``at_least``; a figure that is not there is not judged."""

    name: str
    value: Callable[[Figures], float | None]
    limit: float
    at_least: bool = False

    def find_missed(self, found: Figures) -> str | None:
        """What is wrong, if anything is."""
        value = self.value(found)
        if value is None or (value >= self.limit if self.at_least else value <= self.limit):
            return None
        return f"MISSED: {self.name}: {value:.3g}; at {'least' if self.at_least else 'most'} {self.limit:g} wanted"


def time(clock: str, work: Callable[[], object]) -> float:
    """Seconds that some work takes, by a clock of :data:`CLOCKS`."""
    begin = CLOCKS[clock]()
    work()
    return CLOCKS[clock]() - begin


def take_turns(contenders: Mapping[str, Callable[[], float]], rounds: int) -> dict[str, list[float]]:
    """Contender -> what it returns in each round, its cost."""
    costs: dict[str, list[float]] = {name: [] for name in contenders}
    order = deque(contenders)
    for _ in tqdm(range(rounds), unit="round", mininterval=1.0):
        order.rotate(-1)
        for name in order:
            costs[name].append(contenders[name]())
    return costs


def compare(costs: Costs, name: str, base: str) -> float:
    """Median over the rounds of the cost of one contender over that of another in the same round."""
    return median(own / other for own, other in zip(costs[name], costs[base], strict=True))


def run_benchmark(
    about: str | None,
    measure: Callable[[argparse.Namespace, Path], Figures],
    report: Callable[[Figures], str],
    limits: Sequence[Limit] = (),
    *,
    rounds: int,
    steps: int | None = None,
    add: Callable[[argparse.ArgumentParser], object] = lambda parser: None,
) -> int:
    """Build the FMUs, measure, print, and write the figures where they are asked for; returns the exit code.

    ``about`` goes into the help; ``measure`` takes the options and a folder for temporary files.  ``rounds``, and
    ``steps`` of a round if they can be chosen, are defaults; ``add`` adds options.  1 is returned if a limit is missed.
    """
    p = argparse.ArgumentParser(description=about.splitlines()[0] if about else None)
    p.add_argument("--rounds", type=int, default=rounds, metavar="N", help="rounds, or repeats (%(default)s)")
    p.add_argument("--output", type=Path, metavar="FILE", help="write the figures as JSON")
    p.add_argument("--record", action="store_true", help=f"keep them in {RECORD.name}, for docs/developers/speed.md")
    if steps is not None:
        p.add_argument("--steps", type=int, default=steps, metavar="N", help="steps of a round (%(default)s)")
    add(p)
    options = p.parse_args()
    if options.rounds < 1:
        p.error(f"--rounds: expected at least 1, got {options.rounds}")
    ensure_built(FMUS, ROOT)
    with tempfile.TemporaryDirectory(prefix="ps_fmu_bench_") as folder:
        found = measure(options, Path(folder))
    print(report(found), flush=True)
    if options.output is not None:
        options.output.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    if options.record:
        kept = json.loads(RECORD.read_text(encoding="utf-8")) if RECORD.exists() else {}
        kept[Path(sys.argv[0]).stem] = {"where": describe_machine(), "found": found}
        RECORD.write_text(json.dumps(kept, indent=1) + "\n", encoding="utf-8")
    texts = [text for limit in limits if (text := limit.find_missed(found)) is not None]
    print(*texts, sep="\n", end="\n" if texts else "", file=sys.stderr)
    return 1 if texts else 0


def describe_machine() -> str:
    """When and on what the figures were measured."""
    lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    model = next((line.partition(": ")[2] for line in lines if line.startswith("model name")), platform.machine())
    others = f"load {os.getloadavg()[1]:.1f} over the last five minutes"
    return f"{datetime.now(UTC):%Y-%m-%d}, {os.cpu_count()} x {model}, Python {platform.python_version()}, {others}"


def compile_c(source: Path, output: Path, *flags: str) -> Path:
    """Compile a program, or a library with ``-shared -fPIC``, of one file for this machine; returns ``output``."""
    headers = Path(fmpy.__file__).parent / "c-code"
    command = [sys.executable, "-I", "-m", "ziglang", "cc", "-O3", "-Wall", "-I", str(headers), *flags]
    subprocess.run([*command, str(source), "-o", str(output)], check=True)
    return output
