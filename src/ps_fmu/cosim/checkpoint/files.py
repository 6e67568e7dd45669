"""The files of checkpoints, each complete or not there, and the journals of rows that only grow in number.

A checkpoint is a line with the format, the length of the state and a checksum, the state as MessagePack, and behind it
the bytes of the arrays, little endian.  An array in the state is an extension of type 1: dtype, shape, whether it lies
column by column, and where its bytes begin behind the state.  A file may come from anywhere: nothing in it is executed,
and no size in it is believed.

A journal has its rows in parts of :data:`PART_ROWS` at most.  A part is the number of its rows as int64, for each
column a byte that is 1 if its numbers differ, zeros up to a multiple of 8 bytes, then for each column its numbers,
float64, or the one that they all are; all little endian.  A checkpoint says how many of the bytes are its own, and
their checksum; what lies behind them, of after the checkpoint, is cut off when the run is resumed.
"""

from __future__ import annotations

import logging
import math
import os
import re
import zlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from time import perf_counter
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from .state import Array, CheckpointError, DamagedCheckpointError, State

log = logging.getLogger("ps_fmu.cosim")

Words = NDArray[np.uint64]

GENERATIONS = 2
"""So many checkpoints stay: there is one whatever happens to the other."""
DTYPES = ("<f8", "<i8", "<i4", "|b1", "|u1")
"""Those of arrays that a checkpoint can hold."""
PART_ROWS = 2**16
"""A part of a journal has so many rows at most, whatever a damaged file says."""
_HEAD = b"ps_fmu checkpoint 3 %d %08x\n"
_ARRAY = 1
_NAME = re.compile(r"row-(\d{1,18})\.msgpack")
_BEGUN = ".begun.part"  # the file that is written and then gets its name


def write_file(path: Path, tree: Mapping[str, State]) -> None:
    """Write a checkpoint so that ``path`` is complete or not there.  Raises OSError; nothing is left then."""
    arrays = _Arrays()
    content = msgspec.msgpack.encode(tree, enc_hook=arrays.encode)
    checksum = 0
    for part in (content, *arrays.parts):
        checksum = zlib.crc32(part, checksum)
    begun = path.with_name(_BEGUN)
    try:
        begun.unlink(missing_ok=True)  # it may be a link to anywhere
        with begun.open("xb") as file:
            file.write(_HEAD % (len(content), checksum))
            file.write(content)
            file.writelines(arrays.parts)
            file.flush()
            os.fsync(file.fileno())
        begun.replace(path)
    except BaseException:
        begun.unlink(missing_ok=True)
        raise
    sync_folder(path.parent)


def read_file(path: Path) -> dict[str, State]:
    """The state in a checkpoint.  Raises :class:`CheckpointError` for a file that is none, or is damaged."""
    if path.exists() and not path.is_file():  # a pipe may never end
        raise CheckpointError(f"{path}: is a folder, pipe or device: expected the file of a checkpoint")
    try:
        head, _, content = path.read_bytes().partition(b"\n")
        size = int(head.split(b" ")[-2] if head.count(b" ") > 1 else 0)
        if head + b"\n" != _HEAD % (size, zlib.crc32(content)) or not 0 <= size <= len(content):
            raise ValueError("its format or its checksum is wrong")
        data = memoryview(content)
        tree = msgspec.msgpack.decode(data[:size], ext_hook=lambda code, place: _decode(code, place, data[size:]))
        if not isinstance(tree, dict):
            raise ValueError("expected named values")
    except OSError as error:
        raise CheckpointError(f"{path}: cannot be read: {error.strerror or error}") from error
    except (ValueError, TypeError, OverflowError, RecursionError, MemoryError) as error:
        raise DamagedCheckpointError(path, f"is not a checkpoint, or is damaged: {error}") from error
    return tree


def sync_folder(folder: Path) -> None:
    """Have the names in a folder on the disk, where the system can."""
    try:
        handle = os.open(folder, os.O_RDONLY)
    except OSError:  # Windows has no such handles
        return
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


