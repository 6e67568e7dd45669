"""Rows that only ever grow in number: a file of blocks, in which each column is stored by itself, in 8-byte words.

A block begins with the number of its rows, and a byte for each column, 1 where all rows have one value, filled up with
zeros to whole words.  Then come the values of these columns, then the other ones, column by column: float64, little
endian.  In a run of the default scenario 42 of 95 columns keep their value.

A checkpoint says how many of the rows are its own, and the checksum of their blocks.  What lies behind them, of after
the checkpoint, is cut off when the run is resumed.
"""

from __future__ import annotations

import logging
import os
from collections.abc import Iterator, Mapping
from io import FileIO
from pathlib import Path
from time import perf_counter
from typing import BinaryIO, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .state import Array, CheckpointError, DamagedCheckpointError, State

log = logging.getLogger("ps_fmu.cosim")

Words = NDArray[np.uint64]

MOST_BLOCK_BYTES = 2**22
"""Rows of a block would have so many bytes at most: one that is made up cannot fill the memory."""
FACTOR = 3
"""The checksum of a block is the sum of its words, and so many times the checksum before it, modulo 2^64.

It takes a seventh of the time of a CRC-32, and tells the blocks of one run from those of another.
"""
_GLANCE = 64  # of so many rows one shows of most columns that they change
_MOST_PIECES = 512  # of memory that are written at once; 1024 are possible on Linux


