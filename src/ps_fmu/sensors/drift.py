"""Slow random errors of sensors: Gauss-Markov processes and a random walk, at any place of a grid in time.

So that any place can be computed on its own, the grid is one of several: each is :data:`DRIFT_BLOCK` times as wide as
the one below, and a block of a grid is a bridge, drawn from its number, between two neighbours of the grid above.  On
the widest one the recursion starts with the run.
"""

from __future__ import annotations

from collections.abc import Sequence
from ctypes import byref

import numpy as np

from ..mechanism.quantities import Array
from ..numerics import library
from ..numerics.library import find_address
from ..numerics.normal import Stream, make_key
from .noise_model import CORRELATION_TIMES, NoiseModel
from .normal import Parts, draw_normal, wrap

DRIFT_BLOCK = 64  # intervals
GRIDS = 6  # the widest one has an interval of four months, if that of the first is 0.01 s
_KEPT = 4  # blocks of each sort
_PARTS = 4  # in which a block of the first grid is nearly always found
_PROCESSES = len(CORRELATION_TIMES) + 1


class Drift:
    """The sum of all slow processes of each sensor.

    Parameters
    ----------
    model: of each sensor.
    sensors: how many.  The drift of a sensor does not depend on how many follow.
    interval: of the grid, s.
    key, kinds: whole numbers from which everything is drawn; ``kinds`` are the numbers of the widest grid and, counted
        on from there, those of the others.
    """

    def __init__(
        self, model: NoiseModel, sensors: int, interval: float, key: Sequence[int], kinds: tuple[int, int]
    ) -> None:
        self._sensors, self._key = sensors, tuple(key)
        self._kind_of_widest, self._kind = kinds
        self._bridges = [_Bridge(model, interval * DRIFT_BLOCK**grid) for grid in range(GRIDS)]
        self._widest: list[Array] = []  # values on a grid above the bridges
        self._paths: list[dict[int, Array]] = [{} for _ in range(GRIDS)]
        self._sums: dict[int, Array] = {}

    def count_parts(self, first: int, last: int) -> int:
        """In how many parts the blocks from ``first`` to ``last`` are nearly always found."""
        return sum(_PARTS for block in range(first, last + 1) if block not in self._sums)

    def find(self, block: int) -> Parts:
        """Drift at the places of a block, and its growth to the next ones, (2, sensors, DRIFT_BLOCK)."""
        found = self._sums.get(block)
        if found is None:
            path = yield from self._find_path(0, block)
            yield
            total = path.sum(axis=1).T
            found = np.ascontiguousarray([total[:, :-1], np.diff(total)])
            keep(self._sums, block, found)
            yield  # others may be found meanwhile, and this one forgotten
        return found

    def _find_path(self, grid: int, block: int) -> Parts:
        """The processes on a block of a grid, both ends included, (DRIFT_BLOCK + 1, processes, sensors)."""
        if block not in self._paths[grid]:
            first = yield from self._find_value(grid + 1, block)
            last = yield from self._find_value(grid + 1, block + 1)
            yield
            key = make_key(Stream.SENSOR_DRIFT, *wrap((*self._key, self._kind + grid, block)))
            normal = draw_normal(key, self._sensors, _PROCESSES * DRIFT_BLOCK)
            yield
            path = self._bridges[grid].connect(first, last, normal)
            keep(self._paths[grid], block, path)
        return self._paths[grid][block]

    def _find_value(self, grid: int, place: int) -> Parts:
        """The processes at a place of a grid, (processes, sensors)."""
        if grid < GRIDS:
            block, k = divmod(place, DRIFT_BLOCK)
            path = yield from self._find_path(grid, block)
            return np.asarray(path[k])
        while len(self._widest) <= place:
            number = len(self._widest)
            key = make_key(Stream.SENSOR_DRIFT, *wrap((*self._key, self._kind_of_widest, number)))
            normal = draw_normal(key, self._sensors, _PROCESSES).T
            self._widest.append(self._bridges[-1].go_on(self._widest[-1] if number else None, normal))
            yield
        return self._widest[place]


class _Bridge:
    """Recursions x' = c x + s w of the processes on a grid, and their paths between two given ends."""

    def __init__(self, model: NoiseModel, interval: float) -> None:
        deviation = np.sqrt(model.variance)
        decay = np.exp(-interval / CORRELATION_TIMES)
        self._c = np.append(decay, 1.0)[:, None]
        self._s = np.append(deviation * np.sqrt(1.0 - decay**2), model.random_walk * np.sqrt(interval))[:, None]
        self._first = np.append(np.full(len(decay), deviation), 0.0)[:, None]
        steps = np.arange(1, DRIFT_BLOCK + 1)[:, None, None]
        self._powers = self._c**steps  # (block, processes, 1)
        grown = np.cumsum(self._c ** (2 * (steps - 1)), axis=0)  # variance of a path from 0, over s^2
        self._total = np.sqrt(grown[-1])
        # Covariance with the end of the path, over the variance of the end.
        self._weight = self._c ** (DRIFT_BLOCK - steps) * grown / grown[-1]

    def go_on(self, before: Array | None, normal: Array) -> Array:
        """The processes one block later; None: at the start, where the Gauss-Markov ones are stationary already."""
        if before is None:
            return self._first * normal
        return np.asarray(self._powers[-1] * before + self._s * self._total * normal)

    def connect(self, first: Array, last: Array, normal: Array) -> Array:
        """Paths from ``first`` to ``last`` (processes, sensors), (DRIFT_BLOCK + 1, processes, sensors).

        ``normal``: (sensors, processes * DRIFT_BLOCK), its rows side by side.
        """
        path = np.empty((DRIFT_BLOCK + 1, *first.shape))
        constants = map(find_address, (self._c, self._s, self._weight))
        shared = library.Bridge(*constants, DRIFT_BLOCK, *first.shape)
        given = map(np.ascontiguousarray, (first, last, normal))  # kept by the list below during the call
        arrays = [*given, path]
        library.find_arithmetic().connect(byref(shared), *map(find_address, arrays))
        return path


def keep(known: dict[int, Array], block: int, made: Array) -> None:
    """Keep a block, and forget the oldest of many."""
    if len(known) >= _KEPT:
        del known[next(iter(known))]
    known[block] = made
