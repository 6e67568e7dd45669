"""What is observed of the runs of a case, and what is stored: signals, indices over windows, shares of switches."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import fields

import numpy as np
from numpy.typing import NDArray

from ..cosim import Column, UsageError
from ..cosim.clock import count_steps
from ..cosim.recording.recorder import METADATA_BYTES, STORAGE, find_chunk_rows
from ..cosim.recording.thinner import select_names
from ..cosim.structure import suggest_names
from ..pointing.indices import PointingIndex
from ..requirements.record import Windows
from ..requirements.requirement import find_members, list_names
from .study import Observed, Signals

Array = NDArray[np.float64]

LEAST_ROWS = 5000
"""That are evaluated at once: four indices of a run of 100,000 rows take 17 ms, with each block of 1000 alone 20 ms."""


def find_signals(observed: Observed, columns: Sequence[Column]) -> dict[str, int]:
    """Place of each observed signal among the columns, by name; a vector has several.

    Raises :class:`.study.StudyError` for an output that is not there, or no Real.
    """
    places = {column.name: place for place, column in enumerate(columns)}
    found: dict[str, int] = {}
    for signal in observed.signal:
        own = find_members(signal, places)
        if not own:
            hint = suggest_names(signal, list_names(places))
            raise observed.error("signal", f"there is no output {signal!r}{hint}")
        for name, place in own.items():
            if columns[place].type != "Real":
                raise observed.error("signal", f"{name} is of the type {columns[place].type}, no Real")
        found |= own
    return found


def check_windows(observed: Observed, step_s: float, duration_s: float) -> None:
    """Raises :class:`.study.StudyError` where a window is not whole steps, or the run too short for one value."""
    left = duration_s - observed.settling
    if left <= 0.0:
        raise observed.error("settling", f"{observed.settling:g} s are all of the run of {duration_s:g} s")
    for index in observed.indices:
        try:
            count = index.count(step_s)
        except ValueError as error:
            key, _, problem = str(error).partition(": ")
            raise observed.error(key, problem) from error
        if count * step_s > left + 1.5 * step_s:  # a run has a row more than steps
            needed = f"one value of {index.symbol} needs {count * step_s:g} s"
            raise observed.error("window", f"{needed}; the run has {left:g} s for it")


def label_index(index: PointingIndex) -> str:
    """Index in the name of a column: ``APE``, ``RPE_1s``, ``RPE_end_1s``, ``PDE_1s_10s``."""
    found = {item.name: getattr(index, item.name) for item in fields(index)}  # type: ignore[arg-type]
    parts = [index.symbol, *(["end"] if found.get("at") == "end" else [])]
    return "_".join(parts + [f"{found[name]:g}s" for name in ("window", "separation") if name in found])


def find_columns(signals: Signals, columns: Sequence[Column]) -> tuple[str, ...]:
    """Names of the outputs that are stored.  Raises :class:`.study.StudyError` for a pattern that fits none."""
    try:
        return tuple(select_names((column.name for column in columns), signals.variables))
    except UsageError as error:
        raise signals.error("variables", str(error)) from error


def check_signals(signals: Signals, columns: Sequence[Column], step_s: float, duration_s: float) -> None:
    """Raises :class:`.study.StudyError` for unknown outputs, and for a step that is no multiple of the runs' steps."""
    find_columns(signals, columns)
    if signals.step is None:
        return
    if count_steps(signals.step, step_s) is None:
        raise signals.error("step", f"{signals.step:g} s are no whole number of steps of {step_s:g} s")
    if signals.step > duration_s:
        raise signals.error("step", f"{signals.step:g} s are longer than a run of {duration_s:g} s")


