"""summary.json: the figures of a run and where they come from, for scripts and tests to read."""

from __future__ import annotations

import hashlib
import json
import math
import platform
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cache
from importlib import metadata
from pathlib import Path

import numpy as np

from .. import __version__
from ..files.plain import write_atomically

_PACKAGES = ("fmpy", "pythonfmu", "numpy", "scipy", "control", "netCDF4", "matplotlib")


@dataclass(frozen=True)
class FmuFile:
    """An FMU that took part: its file name without suffix, and the SHA-256 of the file in hexadecimal."""

    name: str
    sha256: str

    @classmethod
    def of(cls, path: Path) -> FmuFile:
        """Read the file; raises ``OSError`` if that fails."""
        with path.open("rb") as file:
            return cls(path.stem, hashlib.file_digest(file, "sha256").hexdigest())


def versions() -> dict[str, str]:
    """Versions of Python, of this package and of the packages that a result depends on."""
    return {
        "python": platform.python_version(),
        "ps_fmu": __version__,
        **{package: _find_version(package) for package in _PACKAGES},
    }


@cache
def _find_version(package: str) -> str:
    """Kept: a run asks three times, and to read the metadata of all packages takes 5 ms."""
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return "not installed"


def write_summary(path: Path, content: Mapping[str, object]) -> None:
    """Write a JSON file in one go; raises ``OSError`` and leaves what was there if that fails."""
    write_atomically(path, json.dumps(plain(content, path.name), indent=2, allow_nan=False) + "\n")


def plain(value: object, key: str) -> object:
    """``value`` as JSON knows it, NaN and infinities as None.

    Raises ``TypeError`` naming the entry that it cannot turn into JSON.
    """
    if isinstance(value, FmuFile):
        value = asdict(value)
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if value is None or isinstance(value, bool | int | str):
        return value
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Path):
        return str(value)
    if isinstance(value, Mapping):
        return {str(name): plain(entry, f"{key}.{name}") for name, entry in value.items()}
    if isinstance(value, Sequence):
        return [plain(entry, f"{key}[{place}]") for place, entry in enumerate(value)]
    raise TypeError(f"{key}: a {type(value).__name__} has no place in JSON")
