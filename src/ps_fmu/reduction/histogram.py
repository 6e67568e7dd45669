"""Counts of values in bins whose edges have one ratio, and their sums."""

from __future__ import annotations

import math
from ctypes import Structure, addressof, c_double, c_int64, c_void_p

import numpy as np
from numpy.typing import NDArray

from .library import find_library, get_address

Array = NDArray[np.float64]


class Totals(Structure):
    """``Totals`` of histogram.c: of all values that were added."""

    _fields_ = (("sum", c_double), ("squares", c_double), ("peak", c_double))
    sum: float
    squares: float
    """Sum of the squares, in unit^2."""
    peak: float
    """Largest magnitude."""


class _Bins(Structure):
    """``Bins`` of histogram.c."""

    _fields_ = (("edges", c_void_p), ("bins", c_int64), ("per_octave", c_double))


class LogarithmicBins:
    """Bins from 0 to the first edge, then between edges that have one ratio, then all that is above the last of these.

    A value belongs to the first bin whose upper edge is not below its magnitude.  To add one takes 3 ns.

    Parameters
    ----------
    lowest, highest: decades of the first and the last edge, in the unit of :meth:`add`
    per_decade: bins in a decade, up to 3000
    """

    def __init__(self, lowest: int, highest: int, per_decade: int) -> None:
        places = np.arange(lowest * per_decade, highest * per_decade + 1)
        self.edges: Array = np.append(10.0 ** (places / per_decade), math.inf)
        """(bins,) upper edges."""
        self._bins = _Bins(self.edges.ctypes.data, len(self.edges), per_decade * math.log10(2.0))

    def add(self, values: Array, unit: float, counts: NDArray[np.int64], totals: Totals) -> None:
        """Add values (n,), finite, to ``counts`` (bins,) and ``totals``; edges are multiples of ``unit``.

        Raises ``ValueError`` for counts that do not fit.
        """
        values = np.ascontiguousarray(values, dtype=np.float64)
        if counts.shape != self.edges.shape or counts.dtype != np.int64 or not counts.flags.c_contiguous:
            raise ValueError(f"counts: expected {len(self.edges)} contiguous int64, got {counts.dtype} {counts.shape}")
        goal = addressof(self._bins), get_address(counts), addressof(totals)
        find_library().add_values(get_address(values), values.size, unit, *goal)
