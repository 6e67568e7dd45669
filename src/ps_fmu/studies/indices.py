"""Observers of a case: pointing indices window by window, and how often a switch was on."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import fields

import numpy as np
from numpy.typing import NDArray

from ..cosim import Column
from ..cosim.structure import suggest_names
from ..pointing.indices import PointingIndex
from .study import Observed, StudyError

Array = NDArray[np.float64]


LEAST_ROWS = 5000
"""That are evaluated at once: four indices of a run of 100,000 rows take 17 ms, with each block of 1000 alone 20 ms."""


def find_signals(observed: Observed, columns: Sequence[Column]) -> dict[str, int]:
    """Place of each observed signal among the columns, by name; a vector has several.

    Raises :class:`.study.StudyError` for an output that is not there, or no Real.
    """
    places = {column.name: place for place, column in enumerate(columns)}
    found: dict[str, int] = {}
    for signal in observed.signals:
        member = re.compile(re.escape(signal) + r"(?:\.\w+|_\d+)?")
        own = {
            name: place
            for name, place in places.items()
            if name == signal or ("." in signal and member.fullmatch(name))  # a component is no vector
        }
        if not own:
            vectors = {name.rpartition(".")[0] for name in places}
            hint = suggest_names(signal, [*places, *(name for name in vectors if "." in name)])
            raise StudyError(f"{observed.place}, signal: there is no output {signal!r}{hint}")
        for name, place in own.items():
            if columns[place].type != "Real":
                raise StudyError(f"{observed.place}, signal: {name} is of the type {columns[place].type}, no Real")
        found |= own
    return found


def check_windows(observed: Observed, step_s: float, duration_s: float) -> None:
    """Raises :class:`.study.StudyError` where a window is not whole steps, or the run too short for one value."""
    left = duration_s - observed.settling_s
    if left <= 0.0:
        problem = f"settling: {observed.settling_s:g} s are all of the run of {duration_s:g} s"
        raise StudyError(f"{observed.place}, {problem}")
    for index in observed.indices:
        try:
            count = index.count(step_s)
        except ValueError as error:
            raise StudyError(f"{observed.place}, {error}") from error
        if count * step_s > left + 1.5 * step_s:  # a run has a row more than steps
            problem = f"window: one value of {index.symbol} needs {count * step_s:g} s; the run has {left:g} s for it"
            raise StudyError(f"{observed.place}, {problem}")


def label_index(index: PointingIndex) -> str:
    """Index in the name of a column: ``APE``, ``RPE_1s``, ``RPE_end_1s``, ``PDE_1s_10s``."""
    found = {item.name: getattr(index, item.name) for item in fields(index)}  # type: ignore[arg-type]
    parts = [index.symbol, *(["end"] if found.get("at") == "end" else [])]
    return "_".join(parts + [f"{found[name]:g}s" for name in ("window", "separation") if name in found])


class IndexRecord:
    """RMS and peak of pointing indices over a run, in the memory of one window.

    Windows lie side by side from the end of the settling on; one that the run does not fill is left out.

    Parameters
    ----------
    columns: all columns of the run, in the order of the blocks.
    step_s: between rows, s.

    Raises :class:`.study.StudyError` for signals that are not there.
    """

    def __init__(self, observed: Observed, columns: Sequence[Column], step_s: float) -> None:
        self._step = step_s
        self._first = math.ceil(observed.settling_s / step_s - 1e-6)
        signals = find_signals(observed, columns)
        self._places = list(signals.values())
        grids: dict[tuple[int, int], list[PointingIndex]] = {}
        for index in observed.indices:
            window = getattr(index, "window", None)
            grid = index.count(step_s), 1 if window is None else round(window / step_s)
            grids.setdefault(grid, []).append(index)
        self._windows = [_Windows(*grid, indices, list(signals), step_s) for grid, indices in grids.items()]
        self._order = [label_index(index) for index in observed.indices]

    def block(self, first_index: int, _time: Array, values: Array) -> None:
        """Take ``values`` (rows, columns); ``first_index`` counts rows from the start of the run."""
        # A copy, signal by signal: sums along time are twice as fast as across it.
        samples = values[max(0, self._first - first_index) :, self._places].T.copy()
        if samples.shape[1]:
            for windows in self._windows:
                windows.add(samples)

    def metrics(self) -> dict[str, float]:
        """``SIGNAL.INDEX.rms`` and ``.peak``, in the unit of the signal; NaN before the first window is full."""
        found = {label: own for windows in self._windows for label, own in windows.metrics().items()}
        return {name: value for label in self._order for name, value in found[label].items()}


class _Windows:
    """Sums over the windows of indices whose windows are the same: ``count`` rows, ``stride`` rows apart."""

    def __init__(
        self, count: int, stride: int, indices: Sequence[PointingIndex], signals: Sequence[str], step_s: float
    ) -> None:
        self._count, self._stride, self._indices = count, stride, indices
        self._signals, self._step = signals, step_s
        self._pending: list[Array] = []
        self._waiting = 0
        self._values = [0] * len(indices)
        self._squares, self._peak = (np.zeros((len(indices), len(signals))) for _ in range(2))

    def add(self, samples: Array) -> None:
        """Add rows (signals, n), which are kept."""
        self._pending.append(samples)
        self._waiting += samples.shape[1]
        if self._waiting >= max(self._count, LEAST_ROWS):
            self._evaluate()

    def _evaluate(self) -> None:
        joined = self._pending[0] if len(self._pending) == 1 else np.concatenate(self._pending, axis=1)
        for place, index in enumerate(self._indices):
            found = index.values(joined.T, self._step, stride=self._stride)
            self._values[place] += found.shape[0] * found.shape[1]
            self._squares[place] += np.einsum("wrs,wrs->s", found, found)
            largest = np.maximum(found.max(axis=(0, 1)), -found.min(axis=(0, 1)))
            np.maximum(self._peak[place], largest, out=self._peak[place])
        done = (joined.shape[1] - self._count) // self._stride + 1
        rest = joined[:, done * self._stride :].copy()
        self._pending, self._waiting = [rest], rest.shape[1]

    def metrics(self) -> dict[str, dict[str, float]]:
        """``SIGNAL.INDEX.rms`` and ``.peak`` of each index, by its label."""
        if self._waiting >= self._count:
            self._evaluate()
        found = {}
        for index, values, squares, peak in zip(self._indices, self._values, self._squares, self._peak, strict=True):
            label = label_index(index)
            rms = np.sqrt(squares / values) if values else np.full(len(self._signals), math.nan)
            found[label] = {
                f"{signal}.{label}.{name}": float(number[place])
                for place, signal in enumerate(self._signals)
                for name, number in (("rms", rms), ("peak", peak if values else rms))
            }
        return found


class SwitchRecord:
    """Share of the rows in which each Boolean output was true: saturation, contact, a target out of reach."""

    def __init__(self, columns: Sequence[Column]) -> None:
        self._places = {column.name: place for place, column in enumerate(columns) if column.type == "Boolean"}
        self._true, self._rows = np.zeros(len(self._places)), 0

    def block(self, _first_index: int, _time: Array, values: Array) -> None:
        """Take ``values`` (rows, columns)."""
        self._true += (values[:, list(self._places.values())] > 0.5).sum(axis=0)
        self._rows += len(values)

    def metrics(self) -> dict[str, float]:
        """``SIGNAL.share`` of each."""
        shares = self._true / max(self._rows, 1)
        return {f"{name}.share": float(share) for name, share in zip(self._places, shares, strict=True)}
