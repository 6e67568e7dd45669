"""The compiled code of this package: its sources in C, what was made of them for each platform, one way to load it.

Only a file that was recorded when it was made is loaded, run or packed: a library that was cut short ends the process
when it is loaded, one of another version when it is called.  ``native.json`` is the record of all files; ``make
launcher`` makes them again, see :mod:`.build`.
"""

from __future__ import annotations

import ctypes
import hashlib
import json
import platform
import sys
from pathlib import Path, PurePosixPath

FOLDER = Path(__file__).parent
RECORD = "native.json"
_AGAIN = "install ps_fmu again, or after changes of its C sources run 'make launcher'"
_PLATFORMS = {("linux", "x86_64"): "linux64", ("linux", "aarch64"): "aarch64-linux", ("win32", "amd64"): "win64"}


class NotCompiledError(OSError):
    """A compiled file that is needed is missing, damaged, or made for other platforms.  The text says what makes it."""


def find_platform() -> str:
    """The platform here, as folders of binaries are called in FMUs; elsewhere the names that Python has for it."""
    system, machine = sys.platform, platform.machine()
    found = _PLATFORMS.get((system, machine.lower())) if sys.maxsize > 2**32 else None
    return found or f"{system} on {machine}"


def load(name: str) -> ctypes.CDLL:
    """A library, for this platform.  Raises NotCompiledError."""
    path = find_compiled(name)
    try:
        return ctypes.CDLL(str(path))
    except OSError as error:
        raise NotCompiledError(f"{path}: cannot be loaded ({error}): {_AGAIN}") from error


def find_compiled(name: str) -> Path:
    """The file of a program or library, for this platform.  Raises NotCompiledError."""
    return _read(name, find_platform())[0]


def read_compiled(name: str, platform: str) -> tuple[str, bytes]:
    """Name and content of the file for a platform (``linux64``, ...).  Raises NotCompiledError."""
    path, content = _read(name, platform)
    return path.name, content


def list_platforms(name: str) -> list[str]:
    """Those that a program or library was made for.  Raises NotCompiledError."""
    return [platform for platform, files in _read_record().items() if name in map(_get_stem, files)]


def _read_record() -> dict[str, dict[str, str]]:
    """Platform -> file -> SHA-256."""
    path = FOLDER / RECORD
    try:
        made = json.loads(path.read_bytes())["made"]
        return {str(platform): dict(files) for platform, files in made.items()}
    except OSError as error:
        raise NotCompiledError(f"{path}: {error.strerror}: {_AGAIN}") from error
    except (ValueError, LookupError, TypeError, AttributeError) as error:
        raise NotCompiledError(f"{path}: is damaged ({error!r}): {_AGAIN}") from error


def _read(name: str, platform: str) -> tuple[Path, bytes]:
    made = _read_record()
    files = {_get_stem(file): file for file in made.get(platform, ())}
    if name not in files:
        names = ", ".join(known for known in made if name in map(_get_stem, made[known]))
        raise NotCompiledError(f"{name}: not compiled for {platform}: 'make launcher' compiles for {names}")
    path = FOLDER / platform / files[name]
    try:
        content = path.read_bytes()
    except OSError as error:
        raise NotCompiledError(f"{path}: {error.strerror}: {_AGAIN}") from error
    found, expected = hashlib.sha256(content).hexdigest(), made[platform][files[name]]
    if found != expected:
        raise NotCompiledError(
            f"{path}: is damaged, or of another version: its SHA-256 is {found}, {RECORD} has {expected}: {_AGAIN}"
        )
    return path, content


def _get_stem(file: str) -> str:
    return PurePosixPath(file).stem
