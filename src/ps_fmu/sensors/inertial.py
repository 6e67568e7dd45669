"""Accelerometers and rate sensors on the bus: from its motion to readings, and to the estimate that an isolator takes.

The way of a signal, for sensor k::

    true reading  n_k . (a_B + alpha x r_k + w x (w x r_k))    n_k turned by the misalignment
    low-pass of the bandwidth
    (1 + scale factor error) reading + bias + noise            at each sample time
    range, resolution, hold until the next sample, latency
    least squares with the stated places and directions        as if scale factor, axis and bias were perfect

The centripetal term is read like any other and is not taken out of the estimate.
"""

from __future__ import annotations

from collections.abc import Generator, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..mechanism.quantities import Array, Checked, ParameterError, group, quantity
from ..numerics import library
from ..numerics.calls import Calls, Gather, Pair
from .geometry import centripetal_rows, estimator, geometry_rows
from .noise import WHITE_BLOCK, SensorNoise, split
from .normal import count, draw_normal, finish
from .parameters import Accelerometer, AccelerometerKind, OneSensor, RateSensor, RateSensorKind, SensorKind

ACCELEROMETERS = 12  # places for them
CHANNELS = ACCELEROMETERS + RateSensor.AXES
ESTIMATES = 9  # acceleration, angular acceleration, angular velocity
MOTION = 9  # inputs in the same order
N_STATES = 2 * CHANNELS
_BLOCKS_AT_ONCE = 3  # of noise, compiled: 50 us
_FIRST = 24  # blocks, which are made one by one: rows for them come from the system, page by page
LAST_SAMPLE = 1e13  # thirty years at 10 kHz: the noise stands still from there on
_SLOTS = slice(0, ACCELEROMETERS)
_RATES = slice(ACCELEROMETERS, CHANNELS)
_SPREAD, _LINEAR_NOISE, _RATE_NOISE = 0, 1, 2  # tell the random numbers apart