class Journal:
    """Rows of ``width`` numbers in a file, written anew, or gone on with from what a checkpoint says of it.

    A journal that cannot be written, as on a full disk, takes no more rows: the run goes on without checkpoints.

    Raises :class:`CheckpointError`: the rows of the checkpoint are not there.
    """

    def __init__(self, path: Path, width: int, kept: Mapping[str, State] | None = None) -> None:
        self.path, self.width = path, width
        self.failure: OSError | None = None
        """Why it takes no more rows."""
        self.spent_s = 0.0
        """Time that the rows have taken [s]."""
        self._rows = self._checksum = 0
        self._most_rows = max(1, MOST_BLOCK_BYTES // (8 * width))
        try:
            self._file = FileIO(path, "w+" if kept is None else "r+")
            if kept is not None:
                self._go_on(kept)
        except OSError as error:
            if isinstance(error, CheckpointError):
                raise
            if isinstance(error, FileNotFoundError):
                raise self._make_damaged(f"rows of the checkpoint: {error.strerror}") from error
            raise CheckpointError(f"{path}: rows of the checkpoint: {error.strerror or error}") from error

    def append(self, rows: Array) -> None:
        """Add rows (rows, width); once it is closed they are in no checkpoint, and left out."""
        if self.failure is not None or self._file.closed:
            return
        began = perf_counter()
        try:
            for first in range(0, len(rows), self._most_rows):
                self._append(rows[first : first + self._most_rows])
        except OSError as error:
            self.failure = error
            log.warning("%s: %s: no more checkpoints are written", self.path, error.strerror or error)
        self.spent_s += perf_counter() - began

    def sync(self) -> dict[str, State]:
        """Have all rows on the disk; what a checkpoint says of them.  Raises OSError."""
        if self.failure is not None:
            raise self.failure
        os.fsync(self._file.fileno())
        return {"width": self.width, "rows": self._rows, "sum": self._checksum}

    def read(self) -> Iterator[Array]:
        """All rows so far, some thousand at a time."""
        left = self._rows
        with self.path.open("rb") as file:
            while left:
                block = self._read_block(file)
                yield block.unpack()
                left -= block.rows

    def close(self) -> None:
        """Close the file."""
        try:
            self._file.close()
        except OSError as error:
            log.warning("%s: %s", self.path, error.strerror or error)

    def _append(self, rows: Array) -> None:
        pieces, total = _pack(rows)
        _write(self._file.fileno(), [piece.view(np.uint8).data for piece in pieces])
        self._checksum = _add(self._checksum, total)
        self._rows += len(rows)

    def _go_on(self, kept: Mapping[str, State]) -> None:
        rows, width, checksum = (kept.get(name) for name in ("rows", "width", "sum"))
        if width != self.width or type(rows) is not int or rows < 0:
            raise CheckpointError(f"{self.path}: expected rows of {self.width} numbers, the checkpoint has {width!r}")
        try:
            while self._rows < rows:
                block = self._read_block(self._file)
                self._rows += block.rows
                self._checksum = _add(self._checksum, int(block.words.sum()))
        except EOFError:
            raise self._make_damaged(f"ends before the {rows} rows of the checkpoint") from None
        except ValueError as error:
            raise self._make_damaged(f"is damaged: {error}") from error
        if self._rows != rows or self._checksum != checksum:
            raise self._make_damaged(f"is damaged: the checksum of its {rows} rows does not fit")
        end = self._file.tell()
        self._file.truncate(end)
        self._file.seek(end)

    def _make_damaged(self, what: str) -> CheckpointError:
        return DamagedCheckpointError(self.path, f"{what}: the run cannot go on, begin it anew")

    def _read_block(self, file: BinaryIO | FileIO) -> _Block:
        """The next block.  Raises EOFError, and ValueError for one that is made up."""
        head = _read_words(file, 1 + _count_words(self.width))
        rows, flags = int(head[0]), head[1:].view(np.uint8)
        if not 1 <= rows <= self._most_rows or flags.max() > 1 or flags[self.width :].any():
            raise ValueError(f"a block of {rows} rows, expected 1 to {self._most_rows}")
        keeps = flags[: self.width].astype(np.bool_)
        same = int(keeps.sum())
        values = _read_words(file, same + (self.width - same) * rows)
        return _Block(rows, keeps, np.concatenate((head, values)))


class _Block(NamedTuple):
    """What a file has of some rows."""

    rows: int
    keeps: NDArray[np.bool_]
    """(width,) True for columns with one value."""
    words: Words

    def unpack(self) -> Array:
        """The rows (rows, width)."""
        width, same = len(self.keeps), int(self.keeps.sum())
        values = self.words[1 + _count_words(width) :].view("<f8")
        found = np.empty((width, self.rows))
        found[self.keeps] = values[:same, None]
        found[~self.keeps] = values[same:].reshape(width - same, self.rows)
        return found.T


def _pack(rows: Array) -> tuple[list[Words], int]:
    """The block of rows (rows, width), in pieces, and the sum of its words modulo 2^64.

    Where the values of each column lie side by side, they are not copied: 20,000 rows take 2.8 ms instead of 4.8.
    """
    count, width = rows.shape
    columns = np.asarray(rows, dtype="<f8").T.view("<u8")  # also numbers that are not equal to themselves
    if columns.strides[1] != columns.itemsize:
        columns = np.ascontiguousarray(columns)
    first = columns[:, 0]
    keeps = (columns[:, ::_GLANCE] == first[:, None]).all(axis=1)
    for place in np.flatnonzero(keeps).tolist():
        keeps[place] = (columns[place] == first[place]).all()
    flags = np.zeros(8 * _count_words(width), np.uint8)
    flags[:width] = keeps
    head = np.concatenate((np.array([count], "<u8"), flags.view("<u8"), first[keeps]))
    total = int(head.sum()) + int(columns.sum()) - count * int(first[keeps].sum())
    return [head, *(columns[place] for place in np.flatnonzero(~keeps).tolist())], total % 2**64


def _write(file: int, pieces: list[memoryview]) -> None:
    """Write all bytes of some pieces of memory, one behind the other."""
    place = 0
    while place < len(pieces):
        some = pieces[place : place + _MOST_PIECES]
        written = os.writev(file, some) if hasattr(os, "writev") else os.write(file, some[0])  # as on Windows
        while place < len(pieces) and written >= len(pieces[place]):
            written -= len(pieces[place])
            place += 1
        if written:
            pieces[place] = pieces[place][written:]


def _count_words(width: int) -> int:
    """Words of the flags of so many columns."""
    return -(-width // 8)


def _add(checksum: int, total: int) -> int:
    return (FACTOR * checksum + total) % 2**64


def _read_words(file: BinaryIO | FileIO, count: int) -> Words:
    data = file.read(8 * count)
    if len(data) < 8 * count:
        raise EOFError
    return np.frombuffer(data, "<u8")
