"""summary.json: the figures of a run and where they come from, for scripts and tests to read."""

from __future__ import annotations

import hashlib
import json
import math
import platform
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from functools import cache
from importlib import metadata
from pathlib import Path

import numpy as np

from .. import __version__
from ..slavekit.pack.files import write_atomically

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


@dataclass(frozen=True)
class RunSummary:
    """What ``summary.json`` holds at least; ``more`` is merged into it under keys of its own.

    The three lists are per axis x, y, z of the payload frame P; None (JSON null) where a scenario has no such
    figure.  Raises ``ValueError`` for a list that has not three entries and for a key that ``more`` repeats.
    """

    scenario: str
    orientation_deg: Sequence[float] | None  # roll, pitch, yaw
    step_s: float
    duration_s: float
    seed: int | None  # None: nothing random in the system
    rms_passive_rad: Sequence[float] | None
    rms_active_rad: Sequence[float] | None
    rejection_percent: Sequence[float] | None
    real_time_factor: float  # simulated seconds per second
    fmus: Sequence[FmuFile]
    versions: Mapping[str, str] = field(default_factory=versions)
    more: Mapping[str, object] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name in ("orientation_deg", "rms_passive_rad", "rms_active_rad", "rejection_percent"):
            value = getattr(self, name)
            if value is not None and len(value) != 3:
                raise ValueError(f"{name}: expected three entries, got {len(value)}")
        repeated = {item.name for item in fields(self)} & set(self.more)
        if repeated:
            raise ValueError(f"more: repeats {', '.join(sorted(repeated))}")

    def as_dict(self) -> dict[str, object]:
        """The content of the file: numbers, strings, lists and dictionaries; NaN and infinities are None."""
        own = {item.name: getattr(self, item.name) for item in fields(self) if item.name != "more"}
        own["fmus"] = [{"name": fmu.name, "sha256": fmu.sha256} for fmu in self.fmus]
        return {key: plain(value, key) for key, value in {**own, **self.more}.items()}

    def write(self, path: Path) -> None:
        """Write the file in one go; raises ``OSError`` and leaves what was there if that fails."""
        write_atomically(path, json.dumps(self.as_dict(), indent=2, allow_nan=False) + "\n")


def plain(value: object, key: str) -> object:
    """``value`` as JSON knows it; raises ``TypeError`` naming the entry it cannot turn into JSON."""
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