def check_size(signals: Signals, columns: Sequence[Column], cases: int, runs: int, rows: int) -> int:
    """Bytes of all files, estimated.

    Parameters
    ----------
    rows: that are stored of each of the ``runs`` of a case.

    Raises :class:`.study.StudyError` for a listed case that the plan has not, and for more than is allowed.
    """
    for case in () if signals.cases == "all" else signals.cases:
        if case >= cases:
            raise signals.error("cases", f"there is no case {case}: the study has the cases 0 to {cases - 1}")
    chosen = sum(map(signals.wants, range(cases)))
    files = min(cases, chosen + (signals.worst or 0))
    names = find_columns(signals, columns)
    width = 8 + sum(STORAGE[column.type][1] for column in columns if column.name in set(names))
    chunk = find_chunk_rows(rows)
    each = runs * (-(-rows // chunk) * chunk * width + METADATA_BYTES * (len(names) + 16))
    if files * each > signals.most * 1e9:
        raise signals.error(
            "variables", f"{len(names)} outputs of {files} cases take some {files * each / 1e9:.3g} GB, "
            f"{each / 1e6:.3g} MB a case; allowed are {signals.most:g} GB (key most): store fewer cases or outputs, "
            "or rows further apart (step)"
        )  # fmt: skip
    return files * each


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
        self._first = math.ceil(observed.settling / step_s - 1e-6)
        signals = find_signals(observed, columns)
        self._names, self._places = list(signals), list(signals.values())
        self._sums = {index: _Sums(len(signals)) for index in observed.indices}
        self._windows: dict[tuple[int, int], tuple[Windows, list[PointingIndex]]] = {}
        """Those of indices whose windows are the same, by their rows and the rows from one to the next."""
        for index in observed.indices:
            window = getattr(index, "window", None)
            grid = index.count(step_s), 1 if window is None else round(window / step_s)
            self._windows.setdefault(grid, (Windows(*grid, 1, LEAST_ROWS), []))[1].append(index)

    def block(self, first_index: int, _time: Array, values: Array) -> None:
        """Take ``values`` (rows, columns); ``first_index`` counts rows from the start of the run."""
        # A copy, signal by signal: sums along time are twice as fast as across it.
        samples = values[max(0, self._first - first_index) :, self._places].T.copy()
        if samples.shape[1]:
            for windows, indices in self._windows.values():
                self._evaluate(windows, indices, windows.add(samples))

    def _evaluate(self, windows: Windows, indices: Sequence[PointingIndex], samples: Array | None) -> None:
        if samples is None:
            return
        for index in indices:
            self._sums[index].add(index.values(samples.T, self._step, stride=windows.stride))

    def metrics(self) -> dict[str, float]:
        """``SIGNAL.INDEX.rms`` and ``.peak``, in the unit of the signal; NaN before the first window is full."""
        for windows, indices in self._windows.values():
            self._evaluate(windows, indices, windows.take())
        return {
            f"{signal}.{label_index(index)}.{end}": value
            for index, sums in self._sums.items()
            for place, signal in enumerate(self._names)
            for end, value in zip(("rms", "peak"), sums.conclude(place), strict=True)
        }


class _Sums:
    """Number, squares and largest magnitude of the values of an index, by signal."""

    def __init__(self, signals: int) -> None:
        self._values = 0
        self._squares, self._peak = np.zeros(signals), np.zeros(signals)

    def add(self, found: Array) -> None:
        """Add values (windows, r, signals)."""
        self._values += found.shape[0] * found.shape[1]
        self._squares += np.einsum("wrs,wrs->s", found, found)
        np.maximum(self._peak, np.maximum(found.max(axis=(0, 1)), -found.min(axis=(0, 1))), out=self._peak)

    def conclude(self, place: int) -> tuple[float, float]:
        """RMS and peak of a signal."""
        if not self._values:
            return math.nan, math.nan
        return float(np.sqrt(self._squares[place] / self._values)), float(self._peak[place])


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


class CaseRecord:
    """What a run of a case is observed by; its metrics go into the row."""

    def __init__(self, observed: Sequence[Observed], columns: tuple[Column, ...], step_s: float) -> None:
        indices = [IndexRecord(one, columns, step_s) for one in observed]
        self.observers: list[IndexRecord | SwitchRecord] = [*indices, SwitchRecord(columns)]

    def metrics(self) -> dict[str, float]:
        """By name."""
        return {name: value for record in self.observers for name, value in record.metrics().items()}
