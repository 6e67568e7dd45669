"""How the speed of a wheel goes: constant, a linear ramp, or a table."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ..mechanism.quantities import Array, ParameterError
from .csv_table import read_columns

HEADER = ("time [s]", "speed [rpm]")
RPM = 2.0 * np.pi / 60.0  # rad/s
FASTEST = 1e6  # rpm; the fastest machines on magnetic bearings turn at some 5e5 rpm


class Speed(Protocol):
    """Speed of a wheel as a function of time, with its integral and its rate of change."""

    @property
    def highest(self) -> float:
        """Largest magnitude of the speed, rad/s."""

    def speed(self, time: Array) -> Array:
        """Speed at the times (n,) in s, rad/s."""

    def angle(self, time: Array) -> Array:
        """Angle turned since t = 0 at the times (n,) in s, rad: the exact integral of the speed."""

    def acceleration(self, time: Array) -> Array:
        """Rate of change of the speed at the times (n,) in s, rad/s2."""


@dataclass(frozen=True)
class SpeedProfile:
    """Constant speed, a ramp, constant speed; speeds in rad/s, times in s."""

    initial: float
    final: float
    start: float
    duration: float

    @property
    def highest(self) -> float:
        """Largest magnitude of the speed, rad/s."""
        return max(abs(self.initial), abs(self.final))

    def acceleration(self, time: Array) -> Array:
        """Rate of change of the speed at the times (n,), rad/s2; a jump has none."""
        if self.duration == 0.0 or self.initial == self.final:
            return np.zeros(time.size)
        since = time - self.start  # rounded as in the compiled library, where it decides on the last row of the ramp
        during = (since >= 0.0) & (since < self.duration)
        return np.where(during, (self.final - self.initial) / self.duration, 0.0)

    def speed(self, time: Array) -> Array:
        """Speed at the times (n,), rad/s."""
        if self.initial == self.final:
            return np.full(time.size, self.initial)
        if self.duration == 0.0:
            return np.where(time < self.start, self.initial, self.final)
        part = np.minimum(np.maximum((time - self.start) / self.duration, 0.0), 1.0)
        return np.asarray(self.initial + (self.final - self.initial) * part)

    def angle(self, time: Array) -> Array:
        """Angle turned since t = 0, rad: the exact integral of the speed."""
        if self.initial == self.final:
            return np.asarray(self.initial * time)
        since = time - self.start
        within = np.minimum(np.maximum(since, 0.0), self.duration)  # np.clip takes twice as long
        after = np.maximum(since - self.duration, 0.0)
        slope = within**2 / (2.0 * self.duration) if self.duration > 0.0 else 0.0
        return np.asarray(self.initial * time + (self.final - self.initial) * (slope + after))


@dataclass(frozen=True, eq=False)
class SpeedTable:
    """Speed that is linear between the rows of a table, and constant before the first and after the last.

    ``times`` (n,) in s, strictly ascending, n >= 2; ``speeds`` (n,) in rad/s.
    """

    times: Array
    speeds: Array

    @classmethod
    def read(cls, path: Path, name: str) -> SpeedTable:
        """From a CSV file with the columns of :data:`HEADER`; ``name``: of the parameter, for errors.

        Raises ParameterError, with the number of the line: as :func:`.csv_table.read_columns`, and for a speed beyond
        :data:`FASTEST`.
        """
        rows = read_columns(path, HEADER, name)
        if (fastest := float(np.abs(rows[:, 1]).max())) > FASTEST:
            raise ParameterError(name, f"{path.name}: {fastest:g} rpm is beyond {FASTEST:g} rpm")
        return cls(rows[:, 0].copy(), RPM * rows[:, 1])

    @property
    def highest(self) -> float:
        """Largest magnitude of the speed, rad/s."""
        return float(np.abs(self.speeds).max())

    def speed(self, time: Array) -> Array:
        """Speed at the times (n,), rad/s."""
        return np.interp(time, self.times, self.speeds)

    def acceleration(self, time: Array) -> Array:
        """Rate of change of the speed at the times (n,), rad/s2: that of the row's segment from the row on."""
        within = (time >= self.times[0]) & (time < self.times[-1])
        return np.where(within, self._slopes[self._find(time)], 0.0)

    def angle(self, time: Array) -> Array:
        """Angle turned since t = 0, rad: the exact integral of the speed."""
        return self._from_first(time) - self._from_first(np.zeros(1))

    def _from_first(self, time: Array) -> Array:
        """Angle turned since the first row, rad."""
        at = self._find(time)
        since = np.clip(time, self.times[0], self.times[-1]) - self.times[at]
        within = self._turned[at] + since * (self.speeds[at] + 0.5 * self._slopes[at] * since)
        before, after = np.minimum(time - self.times[0], 0.0), np.maximum(time - self.times[-1], 0.0)
        return np.asarray(within + self.speeds[0] * before + self.speeds[-1] * after)

    def _find(self, time: Array) -> NDArray[np.intp]:
        """The segment (n,) of each time."""
        return np.clip(np.searchsorted(self.times, time, side="right") - 1, 0, len(self.times) - 2)

    @cached_property
    def _slopes(self) -> Array:
        """(segments,), rad/s2."""
        return np.diff(self.speeds) / np.diff(self.times)

    @cached_property
    def _turned(self) -> Array:
        """(rows,), rad, from the first row to each."""
        turns = 0.5 * (self.speeds[1:] + self.speeds[:-1]) * np.diff(self.times)
        return np.concatenate([[0.0], np.cumsum(turns)])
