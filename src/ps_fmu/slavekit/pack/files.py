"""Files that are complete or not there: written under a temporary name, then renamed."""

from __future__ import annotations

import errno
import os
import tempfile
from pathlib import Path


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
