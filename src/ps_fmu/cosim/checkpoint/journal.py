"""Rows that only ever grow in number: a file of raw numbers, little endian float64, one row behind the other.

A checkpoint says how many of the rows are its own, and their checksum.  What lies behind them, of after the checkpoint,
is cut off when the run is resumed.
"""

from __future__ import annotations

import logging
import os
import zlib
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np

from .state import Array, CheckpointError, State

log = logging.getLogger("ps_fmu.cosim")

READ_BYTES = 2**22


class Journal:
    """Rows of ``width`` numbers in a file, written anew, or gone on with from what a checkpoint says of it.

    A journal that cannot be written, as on a full disk, takes no more rows: the run goes on without checkpoints.

    Raises :class:`CheckpointError`: the rows of the checkpoint are not there.
    """

    def __init__(self, path: Path, width: int, kept: Mapping[str, State] | None = None) -> None:
        self.path, self.width = path, width
        self.failure: OSError | None = None
        """Why it takes no more rows."""
        self._rows = self._checksum = 0
        try:
            self._file = path.open("w+b" if kept is None else "r+b")
            if kept is not None:
                self._go_on(kept)
        except OSError as error:
            if isinstance(error, CheckpointError):
                raise
            raise CheckpointError(f"{path}: rows of the checkpoint: {error.strerror or error}") from error

    def append(self, rows: Array) -> None:
        """Add rows (rows, width); once it is closed they are in no checkpoint, and left out."""
        if self.failure is not None or self._file.closed or not len(rows):
            return
        data = np.ascontiguousarray(rows, dtype="<f8").reshape(-1).view(np.uint8).data
        try:
            self._file.write(data)
        except OSError as error:
            self.failure = error
            log.warning("%s: %s: no more checkpoints are written", self.path, error.strerror or error)
            return
        self._checksum = zlib.crc32(data, self._checksum)
        self._rows += len(rows)

    def sync(self) -> dict[str, State]:
        """Have all rows on the disk; what a checkpoint says of them.  Raises OSError."""
        if self.failure is not None:
            raise self.failure
        self._file.flush()
        os.fsync(self._file.fileno())
        return {"width": self.width, "rows": self._rows, "crc32": self._checksum}

    def read(self) -> Iterator[Array]:
        """All rows so far, some thousand at a time."""
        if not self._file.closed:
            self._file.flush()
        left = self._rows
        with self.path.open("rb") as file:
            while left:
                count = min(left, max(1, READ_BYTES // (8 * self.width)))
                data = file.read(8 * self.width * count)
                yield np.frombuffer(data, "<f8").astype(np.float64).reshape(count, self.width)
                left -= count

    def close(self) -> None:
        """Close the file."""
        try:
            self._file.close()
        except OSError as error:  # a full disk again: it is flushed
            log.warning("%s: %s", self.path, error.strerror or error)

    def _go_on(self, kept: Mapping[str, State]) -> None:
        rows, width, checksum = (kept.get(name) for name in ("rows", "width", "crc32"))
        if width != self.width or type(rows) is not int or rows < 0:
            raise CheckpointError(f"{self.path}: expected rows of {self.width} numbers, the checkpoint has {width!r}")
        end = 8 * self.width * rows
        found, left = 0, end
        while left:
            data = self._file.read(min(left, READ_BYTES))
            if not data:
                raise CheckpointError(f"{self.path}: ends before the {rows} rows of the checkpoint")
            found, left = zlib.crc32(data, found), left - len(data)
        if found != checksum:
            raise CheckpointError(f"{self.path}: is damaged: the checksum of its {rows} rows does not fit")
        self._file.truncate(end)
        self._file.seek(end)
        self._rows, self._checksum = rows, found