class _Arrays:
    """Puts arrays behind the state, so that none is copied."""

    def __init__(self) -> None:
        self.parts: list[Any] = []
        self._size = 0

    def encode(self, value: Any) -> Any:
        """What MessagePack does not know."""
        if isinstance(value, np.generic):
            return value.item()
        if isinstance(value, Mapping):
            return dict(value)
        if not isinstance(value, np.ndarray):
            raise TypeError(f"a checkpoint cannot store a {type(value).__name__}")
        columns = value.flags.f_contiguous and not value.flags.c_contiguous  # numpy sums in the order of the memory
        dtype = value.dtype.newbyteorder("<")
        if dtype.str not in DTYPES:
            raise TypeError(f"a checkpoint cannot store an array of {value.dtype}")
        place = msgspec.msgpack.encode((dtype.str, value.shape, columns, self._size))
        if value.size:
            laid = np.ascontiguousarray(value.T if columns else value, dtype)
            self.parts.append(laid.reshape(-1).view(np.uint8).data)
            self._size += value.nbytes
        return msgspec.msgpack.Ext(_ARRAY, place)


def _decode(code: int, place: memoryview, arrays: memoryview) -> State:
    if code != _ARRAY:
        raise ValueError(f"an extension of type {code}")
    dtype, shape, columns, begin = msgspec.msgpack.decode(place, type=tuple[str, tuple[int, ...], bool, int])
    if dtype not in DTYPES or min(shape, default=0) < 0 or begin < 0:
        raise ValueError(f"an array of {dtype!r} and the shape {shape}; expected one of {', '.join(DTYPES)}")
    size = math.prod(shape) * np.dtype(dtype).itemsize
    found = np.frombuffer(arrays[begin : begin + size], dtype).reshape(shape, order="F" if columns else "C")
    return found.astype(found.dtype.newbyteorder("="))


