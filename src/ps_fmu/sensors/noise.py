"""Noise of several sensors of one kind as a function of the number of the sample, of seed and sensor alone.

White noise is drawn anew for each sample.  The drift (Gauss-Markov processes and a random walk) is slow: it is drawn
on a grid of about :data:`DRIFT_INTERVAL`, and linear between.  So that any sample can be computed on its own, the grid
is one of several: each is :data:`DRIFT_BLOCK` times as wide as the one below, and a block of a grid is a bridge, drawn
from its number, between two neighbours of the grid above.  On the widest one the recursion starts with the run.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from ..mechanism.quantities import Array
from .noise_model import CORRELATION_TIMES, NoiseModel

DRIFT_INTERVAL = 0.01  # s, a tenth of the shortest correlation time
DRIFT_BLOCK = 64  # intervals
GRIDS = 6  # the widest one has an interval of four months
WHITE_BLOCK = 256  # samples
_KEPT = 4  # blocks of each sort
_WHITE, _WIDEST, _DRIFT = 0, 1, 2  # tell the random numbers apart
_PROCESSES = len(CORRELATION_TIMES) + 1


class SensorNoise:
    """Samples of the random error of sensors that share a model.

    Parameters
    ----------
    model: of each sensor.
    sensors: how many.  The noise of a sensor does not depend on how many follow.
    interval: between samples, s.
    seed, kind: whole numbers, 0 or greater, from which everything is drawn.
    """

    def __init__(self, model: NoiseModel, sensors: int, interval: float, seed: int, kind: int) -> None:
        self._model, self._sensors, self._key = model, sensors, (seed, kind)
        self._deviation = model.density / np.sqrt(2.0 * interval)
        self._stride = max(1, round(DRIFT_INTERVAL / interval))
        self._has_drift = model.instability > 0.0 or model.random_walk > 0.0
        interval_of_drift = self._stride * interval
        self._bridges = [_Bridge(model, interval_of_drift * DRIFT_BLOCK**grid) for grid in range(GRIDS)]
        self._widest: list[Array] = []  # values on a grid above the bridges
        self._white: dict[int, Array] = {}
        self._paths: list[dict[int, Array]] = [{} for _ in range(GRIDS)]
        self._drift: dict[int, Array] = {}

    def __call__(self, index: NDArray[np.int64]) -> Array:
        """The error of the samples of these numbers (n,), 0 or greater and ascending, (n, sensors)."""
        error = np.zeros((len(index), self._sensors))
        if self._deviation:
            for block, part in _split(index, WHITE_BLOCK):
                error[part] = self._find_white(block)[index[part] - block * WHITE_BLOCK]
        if self._has_drift:
            place, rest = np.divmod(index, self._stride)
            share = (rest / self._stride)[:, None]
            for block, part in _split(place, DRIFT_BLOCK):
                (drift, slope), k = self._find_drift(block), place[part] - block * DRIFT_BLOCK
                error[part] += drift[k]
                error[part] += share[part] * slope[k]
        return error

    def _find_white(self, block: int) -> Array:
        def draw() -> Array:
            normal = draw_normal((*self._key, _WHITE, block), self._sensors, WHITE_BLOCK)
            return np.ascontiguousarray(self._deviation * normal.T)

        return _keep(self._white, block, draw)

    def _find_drift(self, block: int) -> Array:
        """Sum of the processes at the grid points of a block, and its growth to the next ones, (2, n, sensors)."""

        def draw() -> Array:
            path = self._find_path(0, block).sum(axis=1)
            return np.stack([path[:-1], np.diff(path, axis=0)])

        return _keep(self._drift, block, draw)

    def _find_path(self, grid: int, block: int) -> Array:
        """The processes on a block of a grid, both ends included, (DRIFT_BLOCK + 1, processes, sensors)."""

        def draw() -> Array:
            first, last = self._find_value(grid + 1, block), self._find_value(grid + 1, block + 1)
            normal = draw_normal((*self._key, _DRIFT + grid, block), self._sensors, _PROCESSES * DRIFT_BLOCK)
            kicks = normal.reshape(self._sensors, _PROCESSES, DRIFT_BLOCK).transpose(2, 1, 0)
            return self._bridges[grid].connect(first, last, kicks)

        return _keep(self._paths[grid], block, draw)

    def _find_value(self, grid: int, place: int) -> Array:
        """The processes at a place of a grid, (processes, sensors)."""
        if grid < GRIDS:
            block, k = divmod(place, DRIFT_BLOCK)
            return np.asarray(self._find_path(grid, block)[k])
        while len(self._widest) <= place:
            number = len(self._widest)
            normal = draw_normal((*self._key, _WIDEST, number), self._sensors, _PROCESSES).T
            self._widest.append(self._bridges[-1].go_on(self._widest[-1] if number else None, normal))
        return self._widest[place]


def draw_normal(key: Sequence[int], rows: int, columns: int) -> Array:
    """Standard normal numbers (rows, columns) that belong to whole numbers; a row does not depend on how many follow.

    Box-Muller, since the streams of numpy's own normal numbers may change between its versions.
    """
    random = np.random.Generator(np.random.Philox(np.random.SeedSequence([value % 2**32 for value in key])))
    u, v = random.random((rows, 2, (columns + 1) // 2)).transpose(1, 0, 2)
    radius, angle = np.sqrt(-2.0 * np.log1p(-u)), 2.0 * np.pi * v
    return np.concatenate([radius * np.cos(angle), radius * np.sin(angle)], axis=1)[:, :columns]


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

        ``normal``: (DRIFT_BLOCK, processes, sensors).
        """
        path = np.empty((DRIFT_BLOCK + 1, *first.shape))
        path[0] = value = first
        kicks = self._s * normal
        for k in range(DRIFT_BLOCK):
            value = self._c * value + kicks[k]
            path[k + 1] = value
        path[1:] += self._weight * (last - value)
        return path


def _split(index: NDArray[np.int64], size: int) -> list[tuple[int, slice]]:
    """Blocks of ``size`` that ascending numbers fall into, and where among the numbers each is."""
    found, start = [], 0
    while start < len(index):
        block = int(index[start]) // size
        end = int(np.searchsorted(index, (block + 1) * size))
        found.append((block, slice(start, end)))
        start = end
    return found


def _keep(known: dict[int, Array], block: int, draw: Callable[[], Array]) -> Array:
    if block not in known:
        if len(known) == _KEPT:
            del known[next(iter(known))]  # the oldest
        known[block] = draw()
    return known[block]