@dataclass(frozen=True, eq=False)
class InertialSensors(Checked):
    """All parameters; its scalars are those of the FMU."""

    seed: int = quantity("1", "Seed of noise and of the constant errors drawn from the spreads", at_least=0)
    sample_time: float = quantity(
        "s", "Time between samples, a multiple of the step; 0 = every step", at_least=0.0, display="ms"
    )
    latency: float = quantity(
        "s", "Pure delay of the readings, a multiple of the step", at_least=0.0, display="ms"
    )
    accelerometer: AccelerometerKind = group()
    accelerometers: tuple[Accelerometer, ...] = group()
    rate_sensor: RateSensorKind = group()
    rate_sensors: tuple[RateSensor, ...] = group()

    def __post_init__(self) -> None:
        super().__post_init__()
        if isinstance(self.seed, bool) or self.seed != int(self.seed) or self.seed < 0:
            raise ParameterError("seed", f"expected a whole number, 0 or greater, got {self.seed!r}")
        if len(self.accelerometers) != ACCELEROMETERS or len(self.rate_sensors) != RateSensor.AXES:
            expected = f"expected {ACCELEROMETERS} places and {RateSensor.AXES} rate sensors"
            raise ParameterError("accelerometers", expected)

    @cached_property
    def enabled(self) -> NDArray[np.bool_]:
        """Which channels there are, (CHANNELS,)."""
        return np.array([one.enabled for one in self.accelerometers] + [self.rate_sensor.enabled] * RateSensor.AXES)

    @cached_property
    def estimator(self) -> Array:
        """From channels to estimates, (ESTIMATES, CHANNELS).

        Raises ParameterError for accelerometers that cannot see six degrees of freedom.
        """
        on = np.flatnonzero(self.enabled[_SLOTS])
        matrix = np.zeros((ESTIMATES, CHANNELS))
        matrix[:6, on] = estimator(self._positions[on], self._axes[on])
        matrix[6:, _RATES] = self.rate_sensor.enabled * np.eye(3)
        return matrix

    @cached_property
    def reading_rows(self) -> tuple[Array, Array]:
        """From motion (CHANNELS, 9) and products of the angular velocity (CHANNELS, 6) to the true readings.

        Of the true axes, without the errors of the scale factor; channels that are not enabled have zeros.
        """
        rows, products = np.zeros((CHANNELS, MOTION)), np.zeros((CHANNELS, 6))
        turn = self._draw_misalignment()
        axes = self._axes + np.cross(turn[_SLOTS], self._axes)
        axes /= np.maximum(np.linalg.norm(axes, axis=1), 1e-300)[:, None]  # 1e-300: an axis that is not stated
        rows[_SLOTS, :6] = geometry_rows(self._positions, axes)
        products[_SLOTS] = centripetal_rows(self._positions, axes)
        rates = np.eye(3) + np.cross(turn[_RATES], np.eye(3))
        rows[_RATES, 6:] = rates / np.linalg.norm(rates, axis=1)[:, None]
        off = ~self.enabled
        rows[off], products[off] = 0.0, 0.0
        return rows, products

    @cached_property
    def gain(self) -> Array:
        """Scale factor of each channel, 1 where it is perfect, (CHANNELS,)."""
        errors = [one.scale_factor_error for one in self._all]
        return np.asarray(1.0 + np.array(errors) + self._spread("scale_factor_spread", 1))

    @cached_property
    def bias(self) -> Array:
        """Constant error of each channel, (CHANNELS,), m/s2 and rad/s; 0 of those that are not enabled."""
        errors = np.array([one.bias for one in self._all]) + self._spread("bias_spread", 0)
        return np.asarray(errors * self.enabled)

    @property
    def ranges(self) -> Array:
        """Largest reading of each channel, (CHANNELS,), infinite where there is no limit."""
        limits = self._of_kind("range")
        return np.where(limits > 0.0, limits, np.inf)

    @property
    def resolutions(self) -> Array:
        """Step of the quantised readings, (CHANNELS,); 0: none."""
        return self._of_kind("resolution")

    def make_noise(self, interval: float) -> ChannelNoise:
        """Bias and noise of the channels at samples so far apart, s."""
        return ChannelNoise(self, interval)

    def motion_map(self, h: float) -> tuple[Array, Array, Array]:
        """The low-passes over a step of ``h``, s: x(t + h) = Ad x + B_motion u + B_products p, read by x[:CHANNELS].

        Returns Ad (N_STATES, N_STATES), B_motion (N_STATES, 9), B_products (N_STATES, 6).  x = [outputs; their rates].
        """
        Ad, B = np.zeros((N_STATES, N_STATES)), np.zeros((N_STATES, CHANNELS))
        for part, kind in ((_SLOTS, self.accelerometer), (_RATES, self.rate_sensor)):
            own, drive = kind.lowpass.discretise(h)
            for i in range(2):
                rows = np.arange(part.start, part.stop) + i * CHANNELS
                for j in range(2):
                    Ad[rows, np.arange(part.start, part.stop) + j * CHANNELS] = own[i, j]
                B[rows, np.arange(part.start, part.stop)] = drive[i]
        off = np.flatnonzero(~self.enabled)
        Ad[off], Ad[off + CHANNELS] = 0.0, 0.0
        rows_motion, rows_products = self.reading_rows
        return Ad, B @ rows_motion, B @ rows_products

    @property
    def _all(self) -> tuple[OneSensor, ...]:
        return (*self.accelerometers, *self.rate_sensors)

    @cached_property
    def _positions(self) -> Array:
        return np.array([one.position_B for one in self.accelerometers])

    @cached_property
    def _axes(self) -> Array:
        return np.array([one.axis_B for one in self.accelerometers])

    def _kind_of(self, channel: int) -> SensorKind:
        return self.accelerometer if channel < ACCELEROMETERS else self.rate_sensor

    def _of_kind(self, name: str) -> Array:
        return np.array([getattr(self._kind_of(k), name) for k in range(CHANNELS)])

    def _draw_misalignment(self) -> Array:
        stated = np.array([one.misalignment_B for one in self._all])
        drawn = [self._spread("misalignment_spread", 2 + axis) for axis in range(3)]
        return np.asarray(stated + np.stack(drawn, axis=1))

    def _spread(self, name: str, number: int) -> Array:
        """The part of a constant error that is drawn, (CHANNELS,); ``number`` tells the errors apart."""
        return np.asarray(self._of_kind(name) * draw_normal((int(self.seed), _SPREAD, number), 1, CHANNELS)[0])


