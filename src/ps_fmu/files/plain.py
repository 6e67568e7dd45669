"""Plain files, read and written whole, and the error of a file that cannot be used."""

from __future__ import annotations

import errno
import hashlib
import os
import stat
import tempfile
from pathlib import Path


class CosimError(Exception):
    """Base class of the errors of files and of the co-simulation."""


class SystemFileError(CosimError, ValueError):
    """An SSD, SSV, SSP or FMU file cannot be used.

    Attributes: ``path`` of the file, ``text`` with the problem, ``line`` number in the file (None if unknown).
    """

    def __init__(self, path: Path, text: str, line: int | None = None) -> None:
        super().__init__(f"{path}{'' if line is None else f', line {line}'}: {text}")
        self.path = path
        self.text = text
        self.line = line


def read_bytes(path: Path, maximum: int) -> bytes:
    """Content of a regular file of at most ``maximum`` bytes: a pipe may never end, and a device fill the memory.

    Raises :class:`SystemFileError` if it cannot be read.
    """
    try:
        if not stat.S_ISREG(path.stat().st_mode):
            raise SystemFileError(path, "is a folder, pipe or device: expected a file")
        with path.open("rb") as file:
            data = file.read(maximum + 1)
    except OSError as error:
        raise SystemFileError(path, f"cannot be read: {error.strerror}") from error
    if len(data) > maximum:
        raise SystemFileError(path, f"is too large: of its bytes at most {maximum} are read")
    return data


def write_atomically(path: Path, content: bytes | str) -> None:
    """Write ``content`` to ``path`` so that a reader sees the old file or the new one, never a part.

    Text is written as UTF-8.  Raises ``OSError`` with the path (no such folder, a folder or device of this name, full
    disk); nothing is left behind then.
    """
    if path.exists() and not path.is_file():  # root could replace /dev/null
        raise OSError(errno.EEXIST, "is there already, and no ordinary file", str(path))
    data = content.encode() if isinstance(content, str) else content
    try:
        _write(path, data)
    except OSError as error:  # a write that fails, as on a full disk, does not say where
        raise OSError(error.errno, error.strerror or str(error), str(path)) from error


def _write(path: Path, data: bytes) -> None:
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(data)
        # mkstemp gives 0600; the file gets what open() would have given it.
        mask = os.umask(0)
        os.umask(mask)
        os.chmod(name, 0o666 & ~mask)
        os.replace(name, path)
    except BaseException:
        Path(name).unlink(missing_ok=True)
        raise


def compute_file_digest(path: Path) -> str:
    """SHA-256 of a file in hexadecimal.  Raises :class:`SystemFileError` if it cannot be read."""
    try:
        if path.exists() and not path.is_file():  # a device or pipe may be read without end
            raise SystemFileError(path, "cannot be read: it is no ordinary file")
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except FileNotFoundError as error:
        raise SystemFileError(path, "is not there") from error
    except OSError as error:
        raise SystemFileError(path, f"cannot be read: {error}") from error
