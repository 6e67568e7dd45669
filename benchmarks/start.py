"""What a start costs: four FMUs cold, a new Master and a reset in a process that has them; and what grows with them.

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
from collections.abc import Callable
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parents[1]
STEP = 1e-4  # s
WARM = 20  # starts of each kind in a process


def count_resources() -> dict[str, int]:
    """Memory (kB), mappings and descriptors of this process, and its temporary files; Linux only."""
    with open("/proc/self/status", encoding="ascii") as status:
        memory = next(int(line.split()[1]) for line in status if line.startswith("VmRSS"))
    with open("/proc/self/maps", encoding="utf-8") as maps:
        mappings = sum(1 for _ in maps)
    files = sum(len(names) for _, _, names in os.walk(tempfile.gettempdir()))
    return {
        "memory (kB)": memory, "mappings": mappings, "descriptors": len(os.listdir("/proc/self/fd")), "files": files,
    }  # fmt: skip


def time_starts(checkout: Path) -> dict[str, float]:
    """Wall time (s) of starts in this process, which has loaded no FMU yet: each up to and with the first step."""
    from ps_fmu.cosim import Master, read_system

    def start(number: int) -> float:
        begun = time.perf_counter()
        system = read_system(checkout / "system" / "SystemStructure.ssd", checkout / "build" / "fmus")
        with Master(system.with_parameters(vary(number)), STEP) as master:
            master.initialise()
            master.run(STEP)
            return time.perf_counter() - begun

    found = {"cold": start(0), "new Master": statistics.median(start(number) for number in range(1, WARM))}
    if hasattr(Master, "reset"):
        system = read_system(checkout / "system" / "SystemStructure.ssd", checkout / "build" / "fmus")
        with Master(system, STEP) as master:
            times = [time_reset(master, number) for number in range(WARM)]
        found["reset"] = statistics.median(times[1:])
    return found


def time_reset(master: Any, number: int) -> float:
    """Wall time (s) of a reset with other parameters, up to and with the first step."""
    begun = time.perf_counter()
    master.reset(vary(number))
    master.initialise()
    master.run(STEP)
    return time.perf_counter() - begun


def vary(number: int) -> dict[str, float | int]:
    """Start values that no other start has."""
    return {"plant.payload.mass": 40.0 + 0.001 * number, "disturbance.seed": number}


def measure_growth(checkout: Path, resets: int, masters: int) -> dict[str, dict[str, int]]:
    """What resources grow by over so many resets of a Master, and over so many new ones."""
    from ps_fmu.cosim import Master, read_system

    system = read_system(checkout / "system" / "SystemStructure.ssd", checkout / "build" / "fmus")

    def renew(number: int) -> None:
        with Master(system.with_parameters(vary(number)), STEP) as master:
            master.initialise()
            master.run(STEP)

    found = {}
    with Master(system, STEP) as master:
        if hasattr(master, "reset"):
            found["resets"] = _compare(lambda number: time_reset(master, number), resets)
    found["new Masters"] = _compare(renew, masters)
    return found


def _compare(repeat: Callable[[int], object], times: int) -> dict[str, int]:
    for number in range(max(10, times // 10)):
        repeat(number)  # caches and pools of memory fill
    before = count_resources()
    for number in range(times):
        repeat(number)
    return {name: value - before[name] for name, value in count_resources().items()}


def _in_a_process(what: str, checkout: Path, *numbers: int) -> Any:
    settings = {"PYTHONPATH": str(checkout / "src"), "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    with tempfile.TemporaryDirectory(prefix="ps_fmu_bench_") as folder:
        environment = {**os.environ, **settings, "TMPDIR": folder}
        command = [sys.executable, __file__, "--child", what, str(checkout), *map(str, numbers)]
        run = subprocess.run(command, env=environment, stdout=subprocess.PIPE, check=True, text=True)
    return json.loads(run.stdout)


def main() -> None:
    """Measure and print."""
    if sys.argv[1:2] == ["--child"]:
        what, checkout, *numbers = sys.argv[2:]
        child = time_starts if what == "starts" else measure_growth
        print(json.dumps(child(Path(checkout), *map(int, numbers))))
        return
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--against", type=Path, metavar="DIR", help="another checkout, with its FMUs in build/fmus")
    parser.add_argument("--rounds", type=int, default=5, metavar="N", help="processes of each kind (%(default)s)")
    parser.add_argument("--resets", type=int, default=2000, metavar="N", help="for the growth (%(default)s)")
    parser.add_argument("--masters", type=int, default=300, metavar="N", help="for the growth (%(default)s)")
    arguments = parser.parse_args()
    checkouts = [HERE, *([arguments.against.resolve()] if arguments.against else [])]
    rounds = [[_in_a_process("starts", checkout) for checkout in checkouts] for _ in range(arguments.rounds)]
    own, *other = [
        {name: statistics.median(found[place][name] for found in rounds) for name in rounds[0][place]}
        for place in range(len(checkouts))
    ]
    for name, seconds in own.items():
        base = other[0].get(name, other[0]["new Master"]) if other else None
        compared = "" if base is None else f"   other checkout {1e3 * base:7.1f} ms, ratio {seconds / base:.3f}"
        print(f"{name:12}{1e3 * seconds:8.1f} ms{compared}")
    for checkout in checkouts:
        growth = _in_a_process("growth", checkout, arguments.resets, arguments.masters)
        for what, grown in growth.items():
            print(f"{checkout.name}, {what}: " + ", ".join(f"{name} {value:+d}" for name, value in grown.items()))


if __name__ == "__main__":
    main()