class CheckpointFolder:
    """The checkpoints of a run by the number of their row, ``row-000000120000.msgpack``; journals, ``rows-0.bin``."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def write(self, index: int, tree: Mapping[str, State]) -> Path:
        """Write a checkpoint; of those before, all but the last make room.  Raises OSError: they are there then."""
        self.path.mkdir(parents=True, exist_ok=True)
        path = self.path / f"row-{index:012d}.msgpack"
        write_file(path, tree)
        for old in self.list_files()[GENERATIONS:]:
            old.unlink(missing_ok=True)
        return path

    def list_files(self) -> list[Path]:
        """The files of checkpoints, the newest first."""
        if not self.path.is_dir():
            return []
        found = {path: match for path in self.path.iterdir() if (match := _NAME.fullmatch(path.name))}
        return sorted(found, key=lambda path: -int(found[path][1]))

    def read(self) -> tuple[Path, dict[str, State]] | None:
        """The newest checkpoint that is whole; None if there is none.

        Raises :class:`CheckpointError` if all are damaged.
        """
        files = self.list_files()
        for path in files:
            try:
                return path, read_file(path)
            except CheckpointError as error:
                if path == files[-1]:
                    raise
                log.warning("%s; the checkpoint before it is used", error)
        return None

    def open_journal(self, place: int, width: int, kept: Mapping[str, State] | None) -> Journal:
        """The journal of the observer at a place, begun, or gone on with.  Raises :class:`CheckpointError`."""
        self.path.mkdir(parents=True, exist_ok=True)
        return Journal(self.path / f"rows-{place}.bin", width, kept)

    def clear(self) -> None:
        """Remove all checkpoints and journals, as of an earlier run."""
        self._remove(self.list_files())

    def leave_last(self) -> None:
        """Remove what only a run that goes on needs: the journals and all checkpoints but the last."""
        self._remove(self.list_files()[1:])

    def _remove(self, files: list[Path]) -> None:
        for path in [*files, *self.path.glob("rows-*.bin"), self.path / _BEGUN]:
            path.unlink(missing_ok=True)


class Journal:
    """Rows of ``width`` numbers in a file, written anew, or gone on with from what a checkpoint says of it.

    They lie column by column, as a recorder has them, and a column that does not change is one number.
    A journal that cannot be written, as on a full disk, takes no more rows: the run goes on without checkpoints.

    Raises :class:`CheckpointError`: the rows of the checkpoint are not there.
    """

    def __init__(self, path: Path, width: int, kept: Mapping[str, State] | None = None) -> None:
        self.path, self.width = path, width
        self.failure: OSError | None = None
        """Why it takes no more rows."""
        self.spent_s = 0.0
        """Time that the rows have taken [s]."""
        self._bytes = self._sum = 0
        try:
            self._file = path.open("w+b" if kept is None else "r+b", buffering=0)
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
            for first in range(0, len(rows), PART_ROWS):
                words = _lay_out(rows[first : first + PART_ROWS])
                left = words.data.cast("B")
                while left:  # at once: a write for each column would take twice as long
                    left = left[self._file.write(left) :]
                self._bytes += words.nbytes
                self._sum = _add(self._sum, words)
        except OSError as error:
            self.failure = error
            log.warning("%s: %s: no more checkpoints are written", self.path, error.strerror or error)
        self.spent_s += perf_counter() - began

    def sync(self) -> dict[str, State]:
        """Have all rows on the disk; what a checkpoint says of them.  Raises OSError."""
        if self.failure is not None:
            raise self.failure
        os.fsync(self._file.fileno())
        return {"width": self.width, "bytes": self._bytes, "sum": self._sum}

    def read(self) -> Iterator[Array]:
        """All rows so far, part by part."""
        for count, differs, words in self._read_parts():
            ends = np.cumsum(np.where(differs, count, 1))
            numbers = words[len(words) - ends[-1] :].view("<f8")
            rows = np.empty((self.width, count))
            for column, own in zip(rows, np.split(numbers, ends[:-1]), strict=True):
                column[:] = own
            yield rows.T

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def _read_parts(self) -> Iterator[tuple[int, NDArray[np.bool_], Words]]:
        """Rows of each part, which columns differ in it, and all its words.  Raises EOFError: the file ends before."""
        with self.path.open("rb") as file:
            while (begin := file.tell()) < self._bytes:
                head = np.fromfile(file, "<u8", 1 + -(-self.width // 8))
                differs = head[1:].view(np.uint8)[: self.width] == 1
                count = int(head[0]) if len(differs) == self.width else 0
                size = len(head) + int(np.where(differs, count, 1).sum())
                if not 0 < count <= PART_ROWS or begin + 8 * size > self._bytes:
                    raise EOFError
                words = np.concatenate((head, np.fromfile(file, "<u8", size - len(head))))
                if len(words) < size:
                    raise EOFError
                yield count, differs, words

    def _go_on(self, kept: Mapping[str, State]) -> None:
        size, width, checksum = (kept.get(name) for name in ("bytes", "width", "sum"))
        if width != self.width or type(size) is not int or size < 0:
            raise CheckpointError(f"{self.path}: expected rows of {self.width} numbers, the checkpoint has {width!r}")
        self._bytes = size
        try:
            for _, _, words in self._read_parts():
                self._sum = _add(self._sum, words)
        except EOFError:
            raise self._make_damaged(f"ends within the {size} bytes of the checkpoint, or is damaged") from None
        if self._sum != checksum:
            raise self._make_damaged("is damaged: the checksum of its rows is wrong")
        self._file.truncate(size)
        self._file.seek(0, os.SEEK_END)

    def _make_damaged(self, what: str) -> CheckpointError:
        return DamagedCheckpointError(self.path, f"{what}: start the run again")


def _lay_out(rows: Array) -> Words:
    """What a journal has of some rows (rows, width), one row at least."""
    columns = np.asarray(rows, "<f8").T.view("<u8")
    differs = np.zeros(8 * -(-len(columns) // 8), dtype=np.uint8)
    differs[: len(columns)] = (columns[:, :1] != columns[:, [-1, len(rows) // 2]]).any(axis=1)
    for place in np.flatnonzero(differs[: len(columns)] == 0):  # where these three are the same, look at all
        differs[place] = (columns[place] != columns[place, 0]).any()
    chosen = [column if every else column[:1] for column, every in zip(columns, differs, strict=False)]
    return np.concatenate((np.array([len(rows)], dtype="<u8"), differs.view("<u8"), *chosen))


def _add(checksum: int, words: Words) -> int:
    """The sum of all words modulo 2^64: a seventh of the time of a CRC-32, and another one for another run."""
    return (checksum + int(words.sum())) % 2**64
