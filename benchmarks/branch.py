"""What a case of a study costs that begins from a checkpoint, against one that begins cold, and one that settles first.

The default system, one run a case, in one warm process as workers have it; the three take turns.  Figures are medians
over the rounds of the processor time of the thread, and of the ratios in a round.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from statistics import median
from time import thread_time

from ps_fmu.cosim import Master
from ps_fmu.cosim.checkpoint.checkpoints import Checkpoints
from ps_fmu.runs.built_fmus import ensure_built
from ps_fmu.studies.case_runner import CaseRunner
from ps_fmu.studies.sweep import Prepared, SweepOptions, prepare

ROOT = Path(__file__).resolve().parents[1]
BRANCH, COLD, SETTLING = "from a checkpoint", "cold", "cold, with settling"
STUDY = """
[study]
duration = "{duration!r} s"
plan = "list"
seed = 1
[[vary]]
parameter = "isolator.enabled"
values = [true, false]
"""
SOURCE = '[from]\ncheckpoint = "settled"\n'


def main(argv: Sequence[str] | None = None) -> int:
    """Measure and print; returns the exit code."""
    p = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    p.add_argument("--rounds", type=int, default=11, metavar="N", help="rounds (%(default)s)")
    p.add_argument("--settling", type=float, default=10.0, metavar="S", help="time of the checkpoint (%(default)s)")
    p.add_argument("--duration", type=float, default=1.0, metavar="S", help="of a case behind it (%(default)s)")
    p.add_argument("--output", type=Path, metavar="FILE", help="write the figures as JSON")
    arguments = p.parse_args(argv)
    ensure_built(ROOT / "build" / "fmus", ROOT)
    found = measure(arguments.rounds, arguments.settling, arguments.duration)
    for name, (seconds, ratio) in found.items():
        print(f"{name:22}{seconds:10.4f} s{ratio:8.2f} x")
    if arguments.output is not None:
        arguments.output.write_text(json.dumps(found, indent=1) + "\n")
    return 0


def measure(rounds: int, settling: float, duration: float) -> dict[str, tuple[float, float]]:
    """Median seconds of a case of each kind, and median ratio to that from a checkpoint."""
    durations = {BRANCH: duration, COLD: duration, SETTLING: settling + duration}
    with tempfile.TemporaryDirectory(prefix="branch_") as name:
        folder = Path(name)
        cold = plan(folder, duration, "")
        leave_checkpoint(cold, folder / "settled", settling)
        cases = {
            kind: plan(folder, seconds, SOURCE if kind == BRANCH else "") for kind, seconds in durations.items()
        }
        runners = {kind: CaseRunner(one.bundle.unpack(folder)) for kind, one in cases.items()}
        times: dict[str, list[float]] = {kind: [] for kind in cases}
        for number in range(rounds + 1):
            for kind, runner in runners.items():
                began = thread_time()
                row = runner.run(0, cases[kind].plan.values(0))
                assert row["status"] == "done", row["error"]
                if number:  # libraries are loaded
                    times[kind].append(thread_time() - began)
        for runner in runners.values():
            runner.warm.close()
    return {
        kind: (median(found), median(one / first for one, first in zip(found, times[BRANCH], strict=True)))
        for kind, found in times.items()
    }


def plan(folder: Path, duration: float, more: str) -> Prepared:
    """A study of the default system."""
    path = folder / "study.toml"
    path.write_text(STUDY.format(duration=duration) + more)
    return prepare(SweepOptions(path, folder / "out", fmus=ROOT / "build" / "fmus"))


def leave_checkpoint(cold: Prepared, folder: Path, settling: float) -> None:
    """Run the system of a study, and keep its state at the end."""
    study = cold.plan.study
    with Master(cold.system.structure, study.step_s, descriptions=cold.system.descriptions) as master:
        master.initialise()
        master.run(settling, checkpoints=Checkpoints(folder, settling))


if __name__ == "__main__":
    sys.exit(main())
