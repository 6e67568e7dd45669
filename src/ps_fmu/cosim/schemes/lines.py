"""Inputs that go on along lines, where faults or conversions change these: values and slopes apart.

``native/lines.h`` does the same in C, with the same results to the last bit.

Faults act on the line, once in a base step: on its value where the step begins, and on its slope.  So what is
overridden has that value all the step long, and noise is no larger than is asked for.  Extrapolated from faulty values,
a jump would go beyond its end, and noise would grow.  Lines are found in the unit of the source, as faults of outputs
are.
"""

from __future__ import annotations

from ctypes import Structure, addressof, c_double, c_int64, c_void_p
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..plan import Change
from ..rows import Array
from .history import InputHistory


class _LineStart(Structure):
    """``LineStart`` of lines.h."""

    _fields_ = (("lines", c_void_p), ("slopes", c_void_p), ("period", c_int64))


class _LineEnd(Structure):
    """``LineEnd`` of lines.h."""

    _fields_ = (
        *((name, c_int64) for name in ("count", "first")),
        *((name, c_void_p) for name in ("places", "line", "values", "slopes")),
        ("shift", c_double),
        ("derivatives", c_void_p),
    )


@dataclass(frozen=True, eq=False)
class LineStart:
    """Finds value and slope at the beginning of a base step.

    ``values`` and ``slopes`` (inputs,) are of all gathered Reals, ``places`` those among them that the history has;
    ``period``: base steps in a step of the component, in whose first one the line is found, and goes on in the others.
    """

    history: InputHistory
    values: Array
    slopes: Array
    places: NDArray[np.intp]
    period: int

    def apply(self) -> None:
        """Replace the values, which are those of the sources now."""
        history, places = self.history, self.places
        late = history.find_late(self.period)
        if not late:
            history.look(self.values[places])
        self.values[places] = history.begin + late * history.slope if late else history.begin
        self.slopes[places] = history.slope

    def make_change(self) -> Change:
        """The same as a part of a plan."""
        return Change(self.apply, "start_lines", addressof(self._native))

    @cached_property
    def _native(self) -> _LineStart:
        return _LineStart(addressof(self._lines), self.slopes.ctypes.data, self.period)

    @cached_property
    def _lines(self) -> Structure:
        return self.history.describe(self.places, self.values)


@dataclass(frozen=True, eq=False)
class LineEnd:
    """Puts the lines into the inputs of a part of the component's step, ``shift`` [s] after its beginning.

    ``line``: the values at the beginning, which the first part finds among the ``values``; ``derivatives``: where the
    slopes go for an FMU that interpolates, else None.
    """

    line: Array
    values: Array
    slopes: Array
    places: NDArray[np.intp]
    first: bool
    shift: float
    derivatives: Array | None

    def apply(self) -> None:
        """Replace the values."""
        if self.first:
            self.line[:] = self.values[self.places]
        slopes = self.slopes[self.places]
        self.values[self.places] = self.line + self.shift * slopes
        if self.derivatives is not None:
            self.derivatives[:] = slopes

    def make_change(self) -> Change:
        """The same as a part of a plan."""
        return Change(self.apply, "end_lines", addressof(self._native))

    @cached_property
    def _native(self) -> _LineEnd:
        every = self.places, self.line, self.values, self.slopes, self.derivatives
        *arrays, derivatives = (None if array is None else array.ctypes.data for array in every)
        return _LineEnd(len(self.places), int(self.first), *arrays, self.shift, derivatives)
