"""Files that are complete or not there, and archives that are the same bytes whenever and wherever they are made."""

from __future__ import annotations

import errno
import hashlib
import io
import os
import tempfile
import zipfile
from collections.abc import Mapping
from pathlib import Path, PurePosixPath

DATE = (1980, 1, 1, 0, 0, 0)  # the earliest that a zip file can state
_COMPRESSION = 6  # 9 takes three times as long, 14 instead of 5 s with numpy and scipy, for 1 % less
_PERMISSIONS = {True: 0o100755, False: 0o100644}  # executable or not


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


def read_zip(path: Path) -> dict[PurePosixPath, bytes]:
    """All files of a zip archive."""
    with zipfile.ZipFile(path) as archive:
        return {PurePosixPath(i.filename): archive.read(i) for i in archive.infolist() if not i.is_dir()}


def compute_digest(files: Mapping[PurePosixPath, bytes]) -> bytes:
    """SHA-256 of names and contents."""
    total = hashlib.sha256()
    for name in sorted(files):
        total.update(f"{name}\0{len(files[name])}\0".encode())
        total.update(files[name])
    return total.digest()


def write_zip(path: Path, files: Mapping[PurePosixPath, bytes]) -> None:
    """Write a zip archive as of :func:`make_zip`.  Raises as :func:`write_atomically`."""
    write_atomically(path, make_zip(files))


def make_zip(files: Mapping[PurePosixPath, bytes], compression: int = zipfile.ZIP_DEFLATED) -> bytes:
    """A zip archive: entries sorted, dates and permissions fixed."""
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w") as archive:
        for name in sorted(files):
            entry = zipfile.ZipInfo(str(name), DATE)
            entry.compress_type = compression
            entry.create_system = 3  # Unix, also where it is made elsewhere
            entry.external_attr = _PERMISSIONS[name.suffix in (".so", ".dylib", ".dll")] << 16
            archive.writestr(entry, files[name], compresslevel=_COMPRESSION)
    return content.getvalue()
