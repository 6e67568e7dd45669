"""Cases per second of a study with one and two workers, and the memory of its processes.

Run by hand: ``.venv/bin/python benchmarks/study.py --cases 100``.  Times are those of the whole command, with the start
of Python, dask and FMUs; the studies with one and with two workers take turns.  Whether memory is flat show 10,000
short cases: ``--cases 10000 --duration 0.2 --workers 2``.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path
from statistics import median
from typing import Any

STUDY = """
[study]
name = "benchmark"
duration = "{duration} s"
plan = "latin-hypercube"
cases = {cases}
seed = 1

[[vary]]
parameter = "payload.mass"
only = ["plant"]
distribution = "normal"
relative = "2 %"

[[vary]]
name = "leg stiffness"
parameter = ["fine_leg_1.stiffness", "fine_leg_2.stiffness", "fine_leg_3.stiffness"]
only = ["plant"]
distribution = "uniform"
relative = "10 %"
"""
SAMPLE_S = 0.5


@dataclass
class Watched:
    """What the processes for the cases had, sample by sample."""

    memory: dict[int, list[int]] = field(default_factory=dict)
    """Resident bytes by process."""
    mappings: dict[int, list[int]] = field(default_factory=dict)
    files: dict[int, list[int]] = field(default_factory=dict)
    processor_s: dict[int, float] = field(default_factory=dict)
    """Processor time so far by process, s: what a loaded machine does not change much."""
    roles: list[dict[str, float]] = field(default_factory=list)
    """Largest resident memory, MB, of the command, of a worker and of a process for the cases, sample by sample."""

    def look(self, pid: int) -> None:
        """Take a sample of the descendants of a process."""
        import psutil

        try:
            command = psutil.Process(pid)
            seen = {"command": command.memory_info().rss / 1e6}
            for one in command.children(recursive=True):
                words = one.cmdline()
                role = "cases" if "ps_fmu.studies.child" in words else "worker"
                if role == "cases" or any("spawn_main" in word for word in words):
                    seen[role] = max(seen.get(role, 0.0), one.memory_info().rss / 1e6)
                if role == "cases":
                    self.memory.setdefault(one.pid, []).append(one.memory_info().rss)
                    self.mappings.setdefault(one.pid, []).append(len(one.memory_maps(grouped=False)))
                    self.files.setdefault(one.pid, []).append(one.num_fds())
                    used = one.cpu_times()
                    self.processor_s[one.pid] = used.user + used.system
            self.roles.append(seen)
        except psutil.Error:  # one has just ended
            pass

    def describe_roles(self) -> str:
        """Memory of each kind of process at ten points of the study, MB."""
        chosen = [self.roles[(2 * k + 1) * len(self.roles) // 20] for k in range(10)] if self.roles else []
        names = dict.fromkeys(name for seen in chosen for name in seen)
        return "\n".join(
            f"  {name:8} {' '.join(f'{seen.get(name, 0.0):6.1f}' for seen in chosen)} MB" for name in names
        )

    def describe(self) -> str:
        """First and last of the longest-lived process, after its first tenth, and the largest of all."""
        if not self.memory:
            return "no process was seen"
        pid = max(self.memory, key=lambda one: len(self.memory[one]))
        skip = len(self.memory[pid]) // 10
        parts = [f"{len(self.memory)} processes"]
        kinds = ("memory (MB)", self.memory, 1e6), ("mappings", self.mappings, 1.0), ("files", self.files, 1.0)
        for name, samples, unit in kinds:
            own = samples[pid][skip:]
            largest = max(max(values) for values in samples.values())
            parts.append(f"{name} {own[0] / unit:.0f} -> {own[-1] / unit:.0f}, largest {largest / unit:.0f}")
        return "; ".join(parts)


@dataclass(frozen=True)
class Measured:
    """A study that was run."""

    workers: int
    wall_s: float
    cases: int
    case_s: float
    """Median time of a case in its process, s."""
    watched: Watched


def run_study(cases: int, duration: float, workers: int) -> Measured:
    """Run a study of the default system.  Raises CalledProcessError."""
    with tempfile.TemporaryDirectory(prefix="study_") as name:
        folder = Path(name)
        (folder / "study.toml").write_text(STUDY.format(cases=cases, duration=duration), encoding="utf-8")
        command = [sys.executable, "-I", "-m", "ps_fmu.cli", "sweep", str(folder / "study.toml"), "--output",
                   str(folder / "out"), "--workers", str(workers)]  # fmt: skip
        watched = Watched()
        began = time.perf_counter()
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        while process.poll() is None:
            watched.look(process.pid)
            time.sleep(SAMPLE_S)
        wall = time.perf_counter() - began
        if process.returncode:
            raise subprocess.CalledProcessError(process.returncode, command)
        return Measured(workers, wall, cases, _read_case_time(folder / "out"), watched)


def _read_case_time(folder: Path) -> float:
    import pyarrow.parquet as pq

    summary: dict[str, Any] = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
    table = pq.read_table(folder / "study.parquet")
    if summary["statuses"] != {"done": table.num_rows}:
        raise ValueError(f"not all cases are done: {summary['statuses']}")
    return median(table["wall_s"].to_pylist())


def main() -> None:
    """Print what was measured."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=100)
    parser.add_argument("--duration", type=float, default=10.0, help="simulated seconds of a case")
    parser.add_argument("--rounds", type=int, default=1)
    parser.add_argument("--workers", type=int, nargs="+", default=[1, 2])
    options = parser.parse_args()
    found: dict[int, list[float]] = {}
    for _ in range(options.rounds):
        for workers in options.workers:
            one = run_study(options.cases, options.duration, workers)
            found.setdefault(workers, []).append(one.cases / one.wall_s)
            print(
                f"{workers} workers: {one.cases} cases of {options.duration:g} s in {one.wall_s:.1f} s, "
                f"{one.cases / one.wall_s:.2f} a second; a case takes {one.case_s:.2f} s, "
                f"{sum(one.watched.processor_s.values()) / one.cases:.2f} s of a processor; {one.watched.describe()}",
                flush=True,
            )
            print(one.watched.describe_roles(), flush=True)
    if {1, 2} <= found.keys():
        print(f"efficiency of two workers: {median(found[2]) / (2.0 * median(found[1])):.2f}")


if __name__ == "__main__":
    main()
