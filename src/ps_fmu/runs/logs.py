"""What is noted during a run: its warnings, and with ``--profile`` where its time goes."""

from __future__ import annotations

import logging
import math
import sys
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from time import perf_counter

import numpy as np
from numpy.typing import NDArray

from ..cosim import Observer
from ..cosim.recording.delivery import EarlyObserver
from ..cosim.stopwatch import EXCHANGE, StepCosts, Stopwatch
from ..results.tables import Table


class WarningLog:
    """Warnings in the order in which they came, each text once; ``shown`` on the error stream, too.

    ``texts``: those that have been shown before.
    """

    def __init__(self, texts: Iterable[str] = (), *, shown: bool = True) -> None:
        self._shown = shown
        self._texts = dict.fromkeys(texts)

    @property
    def texts(self) -> tuple[str, ...]:
        """All warnings so far."""
        return tuple(self._texts)

    def add(self, text: str) -> None:
        """Keep a warning and show it above a progress bar; nothing if it is known already."""
        from tqdm import tqdm

        if text not in self._texts:
            self._texts[text] = None
            if self._shown:
                tqdm.write(text, file=sys.stderr)

    @contextmanager
    def collect(self) -> Iterator[None]:
        """Add what the co-simulation logs as a warning during the body."""
        handler = logging.Handler(logging.WARNING)
        handler.emit = lambda record: self.add(record.getMessage())  # type: ignore[method-assign]
        logger = logging.getLogger("ps_fmu.cosim")
        logger.addHandler(handler)
        try:
            yield
        finally:
            logger.removeHandler(handler)


Array = NDArray[np.float64]

_HEADER = ("us a step", "set", "step", "get", "all", "share", "longest (us)", "at t (s)")


class TimedObserver:
    """Another observer, whose work is timed."""

    def __init__(self, observer: Observer) -> None:
        self._observer = self.observed = observer
        """That of which a checkpoint keeps the state."""
        self.observer_name = type(observer).__name__
        self.ignored_magnitude: float = getattr(observer, "ignored_magnitude", -math.inf)
        self.spent_s = 0.0

    def block(self, first_index: int, time: Array, values: Array) -> None:
        """See :meth:`ps_fmu.cosim.Observer.block`."""
        with self._time():
            self._observer.block(first_index, time, values)

    @contextmanager
    def _time(self) -> Iterator[None]:
        began = perf_counter()
        try:
            yield
        finally:
            self.spent_s += perf_counter() - began


class TimedEarlyObserver(TimedObserver):
    """One that takes early rows, too."""

    _observer: EarlyObserver

    def early(self, first_index: int, time: Array, values: Array) -> None:
        """See :meth:`ps_fmu.cosim.recording.delivery.EarlyObserver.early`."""
        with self._time():
            self._observer.early(first_index, time, values)


@dataclass
class RunCosts:
    """The costs of one run: its steps, and what its observers do with the rows."""

    stopwatch: Stopwatch = field(default_factory=Stopwatch)
    observers: list[TimedObserver] = field(default_factory=list)

    def time(self, observers: Iterable[Observer]) -> list[TimedObserver]:
        """The observers, timed."""
        self.observers = [
            TimedEarlyObserver(one) if isinstance(one, EarlyObserver) else TimedObserver(one) for one in observers
        ]
        return self.observers

    def sum_observers(self) -> dict[str, float]:
        """Seconds of wall time by kind of observer."""
        found: dict[str, float] = {}
        for observer in self.observers:
            found[observer.observer_name] = found.get(observer.observer_name, 0.0) + observer.spent_s
        return found

    def as_dict(self) -> dict[str, object]:
        """Seconds of wall time, for summary.json."""
        costs = self.stopwatch.read()
        return {
            "steps": costs.steps,
            "total_s": costs.total_s,
            "longest_step": {"s": costs.longest_s, "time_s": costs.longest_at},
            "parts": {
                name: {
                    "set_s": part.set_s, "step_s": part.step_s, "get_s": part.get_s,
                    "longest_call": {"s": part.longest_s, "time_s": part.longest_at},
                }
                for name, part in costs.parts.items()
            },
            "observers_s": self.sum_observers(),
        }  # fmt: skip

    def to_table(self, case: str) -> Table:
        """Microseconds a step, by component, and the longest call of each."""
        costs = self.stopwatch.read()
        observed = self.sum_observers()
        rows = list(_list_rows(costs, observed, costs.total_s + sum(observed.values())))
        caption = (
            f"Cost of the run {case}: wall time of {costs.steps} steps, with a reading of the clock in each figure "
            "(about 0.03 us)"
        )
        return Table(caption, _HEADER, rows)


@dataclass
class CostLog:
    """The costs of a scenario's runs by their names; empty unless they are wanted."""

    _runs: dict[str, RunCosts] = field(default_factory=dict)

    def begin(self, case: str) -> RunCosts:
        """Where the costs of a run are noted."""
        self._runs[case] = RunCosts()
        return self._runs[case]

    def as_dict(self) -> Mapping[str, object]:
        """The entry ``costs`` of summary.json, by run."""
        return {case: run.as_dict() for case, run in self._runs.items()}

    def to_tables(self) -> list[Table]:
        """A table for each run."""
        return [run.to_table(case) for case, run in self._runs.items()]


def _list_rows(costs: StepCosts, observed: Mapping[str, float], whole_s: float) -> Iterator[tuple[str, ...]]:
    """Components, exchange, loop; the sum of the steps; the observers.  ``whole_s``: steps and observers."""
    each = 1e6 / max(costs.steps, 1)

    def make_row(name: str, spent_s: float, *longest: float, calls: Iterable[float] = ()) -> tuple[str, ...]:
        """``longest`` [s] and when it began [s]; ``calls``: setting, stepping and getting [s]."""
        columns = [f"{each * one:.3f}" for one in calls] or ["-"] * 3
        share = f"{100.0 * spent_s / whole_s:.0f} %" if whole_s > 0.0 else "-"
        when = [f"{1e6 * longest[0]:.0f}", f"{longest[1]:.9g}"] if longest and math.isfinite(longest[1]) else ["-"] * 2
        return name, *columns, f"{each * spent_s:.3f}", share, *when

    for name, part in costs.parts.items():
        calls = () if name == EXCHANGE else (part.set_s, part.step_s, part.get_s)
        yield make_row(name, part.total_s, part.longest_s, part.longest_at, calls=calls)
    yield make_row("loop and rows", costs.total_s - sum(part.total_s for part in costs.parts.values()))
    yield make_row("all steps", costs.total_s, costs.longest_s, costs.longest_at)
    for name, spent_s in observed.items():
        yield make_row(name, spent_s)
