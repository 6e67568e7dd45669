"""Rows as numbers, columns out of them, and the largest magnitude in them; who may read and write them in files.

The other files of this room take its compiled library from here, too.
"""

from __future__ import annotations

import threading
from collections.abc import Sequence
from ctypes import CDLL, addressof, c_char, c_double, c_int64, c_void_p
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..native import load

Array = NDArray[np.float64]

NETCDF_LOCK = threading.RLock()
"""Held in each call of netCDF4.  It lets other threads run meanwhile, and its libraries crash if one calls them."""

_TYPES = {"p": c_void_p, "n": c_int64, "x": c_double}
_FUNCTIONS = {
    "filter_rows": (None, "ppnp"),
    "thin_rows": (c_int64, "ppnp"),
    "copy_columns": (None, "pnnpnpn"),
    "complete_rows": (c_double, "pnnn"),
    "find_peak": (c_double, "pn"),
    "find_moments": (None, "pnnnp"),
    "widen_bins": (None, "pnnpp"),
    "add_values": (None, "pnxppp"),
    "weigh_hann": (None, "pnp"),
}
"""What each function returns and takes: p an address, n a whole number, x a double."""


@cache
def find_library() -> CDLL:
    """The library.  Raises NotCompiledError."""
    library = load("reduction")
    for name, (result, taken) in _FUNCTIONS.items():
        function = getattr(library, name)
        function.argtypes, function.restype = [_TYPES[kind] for kind in taken], result
    return library


def get_address(array: NDArray[Any]) -> int:
    """Where the numbers of an array begin; of two dimensions the second is contiguous.

    In an eighth of the time that ``array.ctypes`` takes, which adds up over blocks.
    """
    try:
        return addressof(c_char.from_buffer((array if array.ndim == 1 else array[0]).data))
    except (TypeError, ValueError, IndexError):  # read-only, or empty
        return int(array.ctypes.data)


class ColumnCopy:
    """Copies some columns out of rows, each side by side.

    Of 3 out of 94 columns, a row takes 0.003 us.

    Parameters
    ----------
    places: which columns
    columns: how many the rows have

    Raises ``ValueError`` for a place that is none of these.
    """

    def __init__(self, places: Sequence[int], columns: int) -> None:
        self._places = np.array(places, dtype=np.int64)
        self._columns = columns
        if len(places) and not 0 <= min(places) <= max(places) < columns:
            raise ValueError(f"places: expected 0 to {columns - 1}, got {min(places)} to {max(places)}")
        self._address: int = self._places.ctypes.data

    def run(self, rows: Array, result: Array) -> None:
        """Copy from ``rows`` (n, columns), contiguous, into ``result`` (places, n), of which each row is contiguous.

        Raises ``ValueError`` for arrays that do not fit.
        """
        if rows.dtype != np.float64 or rows.shape[1:] != (self._columns,) or not rows.flags.c_contiguous:
            raise ValueError(f"expected contiguous rows of {self._columns} doubles, got {rows.dtype} {rows.shape}")
        shape, (apart, beside) = (len(self._places), len(rows)), result.strides
        is_laid = not result.size or (beside == 8 and apart % 8 == 0 and apart >= 8 * len(rows))
        if result.dtype != np.float64 or result.shape != shape or not is_laid:
            raise ValueError(f"result: expected {shape} doubles, got {result.dtype} {result.shape} {result.strides}")
        if not result.size:  # numpy gives it other strides
            return
        chosen = self._address, len(self._places)
        goal = get_address(result), apart // 8
        find_library().copy_columns(get_address(rows), len(rows), self._columns, *chosen, *goal)


def find_peak(values: Array) -> float:
    """The largest magnitude of some numbers; NaN if one of them is infinite or none.  0 for none at all.

    A number takes 0.1 ns.
    """
    values = np.ascontiguousarray(values, dtype=np.float64)
    return float(find_library().find_peak(get_address(values), values.size))


def complete_rows(rows: Array, reals: int) -> float:
    """Make doubles of the C ints that lie behind ``reals`` columns of rows, in place; what :func:`find_peak` says.

    Each row (columns,) has them side by side, in the first half of the bytes that they need as doubles.  A row of 94
    columns takes 0.01 us.

    Raises ``ValueError`` for rows that are not contiguous, or have fewer columns.
    """
    if rows.dtype != np.float64 or rows.ndim != 2 or not rows.flags.c_contiguous or not 0 <= reals <= rows.shape[1]:
        raise ValueError(f"expected contiguous rows of {reals} doubles or more, got {rows.dtype} {rows.shape}")
    if not rows.size:
        return 0.0
    return float(find_library().complete_rows(get_address(rows), *rows.shape, reals))
