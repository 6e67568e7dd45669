"""The map of a step as the kernel multiplies it: blocks of rows, each with the columns in which it is not zero.

A dense matrix of a mechanism is half zeros, and larger than the first cache of a processor.  Rows are taken eight at a
time, as many doubles as the widest vector register has.  Neighbours with similar columns share a block, so that each
operand is fetched once for all of them.  What is left out are zeros, which change no bit of a sum.
"""

from __future__ import annotations

import ctypes
from ctypes import c_int64
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray

from .buffer import Array, allocate_aligned

LANES = 8
"""Rows taken together."""

_LARGEST = 8  # groups of rows in a block: their sums stay in registers
# Costs in units of a group with a column, as measured with registers of eight doubles (0.1 to 0.2 ns).  Half as much
# again would keep the map of FeedforwardIsolator whole, which takes 15 ns more than its three blocks.
_COLUMN = 1.0  # to fetch and test an operand
_BLOCK = 20.0  # to begin a block, and to store its results


class Words(ctypes.Structure):
    """The structure ``Block`` in ``native/kernel/core.h``."""

    _fields_ = (
        ("row", c_int64), ("n_rows", c_int64), ("column", c_int64), ("n_columns", c_int64), ("number", c_int64),
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class Pattern:
    """Where a matrix has blocks."""

    words: ctypes.Array[Words]
    columns: NDArray[np.int32]
    """Of all blocks, one block after the other."""
    numbers: NDArray[np.int64]
    """Places in a matrix by columns of the numbers that are multiplied."""

    @cached_property
    def addresses(self) -> tuple[int, int]:
        """Where ``words`` and ``columns`` begin in memory."""
        return ctypes.addressof(self.words), int(self.columns.__array_interface__["data"][0])


@dataclass(frozen=True, eq=False)
class Matrix:
    """A matrix by columns and, for the kernel, its blocks."""

    by_columns: Array
    """See :func:`store_by_columns`."""
    pattern: Pattern
    numbers: Array
    """Of the blocks."""

    @property
    def operations(self) -> int:
        """Multiplications of a product, where no operand is 0; rows beyond the matrix are counted, too."""
        return int(self.numbers.size)


def store_by_columns(matrix: Array) -> Array:
    """A matrix (m, n) as (n, stride): column by column, each on a cache line and padded with zeros.

    The kernel reads it so; numpy in the same order gives the same bits.
    """
    rows, columns = matrix.shape
    copy = allocate_aligned(columns, -(-rows // LANES) * LANES)
    copy[:, :rows] = matrix.T
    return copy


def make_blocks(by_columns: Array) -> Matrix:
    """The blocks of a matrix that :func:`store_by_columns` has stored."""
    n, stride = by_columns.shape
    used = (by_columns != 0.0).view(np.uint64) != 0  # eight Booleans at once: 4 us; any() takes 26
    pattern = find_pattern(used.tobytes(), n, stride // LANES)
    numbers = allocate_aligned(pattern.numbers.size)
    np.take(by_columns.reshape(-1), pattern.numbers, out=numbers, mode="clip")  # 4 us; with "raise" 12
    return Matrix(by_columns, pattern, numbers)


@lru_cache(maxsize=32)
def find_pattern(used: bytes, n: int, groups: int) -> Pattern:
    """Blocks of n columns by ``groups`` groups of rows, from whether each is used, column by column.

    Kept, since a matrix that is renewed in a slew mostly has the pattern that it had.
    """
    table = np.frombuffer(used, dtype=bool).reshape(n, groups)
    words, columns, numbers = [], [np.zeros(0, np.int64)], [np.zeros(0, np.int64)]
    for first, last in _join_groups(table):
        own = np.flatnonzero(table[:, first:last].any(axis=1))
        rows = np.arange(first * LANES, last * LANES)
        place = sum(map(len, columns)), sum(map(len, numbers))
        words.append(Words(first * LANES, rows.size, place[0], own.size, place[1]))
        columns.append(own)
        numbers.append((own[:, np.newaxis] * (groups * LANES) + rows).ravel())
    return Pattern((Words * len(words))(*words), np.concatenate(columns).astype(np.int32), np.concatenate(numbers))


def _join_groups(used: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """First and last of the groups of each block: the cheapest division of all groups into neighbours."""
    # The columns of a group are the digits of a number: 0.2 us to join two and to count, where arrays take 5.
    columns = [int.from_bytes(np.packbits(group).tobytes()) for group in used.T]
    best: list[tuple[float, list[tuple[int, int]]]] = [(0.0, [])]
    for last in range(1, len(columns) + 1):
        ways, joined = [], 0
        for first in range(last - 1, max(0, last - _LARGEST) - 1, -1):
            joined |= columns[first]
            cost, before = best[first]
            cost += _BLOCK + joined.bit_count() * (_COLUMN + last - first)
            ways.append((cost, [*before, (first, last)]))
        best.append(min(ways))
    return best[-1][1]
