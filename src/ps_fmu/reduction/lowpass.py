"""A low-pass on the columns of rows that keeps each m-th of them, also of rows that come in parts."""

from __future__ import annotations

from ctypes import Structure, addressof, c_int64, c_void_p

import numpy as np
from numpy.typing import NDArray

from .columns import find_library, get_address

Array = NDArray[np.float64]

OUTPUTS = 4
"""Rows that come out together, as in filter.c."""


class _Filter(Structure):
    """``Lowpass`` of filter.c."""

    _fields_ = (("columns", c_int64), ("factor", c_int64), ("length", c_int64), ("taps", c_void_p), ("room", c_void_p))


class _Thinning(Structure):
    """``Thinning`` of filter.c."""

    _fields_ = (
        ("filter", c_void_p),
        ("sampled", c_void_p),
        ("n_sampled", c_int64),
        ("waiting", c_void_p),
        ("count", c_int64),
    )


class Lowpass:
    """``y[k] = sum_j h[j] x[k m + j]`` for each column, summed in the order of j, each operation rounded.

    So a number does not depend on which rows and columns are filtered together.  A column that rests is filtered once.
    94 columns cost 0.04 us a row for 63 taps and m = 5 with AVX-512, 0.02 us if all rest.

    Parameters
    ----------
    taps: h (length,)
    factor: m, at least 1
    columns: how many there are
    """

    def __init__(self, taps: Array, factor: int, columns: int) -> None:
        self.taps, self.factor, self.columns = taps, factor, columns
        zeros = np.zeros((OUTPUTS - 1) * factor)
        self._padded = np.concatenate((zeros, taps, zeros))
        self._room = np.empty(2 * columns, dtype=np.int64)
        addresses = self._padded[len(zeros) :].ctypes.data, self._room.ctypes.data
        self._filter = _Filter(columns, factor, len(taps), *addresses)
        self.address = addressof(self._filter)
        """Of what C needs."""

    def count(self, rows: int) -> int:
        """How many rows come out of so many."""
        return max(0, (rows - len(self.taps)) // self.factor + 1)

    def run(self, rows: Array, result: Array) -> None:
        """Filter ``rows`` (n, columns) into ``result`` (k, columns), k at most :meth:`count` of n.

        Both are contiguous and finite.  Raises ``ValueError`` for arrays that do not fit.
        """
        for array in (rows, result):
            _check_rows(array, self.columns)
        if len(result) > self.count(len(rows)):
            raise ValueError(f"{len(rows)} rows make {self.count(len(rows))}, not {len(result)}")
        if len(result) == 0:
            return
        find_library().filter_rows(self.address, get_address(rows), len(result), get_address(result))


class Thinning:
    """A :class:`Lowpass` on rows that come in parts; some columns are sampled in the middle of its window instead.

    The result does not depend on how the rows are cut.  To begin with, :attr:`waiting` is set.

    Parameters
    ----------
    taps: (length,), an odd number
    factor: m, less than there are taps
    sampled: (columns,) True for those that are sampled

    Raises ``ValueError`` for other taps.
    """

    def __init__(self, taps: Array, factor: int, sampled: NDArray[np.bool_]) -> None:
        if len(taps) % 2 == 0 or len(taps) <= factor:
            raise ValueError(f"taps: expected an odd number above {factor}, got {len(taps)}")
        self._lowpass = Lowpass(taps, factor, len(sampled))
        self._room = np.empty((2 * len(taps) + factor, len(sampled)))
        self._sampled = np.flatnonzero(sampled).astype(np.int64)
        places = self._sampled.ctypes.data, len(self._sampled)
        self._thinning = _Thinning(self._lowpass.address, *places, self._room.ctypes.data, 0)
        self._address = addressof(self._thinning)

    @property
    def waiting(self) -> Array:
        """(n, columns) rows from the begin of the next window on, less than there are taps; valid until a push."""
        return self._room[: self._thinning.count]

    @waiting.setter
    def waiting(self, rows: Array) -> None:
        _check_rows(rows, self._lowpass.columns)
        if len(rows) >= len(self._lowpass.taps):
            raise ValueError(f"expected less than {len(self._lowpass.taps)} rows, got {len(rows)}")
        self._room[: len(rows)] = rows
        self._thinning.count = len(rows)

    def push(self, rows: Array) -> Array:
        """Take the next rows (n, columns), contiguous and finite; the rows that come out.

        Raises ``ValueError`` for rows that do not fit.
        """
        _check_rows(rows, self._lowpass.columns)
        result = np.empty((self._lowpass.count(self._thinning.count + len(rows)), self._lowpass.columns))
        find_library().thin_rows(self._address, get_address(rows), len(rows), get_address(result))
        return result


def _check_rows(rows: Array, columns: int) -> None:
    if rows.dtype != np.float64 or rows.shape[1:] != (columns,) or not rows.flags.c_contiguous:
        raise ValueError(f"expected contiguous rows of {columns} doubles, got {rows.dtype} {rows.shape}")
