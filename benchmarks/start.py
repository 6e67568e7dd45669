"""What a start costs, and what starts leave behind: four FMUs cold, new Masters and resets in a process that has them.

Commands are timed by the clock, the least of the rounds.  Costs of starts are processor times up to and with the first
step, medians of processes.  Then one process resets a Master with
other parameters again and again, and makes new Masters.  Each kind begins with a tenth of its starts, in which caches
and pools of memory fill; memory, mappings, descriptors and temporary files, counted after each tenth of the others,
have to be flat.  Exit code 1 if anything grows.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path
from time import process_time
from typing import Any

from rounds import FMUS, ROOT, SSD, STEP, Figures, Limit, run_benchmark, time

from ps_fmu.cosim import Master, read_system

WARM = 20  # starts of each kind in a process
TENTHS = 10
MOST = {"memory (kB)": 3000, "mappings": 20, "descriptors": 0, "files": 0}
"""Largest growth over all starts of a kind.  Half a Master: one that unpacks and loads anew leaves 6200 kB."""


def _grown(what: str, name: str, found: Figures) -> float | None:
    counts = found["growth"].get(what)
    return counts[name][-1] - counts[name][0] if counts else None


def _find_time(name: str, found: Figures) -> float | None:
    return dict(found["commands_s"]).get(name)


COMMANDS = {
    "isolation, 1 s, without figures": ("-m", "ps_fmu.cli", "run", "isolation", "--duration", "1", "--no-figures"),
    "make run: isolation, 20 s": ("system/run.py",),
}
LIMITS = (
    *(
        Limit(f"{what}: growth of {name}", partial(_grown, what, name), most)
        for what in ("resets", "new Masters")
        for name, most in MOST.items()
    ),
    *(Limit(f"{name}, s", partial(_find_time, name), most) for name, most in zip(COMMANDS, (1.0, 2.5), strict=True)),
)


def vary(number: int) -> dict[str, float | int]:
    """Start values that no other start has."""
    return {"plant.payload.mass": 40.0 + 0.001 * number, "disturbance.seed": number}


def renew(number: int) -> float:
    """Processor time (s) of a new Master."""
    begun = process_time()
    with Master(read_system(SSD, FMUS).with_parameters(vary(number)), STEP) as master:
        master.initialise()
        master.run(STEP)
        return process_time() - begun


def reset(master: Any, number: int) -> float:
    """Processor time (s) of a reset with other parameters."""
    begun = process_time()
    master.reset(vary(number))
    master.initialise()
    master.run(STEP)
    return process_time() - begun


def time_starts() -> dict[str, float]:
    """Processor time (s) of starts in this process, which has loaded no FMU yet."""
    found = {"cold": renew(0)}
    found["new Master"] = statistics.median(renew(number) for number in range(1, WARM))
    with Master(read_system(SSD, FMUS), STEP) as master:
        found["reset"] = statistics.median([reset(master, number) for number in range(WARM)][1:])
    return found


def count_growth(resets: int, masters: int) -> dict[str, dict[str, list[int]]]:
    """What is counted before so many resets of a Master and after each tenth of them, and with so many new ones."""
    found = {}
    with Master(read_system(SSD, FMUS), STEP) as master:
        if resets:
            found["resets"] = _count_over(lambda number: reset(master, number), resets)
    if masters:
        found["new Masters"] = _count_over(lambda number: renew(number), masters)
    return found


def _count_over(repeat: Callable[[int], object], times: int) -> dict[str, list[int]]:
    for number in range(max(10, times // TENTHS)):
        repeat(number)
    counts = [_count_resources()]
    for tenth in range(TENTHS):
        for number in range(tenth * times // TENTHS, (tenth + 1) * times // TENTHS):
            repeat(number)
        counts.append(_count_resources())
    return {name: [count[name] for count in counts] for name in MOST}


def _count_resources() -> dict[str, int]:
    """Memory (kB), mappings and descriptors of this process, and its temporary files; Linux only."""
    status, maps = (Path("/proc/self", name).read_text() for name in ("status", "maps"))
    memory = next(int(line.split()[1]) for line in status.splitlines() if line.startswith("VmRSS"))
    counts = memory, maps.count("\n"), len(os.listdir("/proc/self/fd"))
    return dict(zip(MOST, (*counts, sum(len(names) for _, _, names in os.walk(tempfile.gettempdir()))), strict=True))


def _in_a_process(folder: Path, *numbers: int) -> Any:
    """What this file prints as a child: times of starts, or with numbers of starts their growth."""
    settings = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "TMPDIR": tempfile.mkdtemp(dir=folder)}
    command = [sys.executable, __file__, "--child", *map(str, numbers)]
    run = subprocess.run(command, env={**os.environ, **settings}, stdout=subprocess.PIPE, check=True, text=True)
    return json.loads(run.stdout)


def _time_command(name: str, folder: Path) -> float:
    command = [sys.executable, *COMMANDS[name], "--output", str(folder / "out")]
    return time("wall", lambda: subprocess.run(command, cwd=ROOT, capture_output=True, check=True))


def measure(options: argparse.Namespace, folder: Path) -> Figures:
    """All figures."""
    rounds = [_in_a_process(folder) for _ in range(options.rounds)]
    starts = {name: statistics.median(found[name] for found in rounds) for name in rounds[0]}
    commands = {name: min(_time_command(name, folder) for _ in range(options.rounds)) for name in options.commands}
    growth = _in_a_process(folder, options.resets, options.masters)
    return {"commands_s": commands, "starts_s": starts, "growth": growth}


def report(found: Figures) -> str:
    """The figures as text."""
    lines = [f"{name:34}{seconds:7.2f} s" for name, seconds in found["commands_s"].items()]
    lines += [f"{name:34}{1e3 * seconds:7.1f} ms" for name, seconds in found["starts_s"].items()]
    for what, kinds in found["growth"].items():
        lines += [what, *(f"  {name:12} {' '.join(map(str, counts))}" for name, counts in kinds.items())]
    return "\n".join(lines)


def add(p: argparse.ArgumentParser) -> None:
    """Add own options."""
    p.add_argument("--resets", type=int, default=1000, metavar="N", help="of one Master (%(default)s)")
    p.add_argument("--commands", nargs="*", choices=COMMANDS, default=list(COMMANDS), metavar="NAME", help="timed")
    p.add_argument("--masters", type=int, default=200, metavar="N", help="new ones (%(default)s)")


if __name__ == "__main__":
    if sys.argv[1:2] == ["--child"]:
        numbers = [int(number) for number in sys.argv[2:]]
        print(json.dumps(count_growth(*numbers) if numbers else time_starts()))
        sys.exit(0)
    sys.exit(run_benchmark(__doc__, measure, report, LIMITS, rounds=5, add=add))
