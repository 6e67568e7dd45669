"""A recorded wrench from a CSV file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np

from ...mechanism.parameters import Parameters
from ...mechanism.quantities import Array, ParameterError, quantity
from ..csv_table import read_columns
from ..kind import Kind, SharedSettings, Source

HEADER = (
    "time [s]",
    "force.x [N]", "force.y [N]", "force.z [N]",
    "torque.x [N.m]", "torque.y [N.m]", "torque.z [N.m]",
)  # fmt: skip
_DIED_AWAY = 1e-9  # of the largest value


class Recording:
    """Linear interpolation in a file with one line of names and units, then one line per instant.

    The names are those of :data:`HEADER`, in any order; other columns are ignored.  Times increase strictly.

    Parameters
    ----------
    path: the file.
    repeat: the last line is also the first of the next repetition; else nothing acts before the first and after the
        last line.
    scale: factor on force and torque.

    Raises
    ------
    ParameterError: the file cannot be used; the text says why, with the number of the line.
    """

    def __init__(self, path: Path, repeat: bool = False, scale: float = 1.0) -> None:
        table = read_columns(path, HEADER, "path")
        self._time, self._wrench = table[:, 0].copy(), scale * table[:, 1:]
        self._repeat = repeat

    @property
    def end(self) -> float:
        """Time where the recording is cut off, s; infinite if it is repeated, or has died away in its last line."""
        died_away = np.abs(self._wrench[-1]).max() <= _DIED_AWAY * np.abs(self._wrench).max()
        return np.inf if self._repeat or died_away else float(self._time[-1])

    def __call__(self, time: Array) -> Array:
        """Force (N) and torque (N.m) in B at its origin at the times (n,) in s, shape (n, 6)."""
        first, last = self._time[0], self._time[-1]
        at = first + np.mod(time - first, last - first) if self._repeat else np.clip(time, first, last)
        after = np.clip(np.searchsorted(self._time, at, side="right"), 1, self._time.size - 1)
        before = after - 1
        part = (at - self._time[before]) / (self._time[after] - self._time[before])
        wrench = self._wrench[before] + part[:, None] * (self._wrench[after] - self._wrench[before])
        if not self._repeat:
            # The slack is for times that are sums of steps: the last line acts.
            slack = 1e-9 * (last - first)
            wrench[(time < first - slack) | (time > last + slack)] = 0.0
        return np.asarray(wrench)


@dataclass(frozen=True)
class RecordingSettings(Kind):
    """A file; no path means off."""

    name: ClassVar[str] = "recording"
    place: ClassVar[int] = 50

    path: str = quantity("", "CSV file with time, force and torque in B at its origin; empty: none")
    repeat: bool = quantity("", "True: begin again after the last line; false: nothing acts after it")
    scale: float = quantity("1", "Factor on the recorded wrench")

    def __post_init__(self) -> None:
        super().__post_init__()
        if not isinstance(self.path, str):
            raise ParameterError("path", f"expected text, got {self.path!r}")

    @classmethod
    def make_defaults(cls, p: Parameters) -> RecordingSettings:
        """No file."""
        return cls(path="", repeat=False, scale=1.0)

    def make_source(self, shared: SharedSettings, number: int) -> Source | None:
        """The recording.  Raises ParameterError: the file cannot be used."""
        return Recording(Path(self.path), self.repeat, self.scale) if self.path else None
