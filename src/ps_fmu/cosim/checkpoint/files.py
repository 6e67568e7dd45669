"""The files of checkpoints, each complete or not there, and the journals of rows that only grow in number.

A checkpoint is a line with the format and a checksum, and the state as MessagePack; an array in it is an extension of
type 1: dtype, shape, whether it lies column by column, and its bytes, little endian.  A file may come from anywhere:
nothing in it is executed, and no size in it is believed.

A journal is float64 after float64, little endian, row by row.  A checkpoint says how many of the rows are its own, and
their checksum; what lies behind them, of after the checkpoint, is cut off when the run is resumed.
"""

from __future__ import annotations

import logging
import os
import re
import zlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from time import perf_counter
from typing import Any

import msgspec
import numpy as np

from .state import Array, CheckpointError, DamagedCheckpointError, State

log = logging.getLogger("ps_fmu.cosim")

GENERATIONS = 2
"""So many checkpoints stay: there is one whatever happens to the other."""
DTYPES = ("<f8", "<i8", "<i4", "|b1", "|u1")
"""Those of arrays that a checkpoint can hold."""
CHUNK_BYTES = 2**22
"""So much of a journal is read at once."""
_HEAD = b"ps_fmu checkpoint 2 %08x\n"
_ARRAY = 1
_NAME = re.compile(r"row-(\d{1,18})\.msgpack")
_BEGUN = ".begun.part"  # the file that is written and then gets its name


def write_file(path: Path, tree: Mapping[str, State]) -> None:
    """Write a checkpoint so that ``path`` is complete or not there.  Raises OSError; nothing is left then."""
    content = msgspec.msgpack.encode(tree, enc_hook=_encode)
    begun = path.with_name(_BEGUN)
    try:
        begun.unlink(missing_ok=True)  # it may be a link to anywhere
        with begun.open("xb") as file:
            file.write(_HEAD % zlib.crc32(content))
            file.write(content)
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
        raise CheckpointError(f"{path}: is no file but a folder, pipe or device")
    try:
        head, _, content = path.read_bytes().partition(b"\n")
        if head + b"\n" != _HEAD % zlib.crc32(content):
            raise ValueError("its format is another one, or its checksum does not fit")
        tree = msgspec.msgpack.decode(content, ext_hook=_decode)
        if not isinstance(tree, dict):
            raise ValueError("its content is no set of named values")
    except OSError as error:
        raise CheckpointError(f"{path}: cannot be read: {error.strerror or error}") from error
    except (ValueError, TypeError, OverflowError, RecursionError, MemoryError) as error:
        raise DamagedCheckpointError(path, f"is no checkpoint, or a damaged one: {error}") from error
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


def _encode(value: Any) -> Any:
    """What MessagePack does not know."""
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, Mapping):
        return dict(value)
    if not isinstance(value, np.ndarray):
        raise TypeError(f"a checkpoint holds no {type(value).__name__}")
    columns = value.flags.f_contiguous and not value.flags.c_contiguous  # numpy sums in the order of the memory
    dtype = value.dtype.newbyteorder("<")
    if dtype.str not in DTYPES:
        raise TypeError(f"a checkpoint holds no array of {value.dtype}")
    content = value.astype(dtype, copy=False).tobytes("F" if columns else "C")
    return msgspec.msgpack.Ext(_ARRAY, msgspec.msgpack.encode((dtype.str, value.shape, columns, content)))


def _decode(code: int, data: memoryview) -> State:
    if code != _ARRAY:
        raise ValueError(f"an extension of type {code}")
    dtype, shape, columns, content = msgspec.msgpack.decode(data, type=tuple[str, tuple[int, ...], bool, bytes])
    if dtype not in DTYPES or min(shape, default=0) < 0:
        raise ValueError(f"an array of {dtype!r} and the shape {shape}; expected one of {', '.join(DTYPES)}")
    found = np.frombuffer(content, dtype).reshape(shape, order="F" if columns else "C")
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
                log.warning("%s; the one before is taken", error)
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

    A journal that cannot be written, as on a full disk, takes no more rows: the run goes on without checkpoints.

    Raises :class:`CheckpointError`: the rows of the checkpoint are not there.
    """

    def __init__(self, path: Path, width: int, kept: Mapping[str, State] | None = None) -> None:
        self.path, self.width = path, width
        self.failure: OSError | None = None
        """Why it takes no more rows."""
        self.spent_s = 0.0
        """Time that the rows have taken [s]."""
        self._rows = self._sum = 0
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
        numbers = np.ascontiguousarray(rows, "<f8")
        try:
            left = numbers.data.cast("B") if numbers.size else memoryview(b"")
            while left:
                left = left[self._file.write(left) :]
            self._rows += len(rows)
            self._sum = _add(self._sum, numbers)
        except OSError as error:
            self.failure = error
            log.warning("%s: %s: no more checkpoints are written", self.path, error.strerror or error)
        self.spent_s += perf_counter() - began

    def sync(self) -> dict[str, State]:
        """Have all rows on the disk; what a checkpoint says of them.  Raises OSError."""
        if self.failure is not None:
            raise self.failure
        os.fsync(self._file.fileno())
        return {"width": self.width, "rows": self._rows, "sum": self._sum}

    def read(self) -> Iterator[Array]:
        """All rows so far, some thousand at a time.  Raises EOFError where the file ends before."""
        left, at_once = self._rows, max(1, CHUNK_BYTES // (8 * self.width))
        with self.path.open("rb") as file:
            while left:
                numbers = np.fromfile(file, "<f8", min(left, at_once) * self.width)
                if numbers.size < min(left, at_once) * self.width:
                    raise EOFError
                left -= min(left, at_once)
                yield numbers.reshape(-1, self.width)

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def _go_on(self, kept: Mapping[str, State]) -> None:
        rows, width, checksum = (kept.get(name) for name in ("rows", "width", "sum"))
        if width != self.width or type(rows) is not int or rows < 0:
            raise CheckpointError(f"{self.path}: expected rows of {self.width} numbers, the checkpoint has {width!r}")
        self._rows = rows
        try:
            for numbers in self.read():
                self._sum = _add(self._sum, numbers)
        except EOFError:
            raise self._make_damaged(f"ends before the {rows} rows of the checkpoint") from None
        if self._sum != checksum:
            raise self._make_damaged(f"is damaged: the checksum of its {rows} rows does not fit")
        self._file.truncate(8 * rows * width)
        self._file.seek(0, os.SEEK_END)

    def _make_damaged(self, what: str) -> CheckpointError:
        return DamagedCheckpointError(self.path, f"{what}: the run cannot go on, begin it anew")


def _add(checksum: int, numbers: Array) -> int:
    """The sum of all words modulo 2^64: a seventh of the time of a CRC-32, and another one for another run."""
    return (checksum + int(numbers.view("<u8").sum())) % 2**64
