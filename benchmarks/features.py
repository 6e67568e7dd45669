"""What each feature costs a step: one table of contenders in turn, each against the same run without the feature.

The default system, in steps of 1e-4 s; isolation with two C FMUs that pass numbers on, so that a step is the exchange
alone.  Figures are medians over the rounds: us a step, by the clock that is named, and the ratio to the other run of
the same round.  The thread's clock is that of the loop.
Exit code 1 if a limit is missed.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from statistics import median
from typing import Any

from rounds import ALL_FMUS, FMUS, SSD, STEP, Figures, Limit, compare, run_benchmark, take_turns, time
from scaling import write_system

from ps_fmu.cosim import Master, Observer, Recorder, Scheme, read_system
from ps_fmu.cosim.checkpoint.checkpoints import Checkpoints
from ps_fmu.cosim.faults.reading import read_faults
from ps_fmu.cosim.isolation.instance import Isolation
from ps_fmu.cosim.schemes.scheme import Rate
from ps_fmu.runs.cases import Bounds
from ps_fmu.runs.index_record import IndexRecord
from ps_fmu.runs.keeping import SHARE
from ps_fmu.scenarios.jitter_record import JITTER_SIGNALS, JitterRecord

STEPS = 5000
STORAGE_STEP = 1e-3  # s
OBSERVERS = ("Bounds", "Recorder", "JitterRecord", "IndexRecord")
"""Those of the default scenario."""
ISOLATED_PORTS = 16


Round = Callable[[float], float]
"""Simulates so many seconds more; returns the seconds that this took."""


@dataclass(frozen=True)
class Feature:
    """A row of the table: ``make`` a run, and compare it with the row ``base``, by a clock.

    To make it takes a folder, what frees it at the end, and the clock.
    A round has ``length`` times the steps.  ``most``: of the ratio; ``most_us``: of the difference.
    """

    name: str
    make: Callable[[Path, ExitStack, str], Round]
    base: str = "plain"
    clock: str = "thread"
    length: float = 1.0
    most: float | None = None
    most_us: float | None = None


def run_plain(folder: Path, stack: ExitStack, clock: str, ssd: Path = SSD, **options: Any) -> Round:
    """A system that goes on from round to round, with options of the master."""
    master = stack.enter_context(Master(read_system(ssd, FMUS), STEP, **options))
    master.initialise()
    master.run(100 * STEP)  # first maps and tables
    return lambda duration: time(clock, lambda: master.run(duration))


def run_faults(
    folder: Path, stack: ExitStack, clock: str, action: Mapping[str, object], signals: int
) -> Round:
    """With a fault on the first signals, that leaves their values as they are."""
    system = read_system(SSD, FMUS)
    wires = [(wire.source, str(wire.target)) for wire in system.connections[:signals]]
    events = [{"time": 0.0, "model": s.component, "variable": s.variable, "target": t, **action} for s, t in wires]
    path = folder / "faults.json"
    path.write_text(json.dumps({"events": events}), encoding="utf-8")
    return run_plain(folder, stack, clock, faults=read_faults(path))


def run_through(folder: Path, stack: ExitStack, clock: str, isolation: Isolation | None) -> Round:
    """Two FMUs in C, in processes of their own or not."""
    path = write_system(Path(tempfile.mkdtemp(dir=folder), "two"), 2, ISOLATED_PORTS)
    return run_plain(folder, stack, clock, path, isolation=isolation)


def run_observed(
    folder: Path,
    stack: ExitStack,
    clock: str,
    names: Collection[str] = OBSERVERS,
    *,
    checkpoints: int = 0,
    share: float | None = None,
) -> Round:
    """A new run in each round, with some observers of the default scenario, and checkpoints if there are any."""
    system = read_system(SSD, FMUS)

    def run(duration: float) -> float:
        steps = round(duration / STEP)
        with tempfile.TemporaryDirectory(dir=folder) as place, Master(system, STEP) as master:
            master.initialise()
            columns = master.columns
            jitter = JitterRecord(columns, step_s=STEP, steps=steps, explored=True)
            recorder = Recorder(Path(place, "r.nc"), "run", columns=columns, step=STEP, storage_step=STORAGE_STEP)
            every: dict[str, Sequence[Observer]] = {
                "Bounds": [Bounds(columns)],
                "Recorder": [recorder],
                "JitterRecord": jitter.observers,
                "IndexRecord": [IndexRecord(columns, step_s=STEP, rows=steps + 1)],
            }
            interval = round(steps / max(checkpoints, 1)) * STEP
            kept = Checkpoints(Path(place, "kept"), interval, share=share) if checkpoints else None
            chosen = [observer for name in names for observer in every[name]]

            def work() -> None:
                master.run(duration, chosen, checkpoints=kept)
                recorder.close()

            return time(clock, work)

    return run


_BIAS: Mapping[str, object] = {"action": "bias", "value": 0.0}
_DELAY: Mapping[str, object] = {"action": "delay", "value": 100 * STEP}
_NOISE: Mapping[str, object] = {"action": "noise", "rms": 0.0}
_WATCHED = "observers, long run"

FEATURES = (
    Feature("plain", run_plain),
    Feature("outputs: those of isolation", partial(run_plain, only=JITTER_SIGNALS)),
    Feature("outputs: connections alone", partial(run_plain, only=())),
    Feature("all FMUs", partial(run_plain, ssd=ALL_FMUS), most=2.2),
    Feature("all FMUs: connections alone", partial(run_plain, ssd=ALL_FMUS, only=()), base="all FMUs"),
    Feature("fault: bias", partial(run_faults, action=_BIAS, signals=1)),
    Feature("fault: delay of 100 steps", partial(run_faults, action=_DELAY, signals=1)),
    Feature("fault: noise", partial(run_faults, action=_NOISE, signals=1)),
    Feature("fault: noise on ten signals", partial(run_faults, action=_NOISE, signals=10)),
    Feature("scheme: gauss-seidel", partial(run_plain, scheme=Scheme("gauss-seidel"))),
    Feature("scheme: lines", partial(run_plain, scheme=Scheme("jacobi", "linear"))),
    Feature("scheme: rate 4", partial(run_plain, scheme=Scheme("jacobi", rates={"isolator": Rate(4)}))),
    Feature("scheme: iterated", partial(run_plain, scheme=Scheme("iterated")), length=0.04),
    Feature("scheme: error estimate", partial(run_plain, scheme=Scheme("jacobi", error_estimate=True)), length=0.02),
    Feature("observers", run_observed, clock="processor"),
    *(Feature(f"observer: {name}", partial(run_observed, names=(name,)), clock="processor") for name in OBSERVERS),
    Feature(_WATCHED, run_observed, clock="processor", length=400.0),
    Feature(
        "checkpoints: twenty, all taken",
        partial(run_observed, checkpoints=20), _WATCHED, "processor", length=400.0,
    ),
    # Below 2 % are the rows: 84 MB here, which results.nc has, too, and which the kernel takes 0.5 ns a byte to store.
    # The rest are the first checkpoint and the last, which do not wait: 12 ms each, of a run of 3 s.
    Feature(
        "checkpoints: twenty due, as --checkpoint 10",
        partial(run_observed, checkpoints=20, share=SHARE), _WATCHED, "processor", length=400.0, most=1.03,
    ),
    Feature("two C FMUs", partial(run_through, isolation=None), "two C FMUs", clock="wall"),
    Feature(
        "two C FMUs, isolated", partial(run_through, isolation=Isolation()), "two C FMUs", clock="wall", most_us=15.0,
    ),
)  # fmt: skip
BY_NAME = {feature.name: feature for feature in FEATURES}


def _get(kind: str, name: str, found: Figures) -> float | None:
    return found[name][kind] if name in found else None


LIMITS = (
    *(Limit(f"{f.name}: x {f.base}", partial(_get, "ratio", f.name), f.most) for f in FEATURES if f.most is not None),
    *(Limit(f"{f.name}: us", partial(_get, "more", f.name), f.most_us) for f in FEATURES if f.most_us is not None),
)


def measure(options: argparse.Namespace, folder: Path) -> Figures:
    """Feature -> us a step, ratio to its base and difference."""
    asked = [BY_NAME[name] for name in options.features]
    names = {name for feature in asked for name in (feature.name, feature.base)}
    features = [feature for feature in FEATURES if feature.name in names | {BY_NAME[name].base for name in names}]
    with ExitStack() as stack:
        rounds = {f.name: _make_round(f, f.make(folder, stack, f.clock), options.steps) for f in features}
        costs = take_turns(rounds, options.rounds)
    return {
        f.name: {
            "us": median(costs[f.name]),
            "ratio": compare(costs, f.name, f.base),
            "more": median(costs[f.name]) - median(costs[f.base]),
        }
        for f in features
    }


def _make_round(feature: Feature, run: Round, steps: int) -> Callable[[], float]:
    """A round of a feature, in us a step."""
    count = max(1, round(feature.length * steps))
    return lambda: run(count * STEP) / count * 1e6


def report(found: Figures) -> str:
    """The figures as text."""
    lines = [f"{'':44}{'clock':>12}{'us a step':>12}{'ratio':>9}   to"]
    for name, row in found.items():
        feature = BY_NAME[name]
        lines.append(f"{name:44}{feature.clock:>12}{row['us']:>12.3f}{row['ratio']:>9.3f}   {feature.base}")
    return "\n".join(lines)


def add(p: argparse.ArgumentParser) -> None:
    """Add own options."""
    p.add_argument("--features", nargs="+", choices=BY_NAME, default=list(BY_NAME), metavar="NAME", help="rows")


if __name__ == "__main__":
    sys.exit(run_benchmark(__doc__, measure, report, LIMITS, rounds=9, steps=STEPS, add=add))
