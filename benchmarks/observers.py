"""What the observers of a run cost: those of the default scenario, in the loop, in a thread beside it, and each one.

All run in turn, round by round, and the figures are the least of the rounds, in us a step: processor time of the
process and of the loop's thread, and wall time.  Those of each observer are processor time in the loop, where its rows
are those that the FMUs have just written; they come from runs of their own, for to ask the clock costs something, too.
With two idle processors a run with the thread takes as long as the loop.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from time import perf_counter, process_time, thread_time
from typing import Any

import netCDF4
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
DURATION = 20.0  # s of a round, as of the scenario
CLOCKS = {"processor": process_time, "loop": thread_time, "wall": perf_counter}


class Timed:
    """Observer that takes the processor time of another one."""

    def __init__(self, observer: Observer) -> None:
        self._observer = observer
        self.ignored_magnitude: float = getattr(observer, "ignored_magnitude", -math.inf)
        self.spent = 0.0
        """[s]"""

    def block(self, first_index: int, time: Array, values: Array) -> None:
        """Hand the rows on."""
        begun = thread_time()
        self._observer.block(first_index, time, values)
        self.spent += thread_time() - begun

    def close(self) -> None:
        """Write what is left, if it is a recorder."""
        begun = thread_time()
        if isinstance(self._observer, Recorder):
            self._observer.close()
        self.spent += thread_time() - begun


def main(argv: Sequence[str] | None = None) -> int:
    """Measure and print; returns the exit code."""
    system = ROOT / "system" / "SystemStructure.ssd"
    return run_in_rounds(
        argv, __doc__, 5, f"{DURATION:g} s",
        lambda rounds, folder: measure(read_system(system, FMUS), rounds, folder), report,
    )  # fmt: skip


def measure(system: System, rounds: int, folder: Path, duration: float = DURATION) -> dict[str, Cost]:
    """Figures in us a step: clock -> way of observing, and ``each`` -> observer."""
    found: dict[str, Cost] = {name: {} for name in (*CLOCKS, "each")}

    def note(kind: str, costs: Cost) -> None:
        for name, cost in costs.items():
            found[kind][name] = min(cost, found[kind].get(name, cost))

    for _ in range(rounds):
        for name in ("none", "in the loop", "beside", "each"):
            path = folder / "rows.nc" if name != "none" else None
            costs, each = _time_run(system, duration, path, beside=name == "beside", apart=name == "each")
            if each:
                note("each", each)
            else:
                for clock, cost in costs.items():
                    note(clock, {name: cost})
            (folder / "rows.nc").unlink(missing_ok=True)
    return found


def make_observers(columns: Sequence[Column], duration: float, path: Path, file: Any) -> dict[str, Observer]:
    """The observers of a case of the default scenario, by their names; ``file`` is the dataset at ``path``, open."""
    steps = round(duration / STEP)
    jitter = JitterRecord(columns, step_s=STEP, steps=steps, explored=True).observers
    others: tuple[Observer, ...] = (
        Bounds(tuple(columns)),
        Recorder(
            path, "run", columns=columns, step=STEP, storage_step=STORAGE_STEP, append=True, file=file, rows=steps + 1
        ),
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
    each = {**result["each"], "all of them": sum(result["each"].values())}
    lines += [f"{name:28}{cost:10.3f}{cost / none:10.2f} of the steps" for name, cost in each.items()]
    return "\n".join(lines)


def _time_run(
    system: System, duration: float, path: Path | None, beside: bool, apart: bool = False
) -> tuple[Cost, Cost]:
    """A run with all observers, stored in ``path``, or without any: clock -> us a step, and observer -> us a step.

    Observers are timed only if that is asked for, ``apart``.  The file is open before and afterwards, as that of a
    scenario is.
    """
    with ExitStack() as stack:
        master = stack.enter_context(Master(system, STEP))
        master.initialise()
        observers: dict[str, Observer] = {}
        if path is not None:
            file = stack.enter_context(netCDF4.Dataset(path, "w"))
            observers = make_observers(master.columns, duration, path, file)
        timed = {name: Timed(observer) for name, observer in observers.items()} if apart else {}
        begun = {name: clock() for name, clock in CLOCKS.items()}
        master.run(duration, list((timed or observers).values()), beside=beside)
        for observer in (timed or observers).values():
            if isinstance(observer, Timed | Recorder):
                observer.close()
        steps = duration / STEP * 1e-6
        costs = {name: (clock() - begun[name]) / steps for name, clock in CLOCKS.items()}
        return costs, {name: observer.spent / steps for name, observer in timed.items()}


if __name__ == "__main__":
    sys.exit(main())
