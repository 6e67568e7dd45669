"""What checkpoints cost: the default scenario's run with one each 10 s of simulation, against one without.

Both run in turn, round by round; the figures are medians over the rounds, of the seconds and of the ratio of the two in
a round: wall time, processor time of the process, and processor time of the loop's thread.  The states of the
observers, and the files, are written in the thread beside the loop.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from statistics import median
from time import perf_counter, process_time, thread_time

from ps_fmu.cosim import Master, Observer, Recorder, System, read_system
from ps_fmu.cosim.checkpoint.checkpoints import Checkpoints
from ps_fmu.runs.built_fmus import ensure_built
from ps_fmu.runs.cases import Bounds
from ps_fmu.runs.index_record import IndexRecord
from ps_fmu.runs.jitter_record import JitterRecord

ROOT = Path(__file__).resolve().parents[1]
STEP, STORAGE_STEP = 1e-4, 1e-3  # s
INTERVAL = 10.0  # s of simulation
CLOCKS = {"wall": perf_counter, "processor": process_time, "loop": thread_time}


def main(argv: Sequence[str] | None = None) -> int:
    """Measure and print; returns the exit code."""
    p = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    p.add_argument("--rounds", type=int, default=7, metavar="N", help="rounds (%(default)s)")
    p.add_argument("--duration", type=float, default=30.0, metavar="S", help="seconds to simulate (%(default)s)")
    p.add_argument("--output", type=Path, metavar="FILE", help="write the figures as JSON")
    arguments = p.parse_args(argv)
    folder = ROOT / "build" / "fmus"
    ensure_built(folder, ROOT)
    system = read_system(ROOT / "system" / "SystemStructure.ssd", folder)
    found = measure(system, arguments.rounds, arguments.duration)
    print(f"{'':10}{'without (s)':>14}{'with (s)':>12}{'more':>9}")
    for clock, (without, with_them, ratio) in found.items():
        print(f"{clock:10}{without:14.4f}{with_them:12.4f}{100.0 * (ratio - 1.0):+8.2f} %")
    if arguments.output is not None:
        arguments.output.write_text(json.dumps({"interval_s": INTERVAL, **found}, indent=1) + "\n")
    return 0


def measure(system: System, rounds: int, duration: float) -> dict[str, tuple[float, float, float]]:
    """Median seconds of a run without and with checkpoints, and median ratio, by clock."""
    ways = [partial(run, system, duration, keeps) for keeps in (False, True)]
    ways[1]()  # files are in memory, libraries are loaded
    times: list[list[dict[str, float]]] = [[], []]
    for number in range(rounds):
        for way in (0, 1) if number % 2 == 0 else (1, 0):
            times[way].append(ways[way]())
    found = {}
    for clock in CLOCKS:
        without, with_them = ([one[clock] for one in each] for each in times)
        ratios = [b / a for a, b in zip(without, with_them, strict=True)]
        found[clock] = median(without), median(with_them), median(ratios)
    return found


def run(system: System, duration: float, keeps: bool) -> dict[str, float]:
    """Seconds of the steps of one run, with the observers of the default scenario, by clock."""
    steps = round(duration / STEP)
    with tempfile.TemporaryDirectory() as place, Master(system, STEP) as master:
        master.initialise()
        columns = master.columns
        with Recorder(Path(place, "r.nc"), "run", columns=columns, step=STEP, storage_step=STORAGE_STEP) as recorder:
            record = JitterRecord(columns, step_s=STEP, steps=steps, explored=True)
            indices = IndexRecord(columns, step_s=STEP, rows=steps + 1)
            observers: list[Observer] = [Bounds(columns), recorder, *record.observers, indices]
            checkpoints = Checkpoints(Path(place, "kept"), INTERVAL) if keeps else None
            begun = {clock: read() for clock, read in CLOCKS.items()}
            master.run(duration, observers, beside=True, checkpoints=checkpoints)
            return {clock: read() - begun[clock] for clock, read in CLOCKS.items()}


if __name__ == "__main__":
    sys.exit(main())
