"""Accelerometers and rate sensors on the bus: from its motion to readings, and to the estimate that an isolator takes.

The way of a signal, for sensor k at r_k along the unit vector n_k, all in B::

    true reading  n_k . (a_B + alpha x r_k + w x (w x r_k))    n_k turned by the misalignment
    low-pass of the bandwidth
    (1 + scale factor error) reading + bias + noise            at each sample time
    range, resolution, hold until the next sample, latency
    least squares with the stated places and directions        as if scale factor, axis and bias were perfect

The centripetal term is read like any other and is not taken out of the estimate.

**The sensors that the FMU starts with** (:func:`default_sensors`) are three triads of seismic accelerometers about the
manipulator, no rate sensors.  The figures of the accelerometers are those of
``system/parameters/sensors_seismic.ssv``, where their sources stand.  The places are chosen: 0.5 m from the
manipulator's axis, each 120 degrees from the next, in the plane of its base.  The rate sensors, which are off, have
figures of the data sheet of Safran's STIM300 (rev. 9).
"""

from __future__ import annotations

import ctypes
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..mechanism.quantities import Array, Checked, ParameterError, group, quantity
from ..numerics import library
from ..numerics.library import find_address
from ..numerics.normal import Stream, make_key
from .errors import SensorNoise, draw_normal, wrap
from .parameters import Accelerometer, AccelerometerKind, OneSensor, RateSensor, RateSensorKind, SensorKind

#: Largest condition number of the geometry, lengths over the mean lever arm; beyond it noise is magnified as much.
LARGEST_CONDITION = 1e3
#: Products of the angular velocity, in the order of the columns of :func:`centripetal_rows`.
PRODUCTS = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))


def geometry_rows(position_B: Array, direction_B: Array) -> Array:
    """(n, 6): from acceleration of the origin of B (m/s2) and angular acceleration (rad/s2), in B, to readings.

    ``n . (alpha x r) = alpha . (r x n)``.  Both arguments (n, 3), m and unit vectors.
    """
    return np.hstack([direction_B, np.cross(position_B, direction_B)])


def centripetal_rows(position_B: Array, direction_B: Array) -> Array:
    """(n, 6): from the products w_i w_j of :data:`PRODUCTS` (rad2/s2; B) to readings, m/s2.

    ``n . (w x (w x r)) = (n . w)(w . r) - (n . r)(w . w)``.
    """
    n, r = direction_B, position_B
    rows = [
        n[:, i] * r[:, j] + (n[:, j] * r[:, i] if i != j else -np.einsum("ki,ki->k", n, r)) for i, j in PRODUCTS
    ]
    return np.stack(rows, axis=1)


def estimator(position_B: Array, direction_B: Array) -> Array:
    """(6, n): from readings to acceleration and angular acceleration of B by least squares, for equal sensors.

    Raises
    ------
    ParameterError: the sensors cannot see six degrees of freedom; the text has the motion that they do not see.
    """
    rows = geometry_rows(position_B, direction_B)
    arm = float(np.sqrt(np.mean(np.sum(position_B**2, axis=1)))) if len(rows) else 0.0
    scale = np.repeat([1.0, arm or 1.0], 3)
    scaled = rows / scale
    values, motions = np.linalg.svd(scaled)[1:] if len(rows) else (np.zeros(0), np.eye(6))
    if len(values) < 6 or values[-1] * LARGEST_CONDITION < values[0]:
        raise ParameterError("accelerometers", _explain(len(rows), motions[-1] / scale))
    return np.asarray(np.linalg.pinv(scaled) / scale[:, None])


def _explain(count: int, motion: Array) -> str:
    motion = motion / np.abs(motion).max()
    texts = [", ".join(f"{value + 0.0:.2g}" for value in np.round(part, 3)) for part in (motion[:3], motion[3:])]
    return (
        f"the {count} that are enabled cannot see six degrees of freedom: none reads an acceleration of "
        f"({texts[0]}) m/s2 with an angular acceleration of ({texts[1]}) rad/s2; expected places and directions that "
        "see every motion, for example three axes at each of three places that are not on a line"
    )


ACCELEROMETERS = 12  # places for them
CHANNELS = ACCELEROMETERS + RateSensor.AXES
ESTIMATES = 9  # acceleration, angular acceleration, angular velocity
MOTION = 9  # inputs in the same order
N_STATES = 2 * CHANNELS
_KEPT_INTERVALS = 4  # between samples, for hosts whose steps alternate
LAST_SAMPLE = 1e13  # thirty years at 10 kHz: the noise stands still from there on
_SLOTS = slice(0, ACCELEROMETERS)
_RATES = slice(ACCELEROMETERS, CHANNELS)
_LINEAR_NOISE, _RATE_NOISE = 1, 2  # tell the random numbers apart