class ChannelNoise:
    """Bias and noise of all channels, a function of the number of the sample."""

    def __init__(self, sensors: InertialSensors, interval: float) -> None:
        self.interval = interval
        on = np.flatnonzero(sensors.enabled[_SLOTS])
        slots = int(on[-1]) + 1 if on.size else 0  # none is drawn for those behind the last that is enabled
        seed = int(sensors.seed)
        self._noises = [(0, SensorNoise(sensors.accelerometer.noise, slots, interval, seed, _LINEAR_NOISE))]
        """Each with its first column."""
        if sensors.rate_sensor.enabled:
            rates = SensorNoise(sensors.rate_sensor.noise, RateSensor.AXES, interval, seed, _RATE_NOISE)
            self._noises.append((ACCELEROMETERS, rates))
        enabled = sensors.enabled.astype(np.float64)
        self._bias = sensors.bias if sensors.bias.any() else None
        self._gain = None if enabled[:slots].all() else enabled
        """0 in gaps; None: there are none."""
        self._room: Array | None = None
        """For blocks of errors, without biases; None: a generator has it."""
        self._first, self._n = 0, 0
        """The blocks that are in it."""
        self._made = 0

    def __call__(self, index: NDArray[np.int64]) -> Array:
        """Errors of the samples of these numbers (n,), 0 or greater and ascending, (n, CHANNELS), m/s2 and rad/s."""
        return finish(self.in_parts(index))

    def in_parts(self, index: NDArray[np.int64]) -> Generator[int | Calls, None, Array]:
        """As :meth:`__call__`, in parts of 20 to 60 us; yields about how many are still to come, or calls."""
        index, errors = np.ascontiguousarray(index, dtype=np.int64), np.empty((len(index), CHANNELS))
        blocks = split(index, WHITE_BLOCK)
        runs = self._find_runs([block for block, _ in blocks])
        counts = [sum(noise.count_parts(block, n) for _, noise in self._noises) for block, n in runs.items()]
        first, last, room = self._take_room()
        work: list[Pair] = []
        for part, block in _join(blocks, runs):
            if block is not None:
                if part.start and library.find_arithmetic() is None:
                    yield sum(counts)
                first, last = block, block + runs[block]
                work += yield from self._make_blocks(block, room[: runs[block] * WHITE_BLOCK], sum(counts))
                del counts[0]
            if work:
                work.append(self._gather_later(room, first, index[part], errors[part]))
            else:
                self._gather(room, first, index[part], errors[part])
        if work:
            yield from Calls(work, room, index, errors)
        self._first, self._n, self._room = first, last - first, room
        return errors

    def _take_room(self) -> tuple[int, int, Array]:
        """First block and end of those in the room, and the room, which is this generator's from now on."""
        found = self._first, self._first + self._n, self._room
        self._n, self._room = 0, None
        first, last, room = found
        return (first, last, room) if room is not None else (0, 0, np.zeros((_BLOCKS_AT_ONCE * WHITE_BLOCK, CHANNELS)))

    def _gather(self, room: Array, first: int, index: NDArray[np.int64], errors: Array) -> None:
        """Errors of some samples, from a room that begins with a block."""
        room.take(index - first * WHITE_BLOCK, axis=0, out=errors, mode="clip")
        if self._bias is not None:
            errors += self._bias
        if self._gain is not None:
            errors *= self._gain

    def _gather_later(self, room: Array, first: int, index: NDArray[np.int64], errors: Array) -> Pair:
        """The same as a call."""
        arithmetic = library.find_arithmetic()
        assert arithmetic is not None
        bias, gain = (None if array is None else library.find_address(array) for array in (self._bias, self._gain))
        given = Gather(
            library.find_address(room), index.ctypes.data, bias, gain, library.find_address(errors),
            first * WHITE_BLOCK, len(index), CHANNELS,
        )  # fmt: skip
        return arithmetic.gather, given

    def _find_runs(self, blocks: list[int]) -> dict[int, int]:
        """Of these numbers, those of blocks to make: the first of each part, and how many of them side by side."""
        found: dict[int, int] = {}
        most = _BLOCKS_AT_ONCE if self._made >= _FIRST and library.find_arithmetic() is not None else 1
        first, n = self._first, self._n
        for block in blocks:
            if first in found and block == first + n and n < most:
                found[first] = n = n + 1
            elif not first <= block < first + n:
                first, n = block, 1
                found[block] = 1
        return found

    def _make_blocks(self, block: int, rows: Array, left: int) -> Generator[int, None, list[Pair]]:
        """Errors of blocks of samples into rows, or the calls that write them; ``left``: parts still to come."""
        n = len(rows) // WHITE_BLOCK
        calls = []
        for column, noise in self._noises:
            own = noise.count_parts(block, n)
            calls.append((yield from count(noise.store(block, rows, column), left - 1)))
            left -= own
        self._made += n
        return [call for call in calls if call is not None]

    def find_samples(self, elapsed: Array) -> NDArray[np.int64]:
        """Numbers of the last samples at times since the start (n,), s; from :data:`LAST_SAMPLE` on, that one."""
        return np.floor(np.clip(elapsed / self.interval + 1e-6, 0.0, LAST_SAMPLE)).astype(np.int64)


def _join(blocks: list[tuple[int, slice]], runs: Mapping[int, int]) -> Iterator[tuple[slice, int | None]]:
    """The parts of blocks that lie in one room, and the block that begins a run; None: what is there already."""
    begin: int | None = None
    start = end = 0
    for block, part in blocks:
        if block in runs:
            if end > start:
                yield slice(start, end), begin
            begin, start = block, part.start
        end = part.stop
    if end > start:
        yield slice(start, end), begin
