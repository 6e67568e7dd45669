"""What starts leave behind: memory, mappings, descriptors and temporary files over thousands of them in one process.

First a Master is reset with other parameters again and again, then new Masters are made.  Each kind begins with a tenth
of its starts, in which caches and pools of memory fill; what is counted after each tenth of the others has to be flat.
Exit code 1 if anything grows.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

from start import HERE, STEP, time_reset, vary

from ps_fmu.cosim import Master, read_system

TENTHS = 10
MOST = {"memory (kB)": 3000, "mappings": 20, "descriptors": 0, "files": 0}
"""Largest growth over all starts of a kind.  Half a Master: one that unpacks and loads anew leaves 6200 kB."""
Counts = dict[str, list[int]]


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


def measure(checkout: Path, resets: int, masters: int) -> dict[str, Counts]:
    """What is counted before so many resets of a Master and after each tenth of them, and with so many new ones."""
    system = read_system(checkout / "system" / "SystemStructure.ssd", checkout / "build" / "fmus")

    def renew(number: int) -> None:
        with Master(system.with_parameters(vary(number)), STEP) as master:
            master.initialise()
            master.run(STEP)

    found = {}
    with Master(system, STEP) as master:
        if resets and hasattr(master, "reset"):
            found["resets"] = _count_over(lambda number: time_reset(master, number), resets)
    if masters:
        found["new Masters"] = _count_over(renew, masters)
    return found


def _count_over(repeat: Callable[[int], object], times: int) -> Counts:
    for number in range(max(10, times // TENTHS)):
        repeat(number)
    counts = [count_resources()]
    for tenth in range(TENTHS):
        for number in range(tenth * times // TENTHS, (tenth + 1) * times // TENTHS):
            repeat(number)
        counts.append(count_resources())
    return {name: [count[name] for count in counts] for name in MOST}


def find_growing(found: dict[str, Counts]) -> list[str]:
    """What is not flat, in words."""
    return [
        f"MISSED: {what}: {name} from {counts[0]} to {counts[-1]}; at most {MOST[name]} more wanted"
        for what, kinds in found.items()
        for name, counts in kinds.items()
        if counts[-1] - counts[0] > MOST[name]
    ]


def main(argv: Sequence[str] | None = None) -> int:
    """Measure and print; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("resets", type=int, nargs="?", default=2000, help="of one Master (%(default)s)")
    parser.add_argument("masters", type=int, nargs="?", default=300, help="new ones (%(default)s)")
    parser.add_argument("--checkout", type=Path, default=HERE, metavar="DIR", help="with its FMUs in build/fmus")
    parser.add_argument("--json", action="store_true", help="print the counts as JSON")
    arguments = parser.parse_args(argv)
    with tempfile.TemporaryDirectory(prefix="ps_fmu_bench_") as folder:
        tempfile.tempdir = folder  # counted alone
        found = measure(arguments.checkout.resolve(), arguments.resets, arguments.masters)
        tempfile.tempdir = None
    if arguments.json:
        print(json.dumps(found))
    else:
        for what, kinds in found.items():
            print(what, *(f"  {name:12} {' '.join(map(str, counts))}" for name, counts in kinds.items()), sep="\n")
    texts = find_growing(found)
    print(*texts, sep="\n", end="\n" if texts else "", file=sys.stderr)
    return 1 if texts else 0


if __name__ == "__main__":
    sys.exit(main())
