"""What a step of the published system costs by each scheme, with faults and without.

Processor time of the thread that steps, medians of interleaved runs in one process, and ratios to ``jacobi`` without
faults.  Iterations and estimates are led by Python, and set FMUs back to their states.
"""

from __future__ import annotations

import argparse
import json
import statistics
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

from ps_fmu.cosim import Master, Scheme, System, read_system
from ps_fmu.cosim.faults.event import FaultFile
from ps_fmu.cosim.faults.reading import read_faults
from ps_fmu.cosim.schemes.scheme import Rate

ROOT = Path(__file__).parents[1]
STEP = 1e-3  # s: the noise of the disturbance source is longer than the steps of all runs
SCHEMES = (
    Scheme("jacobi"),
    Scheme("gauss-seidel"),
    Scheme("jacobi", "linear"),
    Scheme("jacobi", rates={"isolator": Rate(4)}),
    Scheme("iterated"),
    Scheme("iterated", "linear"),
    Scheme("jacobi", error_estimate=True),
)
SIGNAL = {"time": 0.0, "model": "isolator", "variable": "base_acceleration.x"}
"""An input of the loop, whose fault leaves it as it is."""


def measure(system: System, scheme: Scheme, faults: FaultFile | None, steps: int) -> float:
    """Processor time of a step [s]."""
    with Master(system, STEP, scheme, faults=faults) as master:
        master.initialise()
        master.run(max(1, steps // 10) * STEP)  # the first blocks of noise are made
        began = time.thread_time()
        master.run(steps * STEP)
        return (time.thread_time() - began) / steps


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure and print; the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--steps", type=int, default=500)
    parser.add_argument("--repeats", type=int, default=5)
    options = parser.parse_args(arguments)
    system = read_system(ROOT / "system" / "SystemStructure.ssd", ROOT / "build" / "fmus")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "faults.json")
        path.write_text(json.dumps({"events": [{**SIGNAL, "action": "bias", "value": 0.0}]}))
        files = {"": None, "with a fault": read_faults(path)}
    found: dict[tuple[str, str], list[float]] = {(str(scheme), name): [] for scheme in SCHEMES for name in files}
    for _ in range(options.repeats):
        for scheme in SCHEMES:
            for name, faults in files.items():
                found[str(scheme), name].append(measure(system, scheme, faults, options.steps))
    base = statistics.median(found[str(SCHEMES[0]), ""])
    print(f"{'scheme':24}{'':14}{'us a step':>12}{'ratio':>8}")
    for (scheme_name, name), values in found.items():
        cost = statistics.median(values)
        print(f"{scheme_name:24}{name:14}{cost * 1e6:12.3f}{cost / base:8.2f}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
