"""What a study costs: its start, cases per second with one and two workers and from a checkpoint, and all memory.

Each is a whole command, ``ps-fmu sweep``, with the start of Python, dask and FMUs; the studies take turns.  Whether
memory is flat show 10,000 short cases: ``--cases 10000 --duration 0.2 --settling 0.2 --studies "two workers"``.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path
from statistics import median
from time import perf_counter, sleep

import pyarrow.parquet as pq
from rounds import FMUS, SSD, STEP, Figures, run_benchmark, take_turns

from ps_fmu.cosim import Master, read_system
from ps_fmu.cosim.checkpoint.checkpoints import Checkpoints

STUDY = """
[study]
name = "benchmark"
duration = "{duration!r} s"
plan = "latin-hypercube"
cases = {cases}
seed = 1

[[vary]]
parameter = "payload.mass"
only = ["isolator"]
distribution = "normal"
relative = "2 %"
"""
SOURCE = '[from]\ncheckpoint = "settled"\nanew = ["isolator"]\n'
ONE, TWO, BRANCH, SETTLING = "one worker", "two workers", "from a checkpoint", "with settling"
STUDIES = {ONE: 1, TWO: 2, BRANCH: 1, SETTLING: 1}
"""Study -> workers."""
SAMPLE_S = 0.2
Note = Callable[[str, float], None]
Sample = tuple[int, float]


def run_study(kind: str, options: argparse.Namespace, folder: Path, note: Note) -> float:
    """Run a study of the default system, and note figures of it; returns seconds a case.

    The same study with a case for each worker, before, is what it costs to start and to conclude: that is not in the
    seconds a case.  Memory is that of the time in which all processes are there.

    Raises RuntimeError where the command fails, ValueError where a case does.
    """
    start_s, _, _ = sweep(kind, STUDIES[kind], options, folder)
    wall_s, case_s, samples = sweep(kind, options.cases, options, folder)
    most = max(processes for processes, _ in samples)
    memory = [size for processes, size in samples if processes == most]
    note("start_s", start_s)
    note("case_s", case_s)
    note("MB, first half", max(memory[: len(memory) // 2 + 1]))
    note("MB, second half", max(memory[len(memory) // 2 :]))
    return (wall_s - start_s) / (options.cases - STUDIES[kind])


def sweep(kind: str, cases: int, options: argparse.Namespace, folder: Path) -> tuple[float, float, list[Sample]]:
    """Run a study of so many cases: seconds in all, of a case in its process, and what memory was seen."""
    duration = options.duration + (options.settling if kind == SETTLING else 0.0)
    text = STUDY.format(cases=cases, duration=duration) + (SOURCE if kind == BRANCH else "")
    (folder / "study.toml").write_text(text, encoding="utf-8")
    with tempfile.TemporaryDirectory(dir=folder) as output:
        out = Path(output, "out")
        command = [sys.executable, "-I", "-m", "ps_fmu.cli", "sweep", str(folder / "study.toml"), "--output", str(out)]
        command += ["--workers", str(STUDIES[kind])]
        began = perf_counter()
        said = folder / "said.txt"
        with said.open("w", encoding="utf-8") as file:
            process = subprocess.Popen(command, stdout=file, stderr=file)
        samples = []
        while process.poll() is None:
            samples.append(sum_memory(process.pid))
            sleep(SAMPLE_S)
        wall_s = perf_counter() - began
        if process.returncode:
            raise RuntimeError(f"the study ended with {process.returncode}:\n{said.read_text(encoding='utf-8')}")
        rows = pq.read_table(out / "study.parquet")
        statuses = json.loads((out / "summary.json").read_text(encoding="utf-8"))["statuses"]
    if statuses != {"done": cases}:
        raise ValueError(f"not all cases are done: {statuses}")
    return wall_s, median(rows["wall_s"].to_pylist()), samples


def sum_memory(pid: int) -> Sample:
    """A process and its descendants: how many there are, and their resident memory, MB."""
    import psutil

    try:
        command = psutil.Process(pid)
        sizes = [one.memory_info().rss / 1e6 for one in (command, *command.children(recursive=True))]
        return len(sizes), sum(sizes)
    except psutil.Error:  # one has just ended
        return 0, 0.0


def leave_checkpoint(folder: Path, settling: float) -> None:
    """Run the default system, and keep its state at the end."""
    with Master(read_system(SSD, FMUS), STEP) as master:
        master.initialise()
        master.run(settling, checkpoints=Checkpoints(folder, settling))


def measure(options: argparse.Namespace, folder: Path) -> Figures:
    """Study -> medians over the rounds: cases per second with all, seconds of a case in its process, memory."""
    leave_checkpoint(folder / "settled", options.settling)
    noted: dict[str, dict[str, list[float]]] = {kind: {} for kind in options.studies}

    def run(kind: str) -> float:
        return run_study(kind, options, folder, lambda name, value: noted[kind].setdefault(name, []).append(value))

    costs = take_turns({kind: partial(run, kind) for kind in options.studies}, options.rounds)
    return {
        kind: {"cases/s": 1.0 / median(costs[kind]), **{name: median(values) for name, values in noted[kind].items()}}
        for kind in options.studies
    }


def report(found: Figures) -> str:
    """The figures as text."""
    lines = [f"{'':20}" + "".join(f"{name:>18}" for name in next(iter(found.values())))]
    lines += [f"{kind:20}" + "".join(f"{value:18.3f}" for value in row.values()) for kind, row in found.items()]
    if {ONE, TWO} <= found.keys():
        lines.append(f"efficiency of two workers: {found[TWO]['cases/s'] / (2.0 * found[ONE]['cases/s']):.2f}")
    if {ONE, BRANCH, SETTLING} <= found.keys():
        cost = found[BRANCH]["case_s"]
        ratios = cost / found[ONE]["case_s"], cost / found[SETTLING]["case_s"]
        lines.append("a case from a checkpoint over a cold one {:.2f}, over one that settles {:.2f}".format(*ratios))
    return "\n".join(lines)


def add(p: argparse.ArgumentParser) -> None:
    """Add own options."""
    p.add_argument("--cases", type=int, default=100, metavar="N", help="of a study (%(default)s)")
    p.add_argument("--duration", type=float, default=1.0, metavar="S", help="of a case (%(default)s)")
    p.add_argument("--settling", type=float, default=10.0, metavar="S", help="time of the checkpoint (%(default)s)")
    p.add_argument("--studies", nargs="+", choices=STUDIES, default=list(STUDIES), metavar="NAME")


if __name__ == "__main__":
    sys.exit(run_benchmark(__doc__, measure, report, rounds=1, add=add))
