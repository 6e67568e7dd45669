"""Statistics of signals: sums, extremes, counts in bins; weights of a Hann window, points outside of a polygon."""

from __future__ import annotations

import math
from ctypes import Structure, addressof, c_double, c_int64, c_void_p

import numpy as np
from numpy.typing import NDArray

from .columns import find_library, get_address

Array = NDArray[np.float64]


def find_moments(samples: Array) -> Array:
    """Mean, sum of the squared deviations from it, and largest magnitude of signals, (signals, 3).

    A value takes 0.4 ns.

    Parameters
    ----------
    samples: (signals, n), finite; copied unless those of a signal are contiguous

    Raises ``ValueError`` if there are none.
    """
    samples = _lay_side_by_side(samples)
    signals, count = samples.shape
    if not count:
        raise ValueError("samples: expected one at least")
    found = np.empty((signals, 3))
    find_library().find_moments(get_address(samples), signals, count, samples.strides[0] // 8, get_address(found))
    return found


def widen_bins(samples: Array, width: int, low: Array, high: Array) -> None:
    """Lower ``low`` and raise ``high`` to the extremes of ``width`` samples a bin, in place.

    A value takes 0.3 ns if the width is a power of two, else 3 ns.

    Parameters
    ----------
    samples: (signals, bins * width), finite; copied unless those of a signal are contiguous
    low, high: (signals, bins), those of a signal contiguous

    Raises ``ValueError`` for arrays that do not fit.
    """
    samples = _lay_side_by_side(samples)
    shape = samples.shape[0], samples.shape[1] // width
    for kept in (low, high):
        beside = kept.dtype == np.float64 and (kept.strides[-1] == 8 or not kept.size)
        if not beside or kept.shape != shape or shape[1] * width != samples.shape[1]:
            raise ValueError(f"expected {shape} contiguous bins of {width}, got {kept.dtype} {kept.shape}")
    if width & (width - 1):
        starts = np.arange(0, samples.shape[1], width)
        if len(starts):
            np.minimum(low, np.minimum.reduceat(samples, starts, axis=1), out=low)
            np.maximum(high, np.maximum.reduceat(samples, starts, axis=1), out=high)
        return
    library = find_library()
    for values, least, largest in zip(samples, low, high, strict=True):
        library.widen_bins(get_address(values), shape[1], width, get_address(least), get_address(largest))


def weigh_hann(phases: Array) -> Array:
    """Weights ``1 - cos(2 pi p)`` of a Hann window at phases (n,) in turns, finite and below 1e15.

    A phase takes 1 ns.
    """
    phases = np.ascontiguousarray(phases, dtype=np.float64)
    weights = np.empty_like(phases)
    find_library().weigh_hann(get_address(phases), len(phases), get_address(weights))
    return weights


def _lay_side_by_side(rows: Array) -> Array:
    """Doubles (k, n), those of each row contiguous: as they are, or a copy."""
    if rows.dtype == np.float64 and rows.strides[1] == 8 and rows.strides[0] % 8 == 0:
        return rows
    return np.array(rows, dtype=np.float64, order="C")


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
