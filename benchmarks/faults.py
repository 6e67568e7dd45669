"""What faults cost a step of the published system: none, and some that leave all values as they are.

Processor time of the thread that steps, medians of interleaved runs in one process.
"""

from __future__ import annotations

import argparse
import json
import statistics
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

from ps_fmu.cosim import Master, System, read_system
from ps_fmu.cosim.faults.event import FaultFile
from ps_fmu.cosim.faults.reading import read_faults

ROOT = Path(__file__).parents[1]
STEP = 1e-4  # s
SIGNAL = {"time": 0.0, "model": "plant", "variable": "base_acceleration.x"}


def list_faults(system: System) -> dict[str, list[Mapping[str, object]]]:
    """Events by what they are called."""
    noises = [
        {
            "time": 0.0, "model": wire.source.component, "variable": wire.source.variable, "target": str(wire.target),
            "action": "noise", "rms": 0.0,
        }
        for wire in system.connections[:10]
    ]  # fmt: skip
    return {
        "bias": [{**SIGNAL, "action": "bias", "value": 0.0}],
        "delay of 100 steps": [{**SIGNAL, "action": "delay", "value": 100 * STEP}],
        "noise": [{**SIGNAL, "action": "noise", "rms": 0.0}],
        "noise on ten signals": [*noises],
    }


def measure(system: System, faults: FaultFile | None, steps: int) -> float:
    """Processor time of a step [s]."""
    with Master(system, STEP, faults=faults) as master:
        master.initialise()
        master.run(steps // 10 * STEP)  # the first blocks of noise are made
        began = time.thread_time()
        master.run(steps * STEP)
        return (time.thread_time() - began) / steps


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure and print; the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--steps", type=int, default=20_000)
    parser.add_argument("--repeats", type=int, default=5)
    options = parser.parse_args(arguments)
    system = read_system(ROOT / "system" / "SystemStructure.ssd", ROOT / "build" / "fmus")
    files: dict[str, FaultFile | None] = {"none": None}
    with tempfile.TemporaryDirectory() as folder:
        for name, events in list_faults(system).items():
            path = Path(folder, "faults.json")
            path.write_text(json.dumps({"events": events}))
            files[name] = read_faults(path)
    found: dict[str, list[float]] = {name: [] for name in files}
    for _ in range(options.repeats):
        for name, faults in files.items():
            found[name].append(measure(system, faults, options.steps))
    base = statistics.median(found["none"])
    print(f"{'faults':24}{'us a step':>12}{'ratio':>8}")
    for name, values in found.items():
        cost = statistics.median(values)
        print(f"{name:24}{cost * 1e6:12.3f}{cost / base:8.3f}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
