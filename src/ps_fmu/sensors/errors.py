"""Random errors of inertial sensors as functions of the number of the sample, of seed and sensor alone.

**Model**, in the terms of IEEE Std 952 and 1293: white noise (velocity or angle random walk N), bias instability B and
the random walk K of acceleration or rate.  All spectra here are one-sided, as data sheets state them; those of the
standards are two-sided.  Flicker noise of level B is a sum of first-order Gauss-Markov processes, one for each decade
of correlation time.  Its spectrum is within 6 % of B^2 / (pi f) between the ends of :data:`CORRELATION_TIMES`, and flat
below.

**White noise** is drawn anew for each sample.  **The drift**, Gauss-Markov processes and a random walk, is slow: it is
drawn on a grid of about :data:`DRIFT_INTERVAL`, and linear between.  So that any place can be computed on its own, the
grid is one of several: each is :data:`DRIFT_BLOCK` times as wide as the one below, and a block of a grid is a bridge,
drawn from its number, between two neighbours of the grid above.  On the widest one the recursion starts with the run.

An FMU needs the noise while its steps are made, so it comes in parts of 20 to 60 us.
"""

from __future__ import annotations

from array import array
from collections.abc import Generator, Sequence
from ctypes import byref, pointer
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ..mechanism.quantities import Array
from ..numerics import library
from ..numerics.calls import Calls, ErrorKind, ErrorRoom, ErrorRows, Pair, Progress, finish
from ..numerics.library import find_address
from ..numerics.normal import Stream, draw_keyed, make_key, make_words, seed

#: Of the Gauss-Markov processes, s: flicker noise from 2e-4 to 2 Hz.
CORRELATION_TIMES = np.array([0.1, 1.0, 10.0, 100.0, 1000.0])


@dataclass(frozen=True)
class NoiseModel:
    """Random error of one sensor; its unit is q: m/s2 of an accelerometer, rad/s of a rate sensor."""

    density: float
    """White noise, one-sided, q/sqrt(Hz): sqrt(2) N."""
    instability: float
    """Bias instability B, q; the Allan deviation has its plateau at 0.664 B."""
    random_walk: float
    """K, q/sqrt(s)."""

    @property
    def variance(self) -> float:
        """Of each Gauss-Markov process, q2.

        The sum over correlation times tau of 4 v tau / (1 + (2 pi f tau)^2) is B^2 / (pi f) on average over a decade.
        """
        return self.instability**2 * float(np.log(10.0)) / np.pi

    def spectrum(self, frequency: Array) -> Array:
        """One-sided density at frequencies (n,) above 0 Hz, (n,), q2/Hz, of the error before it is sampled."""
        f = np.asarray(frequency)[..., None]
        tau = CORRELATION_TIMES
        flicker = (4.0 * self.variance * tau / (1.0 + (2.0 * np.pi * f * tau) ** 2)).sum(axis=-1)
        walk = 2.0 * (self.random_walk / (2.0 * np.pi * f[..., 0])) ** 2
        return np.asarray(self.density**2 + flicker + walk)


Parts = Generator[None, None, Array]
"""Work that yields between its parts, and returns what it has made."""


def draw_normal(key: Sequence[int], rows: int, columns: int) -> Array:
    """Standard normal numbers (rows, columns) that belong to whole numbers.

    A row does not depend on how many follow.
    """
    return draw_keyed(make_words(key), rows, (columns + 1) // 2)[:, :columns]


def seed_in_parts(key: Sequence[int]) -> Generator[None, None, np.random.Generator]:
    """A generator of random numbers that belong to whole numbers, in parts.

    To make one takes 10 us, but 150 us where none was made for a while and none of the code is in a cache.
    """
    sequence = seed(make_words(key))
    yield
    philox = np.random.Philox(sequence)
    yield
    return np.random.Generator(philox)


def wrap(key: Sequence[int]) -> list[int]:
    """Whole numbers as one word each."""
    return [value % 2**32 for value in key]


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
