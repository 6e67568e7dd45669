"""The pointing error indices of every run: of the payload's rotation and of the image point, with bias, RMS, peak and
quantiles.

The definitions are those of :mod:`ps_fmu.pointing.indices`; windows lie side by side.  The observer sees every step and
keeps a window of the signals and their distributions.  Quantiles are statements on the run's own time (the temporal
interpretation), with bounds from order statistics and the effective number of independent samples.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..pointing.confidence import Statement
from ..pointing.indices import AbsoluteError, DriftError, MeanError, PointingIndex, RelativeError
from ..requirements.decision import quantile_of_record
from ..requirements.distribution import Distribution
from ..results.observers.observer import ColumnObserver, NamedColumn, State, check_array

Array = NDArray[np.float64]

ROTATION = tuple(f"plant.payload_rotation.{axis}" for axis in "xyz")
IMAGE_POINT = ("plant.los.x", "plant.los.y")
VECTORS = {"payload_rotation": ("axis", ROTATION), "los": ("axis_xy", IMAGE_POINT)}
"""Short name -> dimension of its components, names of these."""
SIGNALS = tuple(name for _, names in VECTORS.values() for name in names)
WINDOW_S = 1.0  # an averaging time of a terminal, an exposure of a camera
PROBABILITIES = (0.6827, 0.95, 0.9973)
CONFIDENCE = 0.95
SCALE = 1e-6  # rad and m: the middle of the twelve decades in which values are told apart
BATCH_ROWS = 40_000  # evaluated together, one signal after the other: each call costs as much as 3000 rows
_STATED = ("probability", "value", "confidence", "lower", "upper", "bound")
KEPT = 2**14  # values of a series from which the number of independent samples follows


@dataclass(frozen=True, eq=False)
class IndexStatistics:
    """An index over a run; arrays (signals,) in the order and the units of the signals."""

    index: PointingIndex
    distributions: Sequence[Distribution]
    """Of each signal."""

    @property
    def count(self) -> int:
        """Values of the index: windows, or times in them."""
        return self.distributions[0].count

    @property
    def bias(self) -> Array:
        """Mean."""
        return np.array([one.mean for one in self.distributions])

    @property
    def rms(self) -> Array:
        """With the bias."""
        return np.array([one.rms for one in self.distributions])

    @property
    def peak(self) -> Array:
        """Largest magnitude."""
        return np.array([one.peak for one in self.distributions])

    @cached_property
    def quantiles(self) -> tuple[tuple[Statement, ...], ...]:
        """Of the magnitude, for each signal those of :data:`PROBABILITIES`.  To find them takes some 20 ms."""
        return tuple(
            tuple(quantile_of_record(one, probability, CONFIDENCE) for probability in PROBABILITIES)
            for one in self.distributions
        )

    def as_dict(self, place: int) -> dict[str, object]:
        """What summary.json says of one signal."""
        return {
            **{item.name: getattr(self.index, item.name) for item in fields(self.index)},  # type: ignore[arg-type]
            "values": self.count,
            "bias": self.bias[place],
            "rms": self.rms[place],
            "peak": self.peak[place],
            "quantiles": [
                {
                    **{key: getattr(stated, key) for key in _STATED},
                    "independent_samples": stated.independent,
                }
                for stated in self.quantiles[place]
            ],
        }


class IndexRecord(ColumnObserver):
    """APE, MPE, RPE (t uniform) and PDE (of windows that touch) of the named columns.

    A window that the run does not fill is left out of all but APE, which covers all rows.

    Parameters
    ----------
    columns, names: as in :class:`ColumnObserver`
    step_s: time between rows [s]
    rows: how many there will be
    window_s: length of the windows [s], rounded to whole steps; of one step, only APE remains
    start_s: rows before this time [s] are left out
    """

    def __init__(
        self,
        columns: Sequence[NamedColumn],
        names: Sequence[str] = SIGNALS,
        *,
        step_s: float,
        rows: int,
        window_s: float = WINDOW_S,
        start_s: float = -math.inf,
    ) -> None:
        super().__init__(columns, names, start_s=start_s)
        self._step = step_s
        self._width = max(1, round(window_s / step_s))
        window = self._width * step_s
        self._evaluated: tuple[PointingIndex, ...] = (AbsoluteError(),)
        if self._width > 1:
            self._evaluated += list_kinds(window)
        self._rows = rows
        self._found: dict[PointingIndex, list[Distribution]] = {}
        # The window before, for the PDE, then windows that are evaluated together.
        self._held = np.empty((len(self.names), self._width * (1 + max(1, BATCH_ROWS // self._width))))
        self._filled = self._width
        self._first = self._width  # of what is held: 0 once there is a window before

    def take(self, time: Array, samples: Array) -> None:
        """Hold the rows; evaluate them when there is no room for more."""
        taken, room = 0, self._held.shape[1]
        while taken < len(time):
            count = min(room - self._filled, len(time) - taken)
            self._held[:, self._filled : self._filled + count] = samples[:, taken : taken + count]
            taken += count
            self._filled += count
            if self._filled == room:
                self._evaluate()
                self._held[:, : self._width] = self._held[:, -self._width :]
                self._filled, self._first = self._width, 0

    def save_state(self) -> dict[str, Any]:
        """As :meth:`ColumnObserver.save_state`."""
        found = [
            [self._evaluated.index(index), [one.save_state() for one in own]] for index, own in self._found.items()
        ]
        return {"held": self._held[:, self._first : self._filled], "first": self._first, "found": found}

    def load_state(self, state: State) -> None:
        """As :meth:`ColumnObserver.load_state`."""
        held, first = state["held"], state["first"]
        check_array("held", held.T, self._held.T, grows=True)
        if first not in (0, self._width) or not self._width <= first + held.shape[1] < self._held.shape[1]:
            raise ValueError(f"held: {held.shape[1]} rows from {first} on, with room for {self._held.shape[1]}")
        self._first, self._filled = first, first + held.shape[1]
        self._held[:, self._first : self._filled] = held
        self._found.clear()
        for place, kept in state["found"]:
            for own, one in zip(self._find(self._evaluated[place]), kept, strict=True):
                own.load_state(one)

    def _find(self, index: PointingIndex) -> list[Distribution]:
        """The distributions of an index, by signal."""
        if index not in self._found:
            every_row = isinstance(index, AbsoluteError | RelativeError)
            expected = self._rows if every_row else max(1, self._rows // self._width)
            self._found[index] = [Distribution(SCALE, expected, KEPT) for _ in self.names]
        return self._found[index]

    def _evaluate(self) -> None:
        """Add what is held to the distributions; a window that is not full has an APE all the same."""
        for place, samples in enumerate(self._held):
            for index, values in zip(self._evaluated, self._find_values(samples), strict=True):
                if len(values):
                    self._find(index)[place].add(values)

    def _find_values(self, samples: Array) -> tuple[Array, ...]:
        """What :meth:`.PointingIndex.values` gives for each index, of a signal that is held.

        All but APE follow from the means of the windows, which take more than half of the time if each index asks anew.
        """
        errors = samples[self._width : self._filled]
        if len(self._evaluated) == 1:
            return (errors,)
        whole = self._filled // self._width * self._width
        means = samples[self._first : whole].reshape(-1, self._width).mean(axis=1)
        own = means[(self._width - self._first) // self._width :]  # without the window before
        deviation = samples[self._width : whole].reshape(-1, self._width) - own[:, None]
        return errors, own, deviation.ravel(), np.diff(means)

    def result(self) -> tuple[IndexStatistics, ...]:
        """The indices that the run was long enough for; none if no row has been seen.  The run is over then."""
        if self._filled > self._width:
            self._evaluate()
            self._filled = self._width
        return tuple(IndexStatistics(index, own) for index, own in self._found.items())


def is_alike(one: PointingIndex, other: PointingIndex) -> bool:
    """Whether two indices are the same but for rounding of their times."""
    if type(one) is not type(other):
        return False
    pairs = [(getattr(one, item.name), getattr(other, item.name)) for item in fields(one)]  # type: ignore[arg-type]
    return all(a == b if isinstance(a, str) else math.isclose(a, b, rel_tol=1e-9) for a, b in pairs)


def list_kinds(window_s: float) -> tuple[PointingIndex, ...]:
    """The indices of windows [s] that :class:`IndexRecord` finds beside APE."""
    return MeanError(window_s), RelativeError(window_s, "uniform"), DriftError(window_s, window_s)


@dataclass(frozen=True)
class CaseIndices:
    """The indices of one run of a scenario."""

    names: tuple[str, ...]
    units: tuple[str, ...]
    found: tuple[IndexStatistics, ...]
    more: tuple[IndexStatistics, ...] = ()
    """Of other windows than :data:`WINDOW_S`."""

    def of(self, symbol: str) -> IndexStatistics | None:
        """The index of a symbol; None if the run was too short for it."""
        return next((one for one in self.found if one.index.symbol == symbol), None)

    def find(self, index: PointingIndex) -> IndexStatistics | None:
        """An index by kind, window and times; None: it is not among those, or the run was too short for it."""
        return next((one for one in (*self.found, *self.more) if is_alike(one.index, index)), None)

    def as_dict(self) -> dict[str, object]:
        """signal -> its unit, and index -> what :meth:`IndexStatistics.as_dict` says."""
        return {
            name: {"unit": unit, **{one.index.symbol: one.as_dict(place) for one in self.found}}
            for place, (name, unit) in enumerate(zip(self.names, self.units, strict=True))
        }


@dataclass(frozen=True)
class IndexLog:
    """The index records of a scenario's runs, by their names; ``windows``, s, beside :data:`WINDOW_S`."""

    windows: tuple[float, ...] = ()
    _records: dict[str, list[IndexRecord]] = field(default_factory=dict)
    _found: dict[str, CaseIndices] = field(default_factory=dict)

    def observe(
        self, case: str, columns: Sequence[NamedColumn], step_s: float, steps: int, lead_steps: int = 0
    ) -> list[IndexRecord]:
        """The observers of a run; none where the system has not the signals.

        ``lead_steps``: steps at the start of the run that are left out, row 0 with them.
        """
        known = {column.name for column in columns}
        names = [name for name in SIGNALS if name in known]
        if not names:
            return []
        start_s = (lead_steps + 0.5) * step_s if lead_steps else -math.inf  # between two rows
        rows = steps - lead_steps + (not lead_steps)
        self._records[case] = [
            IndexRecord(columns, names, step_s=step_s, rows=rows, window_s=window_s, start_s=start_s)
            for window_s in (WINDOW_S, *self.windows)
        ]
        return self._records[case]

    def of(self, case: str) -> CaseIndices:
        """The indices of a run that is over.  Raises KeyError for one that was not observed."""
        if case not in self._found:
            record, *others = self._records[case]
            more = tuple(one for other in others for one in other.result()[1:])
            self._found[case] = CaseIndices(record.names, record.units, record.result(), more)
        return self._found[case]

    def __iter__(self) -> Iterator[str]:
        return iter(self._records)

    def as_dict(self) -> Mapping[str, object]:
        """The entry ``indices`` of summary.json: case -> signal -> index."""
        return {case: self.of(case).as_dict() for case in self}
