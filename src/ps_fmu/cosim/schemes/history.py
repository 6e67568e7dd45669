"""Inputs between two communication points: the lines that follow from the values so far.

``native/lines.h`` does the same in C, with the same results to the last bit.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from ctypes import Structure, addressof, c_double, c_int64, c_void_p
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..checkpoint.state import State, copy_into
from ..rows import Array


@dataclass(frozen=True)
class Grid:
    """Steps of ``step`` [s] from ``start`` [s] on; ``now`` [s] is where the present one begins."""

    now: c_double
    start: float
    step: float


class _Lines(Structure):
    """``Lines`` of lines.h."""

    _fields_ = (
        *((name, c_int64) for name in ("count", "smoothed")),
        *((name, c_double) for name in ("start", "step", "length", "offset", "part")),
        *((name, c_void_p) for name in ("places", "periods", "ahead", "values", "slopes")),
        *((name, c_void_p) for name in ("memory", "first", "begin", "slope")),
    )


class InputHistory:
    """Samples of some inputs of a component, and the line on which each of them goes through a step of the component.

    Parameters
    ----------
    grid: the base steps
    length: of the component's step [s]
    smoothed: lines begin where the last ones ended
    first: values (inputs,) where the first step begins
    periods: (inputs,), base steps between two values of the source
    ahead: (inputs,), 1 where the source has made the present base step already, else 0
    """

    def __init__(
        self, grid: Grid, length: float, smoothed: bool, first: Array, periods: Sequence[int], ahead: Sequence[int]
    ) -> None:
        self._grid, self._length, self._smoothed = grid, length, smoothed
        self._periods, self._ahead = np.array(periods, dtype=np.int64), np.array(ahead, dtype=np.int64)
        n = len(first)
        # Rows: time and value of the last sample but one, of the last, and where the line of the last step ended.
        self._memory = np.full((5, n), np.nan)
        self._first = first.copy()
        self.begin: Array = np.zeros(n)
        """Where the lines begin."""
        self.slope: Array = np.zeros(n)
        """Their slopes [1/s]."""

    def copy_from(self, other: InputHistory) -> None:
        """Take over the samples of another history of the same inputs."""
        self._memory[:] = other._memory
        self._first[:] = other._first

    def save_state(self) -> dict[str, State]:
        """The samples, and the lines of the present step of the component."""
        return {
            "memory": self._memory.copy(),
            "first": self._first.copy(),
            "begin": self.begin.copy(),
            "slope": self.slope.copy(),
        }

    def load_state(self, state: Mapping[str, State]) -> None:
        """Take over samples and lines of the same inputs.  Raises ValueError or KeyError: no such."""
        for name, target in (
            ("memory", self._memory), ("first", self._first), ("begin", self.begin), ("slope", self.slope)
        ):  # fmt: skip
            copy_into(target, state[name])

    def find_late(self, period: int) -> float:
        """How long ago a step of so many base steps began [s]; 0 where it begins now."""
        grid = self._grid
        return round((grid.now.value - grid.start) / grid.step) % period * grid.step

    def describe(self, places: NDArray[np.intp], values: Array, part: Extension | None = None) -> Structure:
        """The lines as data: ``Lines`` of lines.h, of the inputs at some places of the ``values``, in a part of the
        component's step."""
        offset, length, slopes = (0.0, 0.0, None) if part is None else (part.offset, part.length, part.slopes)
        numbers = self._grid.start, self._grid.step, self._length, offset, length
        arrays = places, self._periods, self._ahead, values, slopes
        own = self._memory, self._first, self.begin, self.slope
        addresses = (None if array is None else array.ctypes.data for array in (*arrays, *own))
        return _Lines(len(self._first), int(self._smoothed), *numbers, *addresses)

    def look(self, values: Array) -> None:
        """Find the lines of the step that begins now, from the present values (inputs,) of the sources.

        Asked again in the same step, other values replace those before.
        """
        grid, now = self._grid, self._grid.now.value
        index = round((now - grid.start) / grid.step)
        times = grid.start + self._periods * ((index + self._ahead) // self._periods) * grid.step
        before, earlier, last, latest, end = self._memory
        unknown = np.isnan(last)
        last[unknown], latest[unknown] = now, self._first[unknown]
        fresh = times > last + 0.25 * grid.step
        before[fresh], earlier[fresh] = last[fresh], latest[fresh]
        last[fresh] = times[fresh]
        # Where the source has not gone on since the first look, the value at the beginning stays as it is.
        latest[:] = values
        span = np.where(np.isnan(before), np.inf, last - before)
        self.slope[:] = np.where(np.isnan(before), 0.0, (latest - np.where(np.isnan(before), 0.0, earlier)) / span)
        self.begin[:] = latest + self.slope * (now - last)
        if self._smoothed:
            goal = self.begin + self.slope * self._length
            self.begin[:] = np.where(np.isnan(end), self.begin, end)
            self.slope[:] = (goal - self.begin) / self._length
            end[:] = goal


@dataclass(frozen=True, eq=False)
class Extension:
    """Puts the lines of a history into the inputs of a part of the component's step.

    ``values`` (inputs,) are all gathered Reals, ``places`` those among them that the history has.  The part begins
    ``offset`` after the step and is ``length`` long [s].  With ``slopes`` the FMU gets value and slope, else the mean.
    """

    history: InputHistory
    values: Array
    places: NDArray[np.intp]
    offset: float
    length: float
    slopes: Array | None

    @property
    def address(self) -> int:
        """Of the same as data: ``Lines`` of lines.h."""
        return addressof(self._lines)

    @cached_property
    def _lines(self) -> Structure:
        return self.history.describe(self.places, self.values, self)

    def apply(self) -> None:
        """Replace the values, which are those of the sources now."""
        history, shift = self.history, self.offset
        if shift == 0.0:
            history.look(self.values[self.places])
        if self.slopes is None:
            shift += 0.5 * self.length
        else:
            self.slopes[:] = history.slope
        self.values[self.places] = history.begin + shift * history.slope
