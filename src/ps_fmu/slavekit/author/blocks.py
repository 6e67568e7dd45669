"""The map of a step as the kernel multiplies it: blocks of rows, each with the columns in which it is not zero.

A dense matrix of a mechanism is half zeros, and larger than the first cache of a processor.  Rows are taken eight at a
time, as many doubles as the widest vector register has.  Neighbours with similar columns share a block, so that each
operand is fetched once for all of them.  What is left out are zeros, which change no bit of a sum.
"""

from __future__ import annotations

import ctypes
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...numerics.library import LANES, MapWords, Room, find_library
from .buffer import Array, allocate_aligned

Matrices = tuple[Array, Array, Array, Array]
"""A, B, C, D of a linear system."""


@dataclass(frozen=True, eq=False)
class Matrix:
    """A matrix by columns and, for the kernel, its blocks."""

    by_columns: Array
    """See :func:`store_by_columns`."""
    blocks: NDArray[np.int64]
    """As ``Block`` of ``native/kernel/core.h``: first row, rows, first of ``columns``, columns, of ``numbers``."""
    columns: NDArray[np.int32]
    """Of all blocks, one block after the other."""
    numbers: Array
    """Of the blocks: that many are multiplied where no operand is 0; rows beyond the matrix are counted, too."""


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
    room, words = Room(n, stride // LANES), MapWords()
    address, given = by_columns.__array_interface__["data"][0], map(ctypes.byref, (room, words))
    size = find_library().make_blocks(address, n, stride, *given)
    blocks, columns, numbers = room.arrays[0][: words.n_blocks], *room.arrays[1:3]
    return Matrix(by_columns, blocks, columns[: blocks[:, 3].sum()], numbers[:size])
