"""How a wheel turns: its speed over time (constant, a linear ramp, a table), and the multiples of its angle.

With z = exp(i angle), z^1.99 = z^1.01 z^0.98: two multiples that differ by d follow from each other by a product with
z^d, which takes an eighth of the work of a cosine and a sine.  Orders of harmonics are decimal numbers of few digits,
so that many differ by the same d (:func:`plan_products`).
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property, lru_cache
from math import lcm
from pathlib import Path
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from ..mechanism.quantities import Array, ParameterError
from ..numerics import library
from ..numerics.library import find_address
from .recording import read_columns

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

    def describe(self, rise_time: float) -> library.Profile:
        """For the compiled wheel, as long as this lives; ``rise_time``: of its fade-in, s."""


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

    def describe(self, rise_time: float) -> library.Profile:
        """As :meth:`Speed.describe`."""
        return library.Profile(self.initial, self.final, self.start, self.duration, rise_time)


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

        Raises ParameterError, with the number of the line: as :func:`.recording.read_columns`, and for a speed beyond
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

    def describe(self, rise_time: float) -> library.Profile:
        """As :meth:`Speed.describe`."""
        arrays = map(find_address, (self.times, self.speeds, self._slopes, self._turned))
        before = float(self._from_first(np.zeros(1))[0])
        return library.Profile(0.0, 0.0, 0.0, 0.0, rise_time, *arrays, len(self.times), before)

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


class Products(NamedTuple):
    """How to get all multiples from a few."""

    turned: tuple[float, ...]
    """Those whose cosine and sine are to be computed."""
    products: tuple[tuple[int, int, bool], ...]
    """The others, in this order behind those: of which two, and whether the second one turns backwards."""
    place: dict[float, int]
    """Where each of the given multiples is among all."""


_MOST = 40  # for which products are looked for: of more, that takes longer than they save


@lru_cache(maxsize=8)
def plan_products(multiples: tuple[float, ...]) -> Products:
    """A plan with few cosines for distinct multiples: 7 of 21 for the harmonics of the default wheel, in 3 ms."""
    fractions = [Fraction(repr(multiple)) for multiple in multiples]  # as they are written: their sums are exact
    unit = lcm(*(fraction.denominator for fraction in fractions))
    exact = {int(fraction * unit): multiple for fraction, multiple in zip(fractions, multiples, strict=True)}
    differences, group = _join(sorted(exact)) if len(exact) <= _MOST else ([], {value: value for value in exact})
    reached = {group.get(difference) for difference in differences}
    turned = [*differences, *(value for value in sorted(set(group.values())) if value not in reached)]
    place = {value: k for k, value in enumerate(turned)}
    products: list[tuple[int, int, bool]] = []
    found = [value for value in turned if value in exact]
    for value in found:  # which grows
        for difference in differences:
            for other, backwards in ((value + difference, False), (value - difference, True)):
                if other in exact and other not in place:
                    place[other] = len(turned) + len(products)
                    products.append((place[value], place[difference], backwards))
                    found.append(other)
    return Products(
        tuple(value / unit for value in turned), tuple(products), {exact[value]: place[value] for value in exact}
    )


def _join(values: list[int]) -> tuple[list[int], dict[int, int]]:
    """Differences that lead from few values to all others, and value -> the one that stands for what it is joined to.

    Greedy: the difference that joins most goes first.  One that is no value itself has to join two pairs or more.
    """
    group, differences = {value: value for value in values}, list[int]()
    while True:
        pairs = defaultdict(list)
        for k, low in enumerate(values):
            for high in values[k + 1 :]:
                if group[low] != group[high]:
                    pairs[high - low].append((low, high))
        best, saved, chosen = group, 0, 0
        for difference, found in pairs.items():
            joined, n = dict(group), 0
            for low, high in found:
                one, other = joined[low], joined[high]
                if one != other:
                    joined = {value: one if of == other else of for value, of in joined.items()}
                    n += 1
            if n - (difference not in group) > saved:
                best, saved, chosen = joined, n - (difference not in group), difference
        if not saved:
            return differences, group
        group = best
        differences.append(chosen)