@dataclass(frozen=True, eq=False)
class InertialSensors(Checked):
    """All parameters; its scalars are those of the FMU."""

    seed: int = quantity("1", "Seed of the noise and of the constant errors that the spreads describe", at_least=0)
    sample_time: float = quantity("s", "Time between samples; 0 = every step", at_least=0.0, display="ms")
    latency: float = quantity("s", "Pure delay of the readings", at_least=0.0, display="ms")
    accelerometer: AccelerometerKind = group()
    accelerometers: tuple[Accelerometer, ...] = group()
    rate_sensor: RateSensorKind = group()
    rate_sensors: tuple[RateSensor, ...] = group()

    def __post_init__(self) -> None:
        super().__post_init__()
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

    def make_errors(self, interval: float, intervals: int = 1) -> tuple[SensorNoise, SensorNoise]:
        """Noise of accelerometers, up to the last that is enabled, and of rate sensors: of none if they are off.

        ``interval``: between samples, s; ``intervals``: see :class:`.errors.SensorNoise`.
        """
        on = np.flatnonzero(self.enabled[_SLOTS])
        slots, rates = int(on[-1]) + 1 if on.size else 0, RateSensor.AXES if self.rate_sensor.enabled else 0
        return (
            SensorNoise(self.accelerometer.noise, slots, interval, self.seed, _LINEAR_NOISE, intervals),
            SensorNoise(self.rate_sensor.noise, rates, interval, self.seed, _RATE_NOISE, intervals),
        )

    def compute_errors(self, interval: float, index: NDArray[np.int64]) -> Array:
        """Bias and noise of all channels at samples of these numbers (n,), 0 or greater, (n, CHANNELS)."""
        errors = np.zeros((len(index), CHANNELS))
        for first, noise in zip((0, ACCELEROMETERS), self.make_errors(interval), strict=True):
            found = noise(index)
            errors[:, first : first + found.shape[1]] = found
        return np.asarray((errors + self.bias) * self.enabled)

    def describe(self) -> library.InertialSensors:
        """The sensors for the element of a step (``instruments.h``), which still needs places in a buffer."""
        on, names = np.flatnonzero(self.enabled), (ctypes.c_char_p * CHANNELS)()
        names[:] = [
            *(f"channel_{k + 1}".encode() for k in range(ACCELEROMETERS)),
            *(f"rate_channel_{k + 1}".encode() for k in range(RateSensor.AXES)),
        ]
        rows, products = (np.ascontiguousarray(rows) for rows in self.reading_rows)
        errors = self.make_errors(1.0, 1 if self.sample_time else _KEPT_INTERVALS)
        kinds = self.accelerometer, self.rate_sensor
        arrays = {"rows": rows, "products": products, "gain": self.gain, "bias": self.bias, "range": self.ranges}
        words = library.InertialSensors(sample_time=self.sample_time, last_sample=LAST_SAMPLE, n_enabled=on.size)
        words.enabled, words.names = on.ctypes.data, ctypes.addressof(names)
        for name, array in arrays.items():
            setattr(words, name, find_address(array))
        words.ranges[:] = [kind.range for kind in kinds]
        words.lowpass[:] = [library.Lowpass(kind.bandwidth, kind.order) for kind in kinds]
        words.errors[:] = [noise.words for noise in errors]
        words.kept = on, names, arrays, errors
        return words

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
        key = make_key(Stream.SENSOR_SPREAD, *wrap((self.seed, number)))
        return np.asarray(self._of_kind(name) * draw_normal(key, 1, CHANNELS)[0])


TRIADS = 3
_ARM = 0.5  # m
_PLACES = np.array([[0.0, _ARM, 0.0], [-0.433, -0.25, 0.0], [0.433, -0.25, 0.0], [0.0, 0.0, -_ARM]])  # m, in B

SEISMIC = AccelerometerKind(
    bandwidth=200.0,  # Hz
    order=2,
    noise_density=9.6e-8,  # m/s2/sqrt(Hz)
    bias_instability=5.4e-8,  # m/s2
    random_walk=0.0,  # m/s2/sqrt(s)
    range=1.0,  # m/s2
    resolution=1.2e-7,  # m/s2
    bias_spread=0.0,  # m/s2
    scale_factor_spread=0.0,
    misalignment_spread=0.0,  # rad
)
NO_RATE_SENSORS = RateSensorKind(
    enabled=False,
    bandwidth=262.0,  # Hz
    order=2,
    noise_density=6.2e-5,  # rad/s/sqrt(Hz); angle random walk 0.15 deg/sqrt(h)
    bias_instability=3.7e-6,  # rad/s; lowest Allan deviation 0.5 deg/h
    random_walk=0.0,  # rad/s/sqrt(s)
    range=7.0,  # rad/s; 400 deg/s
    resolution=0.0,  # rad/s
    bias_spread=0.0,  # rad/s
    scale_factor_spread=5e-4,
    misalignment_spread=1e-3,  # rad
)


def default_sensors() -> InertialSensors:
    """Three triads of seismic accelerometers; nine places of twelve are taken."""
    return InertialSensors(
        seed=1,
        sample_time=0.0,  # s
        latency=0.0,  # s
        accelerometer=SEISMIC,
        accelerometers=tuple(_make_accelerometer(k) for k in range(ACCELEROMETERS)),
        rate_sensor=NO_RATE_SENSORS,
        rate_sensors=tuple(RateSensor(0.0, 0.0, np.zeros(3)) for _ in range(RateSensor.AXES)),
    )


def _make_accelerometer(k: int) -> Accelerometer:
    return Accelerometer(
        enabled=k < 3 * TRIADS,
        position_B=_PLACES[k // 3],
        direction_B=np.eye(3)[k % 3],
        bias=0.0,  # m/s2
        scale_factor_error=0.0,
        misalignment_B=np.zeros(3),  # rad
    )
