"""Compiled files of this package: only one that was recorded when it was made is loaded, run or packed.

A library that was cut short ends the process when it is loaded, one of another version when it is called.  Beside the
sources lies the record, which says what was made for each platform of FMI, see ``slavekit/launcher/c_program.py``.
"""

from __future__ import annotations

import ctypes
import hashlib
import json
import platform
import sys
from pathlib import Path

_AGAIN = "install ps_fmu again, or after changes of its C sources run 'make launcher'"
_PLATFORMS = {("linux", "x86_64"): "linux64", ("linux", "aarch64"): "aarch64-linux", ("win32", "amd64"): "win64"}
_NAMES = ", ".join(_PLATFORMS.values())


class NotCompiledError(OSError):
    """A compiled file that is needed is missing, damaged, or made for other platforms.  The text says what makes it."""


def load(record: Path) -> ctypes.CDLL:
    """The library that a record says was made for this platform.  Raises NotCompiledError."""
    name = _PLATFORMS.get((sys.platform, platform.machine().lower()))
    if name is None or sys.maxsize < 2**32:
        here = f"{sys.platform} on {platform.machine()}"
        raise NotCompiledError(f"{record.stem}: not compiled for {here}: 'make launcher' compiles for {_NAMES}")
    path = find_whole(record, name)
    try:
        return ctypes.CDLL(str(path))
    except OSError as error:
        raise NotCompiledError(f"{path}: cannot be loaded ({error}): {_AGAIN}") from error


def find_whole(record: Path, platform: str) -> Path:
    """The compiled file for a platform (``linux64``, ...), which is the recorded one.  Raises NotCompiledError."""
    return _read(record, platform)[0]


def read_whole(record: Path, platform: str) -> bytes:
    """The content of the compiled file for a platform.  Raises NotCompiledError."""
    return _read(record, platform)[1]


def _read(record: Path, platform: str) -> tuple[Path, bytes]:
    try:
        content = json.loads(record.read_bytes())
        path = record.parent / platform / content["targets"][platform]["result"]
        expected = content["made"][platform]
        data = path.read_bytes()
    except OSError as error:
        raise NotCompiledError(f"{error.filename}: {error.strerror}: {_AGAIN}") from error
    except (ValueError, LookupError, TypeError) as error:
        text = f"{record}: is damaged, or says nothing of {platform} ({error!r}): {_AGAIN}"
        raise NotCompiledError(text) from error
    found = hashlib.sha256(data).hexdigest()
    if found != expected:
        raise NotCompiledError(
            f"{path}: is damaged, or of another version: its SHA-256 is {found}, {record.name} has {expected}: {_AGAIN}"
        )
    return path, data
