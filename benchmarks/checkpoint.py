"""What checkpoints cost: the default scenario's run with one each 10 s of simulation, against one without.

Three runs take turns, round by round: without checkpoints; with all that fall due; and as ``--checkpoint 10`` has them,
where one waits until the last has been paid for.  Printed are medians over the rounds: of the seconds, and of the ratio
to the run without in the same round; wall time, processor time of the process, and processor time of the loop's thread.
The states of the observers, and the files, are written in the thread beside the loop.  What one checkpoint costs is the
difference of the first two runs by the number of checkpoints, with the rows in the journal since the last.

The exit code is 1 where checkpoints as ``--checkpoint 10`` has them take more than 2 % of the processor time.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from statistics import median
from time import perf_counter, process_time, thread_time

from ps_fmu.cosim import Master, Observer, Recorder, System, read_system
from ps_fmu.cosim.checkpoint.checkpoints import Checkpoints
from ps_fmu.runs.built_fmus import ensure_built
from ps_fmu.runs.cases import Bounds
from ps_fmu.runs.index_record import IndexRecord
from ps_fmu.runs.jitter_record import JitterRecord
from ps_fmu.runs.keeping import SHARE

ROOT = Path(__file__).resolve().parents[1]
STEP, STORAGE_STEP = 1e-4, 1e-3  # s
INTERVAL = 10.0  # s of simulation
CLOCKS = {"wall": perf_counter, "processor": process_time, "loop": thread_time}
WAYS = ("without", "all", "paid")
MOST = 1.02  # ratio of the processor times


def main(argv: Sequence[str] | None = None) -> int:
    """Measure and print; returns the exit code."""
    p = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    p.add_argument("--rounds", type=int, default=7, metavar="N", help="rounds (%(default)s)")
    p.add_argument("--duration", type=float, default=300.0, metavar="S", help="seconds to simulate (%(default)s)")
    p.add_argument("--output", type=Path, metavar="FILE", help="write the figures as JSON")
    arguments = p.parse_args(argv)
    folder = ROOT / "build" / "fmus"
    ensure_built(folder, ROOT)
    system = read_system(ROOT / "system" / "SystemStructure.ssd", folder)
    found = measure(system, arguments.rounds, arguments.duration)
    print(f"{'':10}{'without (s)':>12}{'all due':>10}{'one (ms)':>10}{'paid for':>10}")
    for clock in CLOCKS:
        without, every, paid = (found[clock][way] for way in WAYS)
        one = 1e3 * without["s"] * (every["ratio"] - 1.0) / every["checkpoints"]
        more = "".join(f"{100.0 * (way['ratio'] - 1.0):+8.2f} %" for way in (every, paid))
        print(f"{clock:10}{without['s']:12.4f}{more[:10]}{one:10.2f}{more[10:]}")
    taken = found["wall"]["paid"]["checkpoints"]
    print(f"of {found['wall']['all']['checkpoints']:.0f} checkpoints that fall due {taken:.0f} are paid for")
    if arguments.output is not None:
        arguments.output.write_text(json.dumps({"interval_s": INTERVAL, **found}, indent=1) + "\n")
    if found["processor"]["paid"]["ratio"] <= MOST:
        return 0
    print(f"expected at most {100.0 * (MOST - 1.0):.0f} % more processor time", file=sys.stderr)
    return 1


def measure(system: System, rounds: int, duration: float) -> dict[str, dict[str, dict[str, float]]]:
    """By clock and way: median seconds, median ratio to the run without, and median number of checkpoints."""
    ways = {"without": (False, None), "all": (True, None), "paid": (True, SHARE)}
    run(system, duration, True, None)  # files are in memory, libraries are loaded
    times: dict[str, list[dict[str, float]]] = {way: [] for way in WAYS}
    for number in range(rounds):
        for way in rotate(WAYS, number):
            times[way].append(run(system, duration, *ways[way]))
    return {
        clock: {
            way: {
                "s": median(one[clock] for one in times[way]),
                "ratio": median(a[clock] / b[clock] for a, b in zip(times[way], times["without"], strict=True)),
                "checkpoints": median(one["checkpoints"] for one in times[way]),
            }
            for way in WAYS
        }
        for clock in CLOCKS
    }


def rotate(names: tuple[str, ...], number: int) -> tuple[str, ...]:
    """The names in another order each round."""
    first = number % len(names)
    return names[first:] + names[:first]


def run(system: System, duration: float, keeps: bool, share: float | None) -> dict[str, float]:
    """Seconds of the steps of one run, with the observers of the default scenario, by clock, and its checkpoints.

    ``share`` of the time that checkpoints may take; None: all that fall due are taken.
    """
    steps = round(duration / STEP)
    with tempfile.TemporaryDirectory() as place, Master(system, STEP) as master:
        master.initialise()
        columns = master.columns
        with Recorder(Path(place, "r.nc"), "run", columns=columns, step=STEP, storage_step=STORAGE_STEP) as recorder:
            record = JitterRecord(columns, step_s=STEP, steps=steps, explored=True)
            indices = IndexRecord(columns, step_s=STEP, rows=steps + 1)
            observers: list[Observer] = [Bounds(columns), recorder, *record.observers, indices]
            taken: list[float] = []

            def note() -> dict[str, float]:
                taken.append(perf_counter())
                return {}

            kept = Path(place, "kept")
            checkpoints = Checkpoints(kept, INTERVAL, share=share, notes=note) if keeps else None
            begun = {clock: read() for clock, read in CLOCKS.items()}
            master.run(duration, observers, beside=True, checkpoints=checkpoints)
            return {clock: read() - begun[clock] for clock, read in CLOCKS.items()} | {"checkpoints": len(taken)}


if __name__ == "__main__":
    if os.environ.get("OPENBLAS_NUM_THREADS") != "1":  # numpy reads it when it is imported; threads that wait use time
        os.execve(sys.executable, [sys.executable, *sys.argv], os.environ | {"OPENBLAS_NUM_THREADS": "1"})
    sys.exit(main())
