"""Values on an equidistant time grid, read at any time by six-point Lagrange interpolation.

Its error for a sine at the fraction r of the sampling rate is at most 0.0049 (2 pi r)^6, that is 5e-6 at r = 1/20 and
3e-4 at r = 1/10.
"""

from __future__ import annotations

from ctypes import byref
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..mechanism.quantities import Array
from ..numerics import library
from ..numerics.library import find_address

_COLUMNS = 6  # of a table, as in tables.h


@dataclass(frozen=True)
class SampleTable:
    """Rows (n, 6) at start, start + 1/rate, ... (s, Hz); past its end the table begins again."""

    values: Array
    rate: float
    start: float = 0.0

    @property
    def end(self) -> float:
        """One grid step after the last row, s."""
        return self.start + self.values.shape[0] / self.rate

    @cached_property
    def words(self) -> library.Tables:
        """For compiled functions.  Raises ValueError for another number of columns."""
        if self.values.shape[1] != _COLUMNS:
            raise ValueError(f"a table of shape {self.values.shape}: expected {_COLUMNS} columns")
        values = np.ascontiguousarray(self.values, dtype=np.float64)
        words = library.Tables(find_address(values), None, len(values), 0, 0, self.start, self.rate)
        words.kept = values
        return words

    def __call__(self, time: Array) -> Array:
        """Rows at ascending times (k,), shape (k, 6).

        A time within 1e-6 grid steps of a grid point gets that point's row, bit for bit: common times of
        different step sizes then give equal values.  Raises ValueError for another number of columns.
        """
        time = np.ascontiguousarray(time, dtype=np.float64)
        found = np.zeros((time.size, _COLUMNS))
        library.find_arithmetic().add_rows(byref(self.words), find_address(time), time.size, find_address(found))
        return found
