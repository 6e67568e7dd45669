"""What a start costs: four FMUs cold, a new Master and a reset in a process that has them.

Times are those of the processor, so that what else the machine does is not in them.  ``growth.py`` says what starts
leave behind.
``--against DIR``: another checkout with its FMUs built, measured in turn with this one; ratios are those of medians.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parents[1]
STEP = 1e-4  # s
WARM = 20  # starts of each kind in a process


def time_starts(checkout: Path) -> dict[str, float]:
    """Processor time (s) of starts in this process, which has loaded no FMU yet: each up to and with the first step."""
    from ps_fmu.cosim import Master, read_system

    def start(number: int) -> float:
        begun = time.process_time()
        system = read_system(checkout / "system" / "SystemStructure.ssd", checkout / "build" / "fmus")
        with Master(system.with_parameters(vary(number)), STEP) as master:
            master.initialise()
            master.run(STEP)
            return time.process_time() - begun

    found = {"cold": start(0), "new Master": statistics.median(start(number) for number in range(1, WARM))}
    if hasattr(Master, "reset"):
        system = read_system(checkout / "system" / "SystemStructure.ssd", checkout / "build" / "fmus")
        with Master(system, STEP) as master:
            times = [time_reset(master, number) for number in range(WARM)]
        found["reset"] = statistics.median(times[1:])
    return found


def time_reset(master: Any, number: int) -> float:
    """Processor time (s) of a reset with other parameters, up to and with the first step."""
    begun = time.process_time()
    master.reset(vary(number))
    master.initialise()
    master.run(STEP)
    return time.process_time() - begun


def vary(number: int) -> dict[str, float | int]:
    """Start values that no other start has."""
    return {"plant.payload.mass": 40.0 + 0.001 * number, "disturbance.seed": number}


def _in_a_process(checkout: Path) -> Any:
    settings = {"PYTHONPATH": str(checkout / "src"), "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    with tempfile.TemporaryDirectory(prefix="ps_fmu_bench_") as folder:
        environment = {**os.environ, **settings, "TMPDIR": folder}
        command = [sys.executable, __file__, "--child", str(checkout)]
        run = subprocess.run(command, env=environment, stdout=subprocess.PIPE, check=True, text=True)
    return json.loads(run.stdout)


def main() -> None:
    """Measure and print."""
    if sys.argv[1:2] == ["--child"]:
        print(json.dumps(time_starts(Path(sys.argv[2]))))
        return
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--against", type=Path, metavar="DIR", help="another checkout, with its FMUs in build/fmus")
    parser.add_argument("--rounds", type=int, default=5, metavar="N", help="processes of each kind (%(default)s)")
    arguments = parser.parse_args()
    checkouts = [HERE, *([arguments.against.resolve()] if arguments.against else [])]
    rounds = [[_in_a_process(checkout) for checkout in checkouts] for _ in range(arguments.rounds)]
    own, *other = [
        {name: statistics.median(found[place][name] for found in rounds) for name in rounds[0][place]}
        for place in range(len(checkouts))
    ]
    for name, seconds in own.items():
        base = other[0].get(name, other[0]["new Master"]) if other else None
        compared = "" if base is None else f"   other checkout {1e3 * base:7.1f} ms, ratio {seconds / base:.3f}"
        print(f"{name:12}{1e3 * seconds:8.1f} ms{compared}")


if __name__ == "__main__":
    main()
