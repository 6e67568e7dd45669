"""Random errors of inertial sensors as functions of the number of the sample, of seed and sensor alone.

**Model**, in the terms of IEEE Std 952 and 1293: white noise (velocity or angle random walk N), bias instability B and
the random walk K of acceleration or rate.  All spectra here are one-sided, as data sheets state them; those of the
standards are two-sided.  Flicker noise of level B is a sum of first-order Gauss-Markov processes, one for each decade
of correlation time.  Its spectrum is within 6 % of B^2 / (pi f) between the ends of :data:`CORRELATION_TIMES`, and flat
below.

**White noise** is drawn anew for each sample.  **The drift**, Gauss-Markov processes and a random walk, is slow: it is
drawn on a grid of about :data:`DRIFT_INTERVAL`, and linear between.  So that any place can be computed on its own, the
grid is one of several: each is 64 times as wide as the one below, and a block of a grid is a bridge,
drawn from its number, between two neighbours of the grid above.  On the widest one the recursion starts with the run.

Compiled functions make both (``errors.h``): white noise for some samples at once, and the drift of a block for one
sensor at a time, so that the steps of an FMU make the next block in parts.
"""

from __future__ import annotations

from collections.abc import Sequence
from ctypes import addressof, byref
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..mechanism.quantities import Array
from ..numerics import library
from ..numerics.library import GRIDS, NONE, PLACES, PROCESSES, WHITE, find_address
from ..numerics.normal import Stream, draw_keyed, make_key, make_words

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


def draw_normal(key: Sequence[int], rows: int, columns: int) -> Array:
    """Standard normal numbers (rows, columns) that belong to whole numbers.

    A row does not depend on how many follow.
    """
    return draw_keyed(make_words(key), rows, (columns + 1) // 2)[:, :columns]


def wrap(key: Sequence[int]) -> list[int]:
    """Whole numbers as one word each."""
    return [value % 2**32 for value in key]


DRIFT_INTERVAL = 0.01  # s, a tenth of the shortest correlation time


class SensorNoise:
    """Samples of the random error of sensors that share a model.

    Parameters
    ----------
    model: of each sensor.
    sensors: how many.  The noise of a sensor does not depend on how many follow.
    interval: between samples, s.
    seed, kind: whole numbers, 0 or greater, from which everything is drawn.
    intervals: how many of them are kept, for steps of changing size.
    """

    def __init__(
        self, model: NoiseModel, sensors: int, interval: float, seed: int, kind: int, intervals: int = 1
    ) -> None:
        self._interval, self._sensors = interval, sensors
        streams = (library.ErrorStream * intervals)()
        kept: list[object] = [streams]
        for stream in streams:
            rooms = {
                "white": np.empty((sensors, WHITE)),
                "paths": np.empty((GRIDS - 1, 2, sensors, PLACES + 1, PROCESSES)),
                "sums": np.empty((2, sensors, 2, PLACES)),
            }
            for name, room in rooms.items():
                setattr(stream, name, find_address(room))
            stream.block = NONE
            kept.append(rooms)
        self.words = library.Errors(
            model.density, np.sqrt(model.variance), model.random_walk, DRIFT_INTERVAL, tuple(CORRELATION_TIMES),
            sensors, model.instability > 0.0 or model.random_walk > 0.0,
        )  # fmt: skip
        self.words.white_words[:] = make_key(Stream.SENSOR_WHITE, *wrap((seed, kind, 0)))  # the block follows
        self.words.drift_words[:] = make_key(Stream.SENSOR_DRIFT, *wrap((seed, kind, 0, 0)))[:4]  # grid and block, too
        self.words.streams, self.words.n_streams = addressof(streams), intervals
        self.words.kept = kept

    def __call__(self, index: NDArray[np.int64]) -> Array:
        """The error of the samples of these numbers (n,), 0 or greater and ascending, (n, sensors)."""
        samples = np.ascontiguousarray(index, dtype=np.int64)
        errors = np.empty((len(samples), self._sensors))
        library.find_arithmetic().make_errors(
            byref(self.words), self._interval, samples.ctypes.data, len(samples), find_address(errors), self._sensors
        )
        return errors
