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


def find_signals(observed: Observed, columns: Sequence[Column]) -> dict[str, int]:
    """Place of each observed signal among the columns, by name; a vector has several.

    Raises :class:`.study.StudyError` for an output that is not there, or no Real.
    """
    places = {column.name: place for place, column in enumerate(columns)}
    found: dict[str, int] = {}
    for signal in observed.signals:
        member = re.compile(re.escape(signal) + r"(?:\.\w+|_\d+)?")
        own = {name: place for name, place in places.items() if "." in signal and member.fullmatch(name)}
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
        self._sums = [_WindowSums(index, list(signals), step_s) for index in observed.indices]

    def block(self, first_index: int, _time: Array, values: Array) -> None:
        """Take ``values`` (rows, columns); ``first_index`` counts rows from the start of the run."""
        samples = values[max(0, self._first - first_index) :, self._places]  # a copy: places are a list
        if len(samples):
            for sums in self._sums:
                sums.add(samples)

    def metrics(self) -> dict[str, float]:
        """``SIGNAL.INDEX.rms`` and ``.peak``, in the unit of the signal; NaN before the first window is full."""
        return {name: value for sums in self._sums for name, value in sums.metrics().items()}


class _WindowSums:
    """Sums over the windows of one index."""

    def __init__(self, index: PointingIndex, signals: Sequence[str], step_s: float) -> None:
        self._index, self._signals, self._step = index, signals, step_s
        self._count = index.count(step_s)
        window = getattr(index, "window", None)
        self._stride = 1 if window is None else round(window / step_s)
        self._pending: list[Array] = []
        self._waiting = 0
        self._values = 0
        self._squares, self._peak = np.zeros(len(signals)), np.zeros(len(signals))

    def add(self, samples: Array) -> None:
        """Add rows (n, signals)."""
        self._pending.append(samples)
        self._waiting += len(samples)
        if self._waiting < self._count:
            return
        joined = self._pending[0] if len(self._pending) == 1 else np.concatenate(self._pending)
        found = self._index.values(joined, self._step, stride=self._stride)
        rest = joined[len(found) * self._stride :].copy()
        self._pending, self._waiting = [rest], len(rest)
        flat = found.reshape(-1, len(self._signals))
        self._values += len(flat)
        self._squares += np.einsum("ij,ij->j", flat, flat)
        np.maximum(self._peak, np.abs(flat).max(axis=0), out=self._peak)

    def metrics(self) -> dict[str, float]:
        found = {}
        rms = np.sqrt(self._squares / self._values) if self._values else np.full(len(self._signals), math.nan)
        peak = self._peak if self._values else rms
        for place, signal in enumerate(self._signals):
            found[f"{signal}.{label_index(self._index)}.rms"] = float(rms[place])
            found[f"{signal}.{label_index(self._index)}.peak"] = float(peak[place])
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
