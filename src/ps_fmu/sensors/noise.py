"""Noise of several sensors of one kind as a function of the number of the sample, of seed and sensor alone.

White noise is drawn anew for each sample.  The drift is slow: it is drawn on a grid of about :data:`DRIFT_INTERVAL`,
and linear between.  An FMU needs the noise while its steps are made, so it comes in parts of 20 to 60 us.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..mechanism.quantities import Array
from .drift import DRIFT_BLOCK, Drift
from .noise_model import NoiseModel
from .normal import Parts, count_parts, draw_in_parts, finish

DRIFT_INTERVAL = 0.01  # s, a tenth of the shortest correlation time
WHITE_BLOCK = 256  # samples
_FIRST = 8  # blocks, which are made in more parts: their memory comes from the system, page by page
_WHITE, _WIDEST, _DRIFT = 0, 1, 2  # tell the random numbers apart


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
        self._sensors, self._key = sensors, (seed, kind)
        self._deviation = model.density / np.sqrt(2.0 * interval)
        self._stride = max(1, round(DRIFT_INTERVAL / interval))
        self._made = 0  # blocks
        self._drift = None
        if model.instability > 0.0 or model.random_walk > 0.0:
            self._drift = Drift(model, sensors, self._stride * interval, self._key, (_WIDEST, _DRIFT))

    def __call__(self, index: NDArray[np.int64]) -> Array:
        """The error of the samples of these numbers (n,), 0 or greater and ascending, (n, sensors)."""
        error = np.empty((len(index), self._sensors))
        for block, part in split(index, WHITE_BLOCK):
            error[part] = finish(self.in_parts(block)).take(index[part] - block * WHITE_BLOCK, axis=1).T
        return error

    def count_parts(self, block: int) -> int:
        """In how many parts a block is nearly always made."""
        often = self._made > _FIRST
        parts = count_parts(self._sensors, WHITE_BLOCK, often=often) + (not often)
        if self._drift is not None:
            ends = block * WHITE_BLOCK, (block + 1) * WHITE_BLOCK - 1
            parts += self._drift.count_parts(*(end // self._stride // DRIFT_BLOCK for end in ends))
        return parts

    def in_parts(self, block: int) -> Parts:
        """The error of the :data:`WHITE_BLOCK` samples of a block, (sensors, WHITE_BLOCK)."""
        often = self._made > _FIRST
        self._made += 1
        if self._deviation:
            error = yield from draw_in_parts((*self._key, _WHITE, block), self._sensors, WHITE_BLOCK, often=often)
            if not often:
                yield
            error *= self._deviation
        else:
            error = np.zeros((self._sensors, WHITE_BLOCK))
        if self._drift is not None:
            place, rest = np.divmod(np.arange(block * WHITE_BLOCK, (block + 1) * WHITE_BLOCK), self._stride)
            share = rest / self._stride
            for number, part in split(place, DRIFT_BLOCK):
                drift, slope = yield from self._drift.find(number)
                k = place[part] - number * DRIFT_BLOCK
                error[:, part] += drift.take(k, axis=1)
                error[:, part] += share[part] * slope.take(k, axis=1)
        return error


def split(index: NDArray[np.int64], size: int) -> list[tuple[int, slice]]:
    """Blocks of ``size`` that ascending numbers fall into, and where among the numbers each is."""
    found, start = [], 0
    while start < len(index):
        block = int(index[start]) // size
        end = int(np.searchsorted(index, (block + 1) * size))
        found.append((block, slice(start, end)))
        start = end
    return found
