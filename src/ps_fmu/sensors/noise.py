"""Noise of several sensors of one kind as a function of the number of the sample, of seed and sensor alone.

White noise is drawn anew for each sample.  The drift is slow: it is drawn on a grid of about :data:`DRIFT_INTERVAL`,
and linear between.  An FMU needs the noise while its steps are made, so it comes in parts of 20 to 60 us.
"""

from __future__ import annotations

from array import array
from collections.abc import Generator, Sequence
from ctypes import pointer
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ..mechanism.quantities import Array
from ..numerics import library
from ..numerics.calls import Calls, ErrorKind, ErrorRoom, ErrorRows, Pair, Progress
from ..numerics.normal import Stream, make_key
from .drift import DRIFT_BLOCK, Drift
from .noise_model import NoiseModel
from .normal import finish, wrap

DRIFT_INTERVAL = 0.01  # s, a tenth of the shortest correlation time
WHITE_BLOCK = 256  # samples
_LONGEST_STRIDE = 2.0**53  # samples; steps may be as short as 1e-300 s
_WIDEST, _DRIFT = 1, 2  # tell the random numbers apart


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
        self._stride = round(min(max(1.0, DRIFT_INTERVAL / interval), _LONGEST_STRIDE))
        self._shared = library.Errors(self._deviation, sensors, WHITE_BLOCK, self._stride, DRIFT_BLOCK)
        self._shared.words[:3] = make_key(Stream.SENSOR_WHITE, *wrap((*self._key, 0)))[:3]  # the block follows
        self._drift = None
        if model.instability > 0.0 or model.random_walk > 0.0:
            self._drift = Drift(model, sensors, self._stride * interval, self._key, (_WIDEST, _DRIFT))

    def __call__(self, index: NDArray[np.int64]) -> Array:
        """The error of the samples of these numbers (n,), 0 or greater and ascending, (n, sensors)."""
        errors, room = np.empty((len(index), self._sensors)), np.zeros((WHITE_BLOCK, self._sensors))
        for block, part in split(index, WHITE_BLOCK):
            kind = finish(self.find_kind(block, 1, 0))
            Calls(make_calls(ErrorRoom(library.find_address(room)), [kind], index[part], errors[part])).finish()
        return errors

    def count_parts(self, block: int, n: int) -> int:
        """In how many parts so many blocks are nearly always made, but for calls."""
        return 0 if self._drift is None else self._drift.count_parts(*self._find_drift(block, n))

    def find_kind(self, block: int, n: int, column: int) -> Generator[None, None, ErrorKind]:
        """What makes the errors of n blocks of samples, in columns of rows from ``column`` on; in parts."""
        kind = ErrorKind(pointer(self._shared), column=column)
        if self._drift is not None:
            first, last = self._find_drift(block, n)
            drift = []
            for number in range(first, last + 1):
                drift.append((yield from self._drift.find(number)))
            addresses = array("Q", map(library.find_address, drift))  # a ctypes array would make a type for this length
            kind.drift, kind.first_drift = addresses.buffer_info()[0], first
            kind.kept = drift, addresses
        return kind

    def _find_drift(self, block: int, n: int) -> tuple[int, int]:
        """The first and the last block of the drift in n blocks of samples."""
        ends = block * WHITE_BLOCK, (block + n) * WHITE_BLOCK - 1
        first, last = (end // self._stride // DRIFT_BLOCK for end in ends)
        return first, last


def make_calls(
    room: ErrorRoom,
    kinds: Sequence[ErrorKind],
    index: NDArray[np.int64],
    errors: Array,
    bias: Array | None = None,
    gain: Array | None = None,
    at_once: int = 1,
) -> list[Pair]:
    """Errors (n, columns) of samples (n,), contiguous, as calls for so many blocks each.

    The caller keeps the arrays and the room, which has place for so many blocks.  What is in it is not drawn again.
    ``bias`` and ``gain``, of each column: what is added to the errors, and what they are then multiplied by.
    """
    if not len(index):
        return []
    addresses = (None if array is None else library.find_address(array) for array in (bias, gain))
    given = ErrorRows(
        Progress(library.find_address(errors), len(index), at_once), pointer(room), (ErrorKind * len(kinds))(*kinds),
        index.__array_interface__["data"][0], *addresses, len(kinds), WHITE_BLOCK, errors.shape[1],
    )  # fmt: skip
    given.kept = kinds
    first, last = int(index[0]) // WHITE_BLOCK, int(index[-1]) // WHITE_BLOCK
    n = -(-(last + 1 - first) // at_once) + (at_once > 1)  # one more where the first is in the room, others are not
    return [(library.find_arithmetic().make_some_errors, given)] * n


def split(index: NDArray[np.int64], size: int) -> list[tuple[int, slice]]:
    """Blocks of ``size`` that ascending numbers fall into, and where among the numbers each is."""
    blocks = index // size
    edges = [0, *(np.flatnonzero(blocks[1:] != blocks[:-1]) + 1).tolist(), len(blocks)]
    return [(int(blocks[start]), slice(start, end)) for start, end in pairwise(edges) if end > start]
