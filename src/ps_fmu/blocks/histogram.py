"""Counts of values in bins whose edges have one ratio."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from .library import find_library

Array = NDArray[np.float64]


class LogarithmicBins:
    """Bins from 0 to the first edge, then between edges that have one ratio, then all that is above the last of these.

    A value belongs to the first bin whose upper edge is not below it.  To count one takes 4 ns, compiled; in numpy
    70 ns.

    Parameters
    ----------
    lowest, highest: decades of the first and the last edge, in the unit of :meth:`count`
    per_decade: bins in a decade
    """

    def __init__(self, lowest: int, highest: int, per_decade: int) -> None:
        places = np.arange(lowest * per_decade, highest * per_decade + 1)
        self.edges: Array = np.append(10.0 ** (places / per_decade), math.inf)
        """(bins,) upper edges."""
        self._per_octave = per_decade * math.log10(2.0)

    def count(self, values: Array, unit: float, counts: NDArray[np.int64]) -> None:
        """Add the values (n,), at least 0, to ``counts`` (bins,); ``unit`` is what the edges are multiples of."""
        library = find_library()
        if library is None:
            counts += np.bincount(np.searchsorted(self.edges, values / unit), minlength=len(counts))
            return
        values = np.ascontiguousarray(values, dtype=np.float64)
        if counts.shape != self.edges.shape or counts.dtype != np.int64 or not counts.flags.c_contiguous:
            raise ValueError(f"counts: expected {len(self.edges)} contiguous int64, got {counts.dtype} {counts.shape}")
        edges, bins = self.edges.ctypes.data, len(self.edges)
        library.count_values(values.ctypes.data, len(values), unit, edges, bins, self._per_octave, counts.ctypes.data)
