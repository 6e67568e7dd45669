"""What the observers of a run cost: those of the default scenario, in the loop, in a thread beside it, and each alone.

All run in turn, round by round, and the figures are the least of the rounds, in us a step: processor time of the
process and of the loop's thread, and wall time.  With two idle processors a run with the thread takes as long as the
loop.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from time import perf_counter, process_time, thread_time

import numpy as np
from command import FMUS, ROOT, run_in_rounds
from numpy.typing import NDArray

from ps_fmu.cosim import Column, Master, Observer, Recorder, System, read_system
from ps_fmu.runs.cases import Bounds
from ps_fmu.runs.index_record import IndexRecord
from ps_fmu.runs.jitter_record import JitterRecord

Array = NDArray[np.float64]
Cost = dict[str, float]

STEP, STORAGE_STEP = 1e-4, 1e-3  # s
DURATION = 5.0  # s of a round
CLOCKS = {"processor": process_time, "loop": thread_time, "wall": perf_counter}


class Blocks:
    """Observer that keeps all blocks, to hand them over again."""

    def __init__(self) -> None:
        self.blocks: list[tuple[int, Array, Array]] = []

    def block(self, first_index: int, time: Array, values: Array) -> None:
        """Keep the rows."""
        self.blocks.append((first_index, time.copy(), values.copy()))

    def hand_over(self, observer: Observer) -> float:
        """Processor time of an observer that takes all blocks [us a row]."""
        begun = thread_time()
        for block in self.blocks:
            observer.block(*block)
        if isinstance(observer, Recorder):
            observer.close()
        return (thread_time() - begun) / sum(len(time) for _, time, _ in self.blocks) * 1e6


def main(argv: Sequence[str] | None = None) -> int:
    """Measure and print; returns the exit code."""
    system = ROOT / "system" / "SystemStructure.ssd"
    return run_in_rounds(
        argv, __doc__, 5, f"{DURATION:g} s",
        lambda rounds, folder: measure(read_system(system, FMUS), rounds, folder), report,
    )  # fmt: skip


def measure(system: System, rounds: int, folder: Path, duration: float = DURATION) -> dict[str, Cost]:
    """Figures in us a step: clock -> way of observing, and ``alone`` -> observer."""
    found: dict[str, Cost] = {name: {} for name in (*CLOCKS, "alone")}
    kept, columns = _keep_blocks(system, duration)

    def note(kind: str, name: str, cost: float) -> None:
        found[kind][name] = min(cost, found[kind].get(name, cost))

    for number in range(rounds):
        for name, beside in (("none", False), ("in the loop", False), ("beside", True)):
            path = folder / f"{number}_{name}.nc"
            for clock, cost in _time_run(system, duration, path if name != "none" else None, beside).items():
                note(clock, name, cost)
        for name, observer in make_observers(columns, duration, folder / f"{number}.nc").items():
            note("alone", name, kept.hand_over(observer))
        for path in folder.glob("*.nc"):
            path.unlink()
    return found


def make_observers(columns: Sequence[Column], duration: float, path: Path) -> dict[str, Observer]:
    """The observers of a case of the default scenario, by their names."""
    steps = round(duration / STEP)
    jitter = JitterRecord(columns, step_s=STEP, steps=steps, explored=True).observers
    others: tuple[Observer, ...] = (
        Bounds(tuple(columns)),
        Recorder(path, "run", columns=columns, step=STEP, storage_step=STORAGE_STEP),
        *jitter,
        IndexRecord(columns, step_s=STEP, rows=steps + 1),
    )
    found: dict[str, Observer] = {}
    for observer in others:
        name = type(observer).__name__
        found[name if name not in found else f"{name}, another"] = observer
    return found


def report(result: dict[str, Cost]) -> str:
    """The figures as text."""
    lines = [f"{'us a step':28}{'processor':>10}{'loop':>10}{'wall':>10}"]
    for name in result["processor"]:
        costs = "".join(f"{result[clock][name]:10.2f}" for clock in CLOCKS)
        lines.append(f"{'observers: ' + name:28}{costs}")
    none = result["processor"]["none"]
    for name in ("in the loop", "beside"):
        shares = "".join(f"{result[clock][name] / result[clock]['none'] - 1.0:10.2f}" for clock in CLOCKS)
        lines.append(f"{name + ', to steps':28}{shares}")
    lines.append("")
    lines += [f"{name:28}{cost:10.3f}{cost / none:10.2f} of the steps" for name, cost in result["alone"].items()]
    return "\n".join(lines)


def _keep_blocks(system: System, duration: float) -> tuple[Blocks, tuple[Column, ...]]:
    kept = Blocks()
    with Master(system, STEP) as master:
        master.initialise()
        master.run(duration, [kept])
        return kept, master.columns


def _time_run(system: System, duration: float, path: Path | None, beside: bool) -> Cost:
    """A run with all observers that store into ``path``, or without any; clock -> us a step."""
    with Master(system, STEP) as master:
        master.initialise()
        observers = [] if path is None else list(make_observers(master.columns, duration, path).values())
        begun = {name: clock() for name, clock in CLOCKS.items()}
        master.run(duration, observers, beside=beside)
        for observer in observers:
            if isinstance(observer, Recorder):
                observer.close()
        return {name: (clock() - begun[name]) / (duration / STEP) * 1e6 for name, clock in CLOCKS.items()}


if __name__ == "__main__":
    sys.exit(main())
