"""InertialSensors: accelerometers and rate sensors on the bus, and the base motion estimated from their readings."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from ps_fmu.interface.ports import make_parameter_ports, refuse_parameters
from ps_fmu.mechanism.quantities import take_values
from ps_fmu.sensors.inertial import (
    ACCELEROMETERS,
    CHANNELS,
    ESTIMATES,
    N_STATES,
    PRODUCTS,
    ChannelNoise,
    default_sensors,
)
from ps_fmu.slavekit.author.ahead import RowParts
from ps_fmu.slavekit.author.elements import (
    Clip,
    Delay,
    Element,
    Hold,
    Linear,
    Product,
    Quantise,
    Watch,
    put_before_start,
    ring_size,
)
from ps_fmu.slavekit.author.slave import Slave
from ps_fmu.slavekit.author.variables import Port, numbered, vector

DEFAULT = default_sensors()
LONGEST_LATENCY = 200  # steps
KEPT_NOISE = 4  # sample intervals whose noise is kept: hosts may alternate step sizes
READINGS = slice(ESTIMATES, ESTIMATES + CHANNELS)  # of the outputs
MOTIONS = (("acceleration", "m/s2"), ("angular_acceleration", "rad/s2"), ("angular_velocity", "rad/s"))


class InertialSensors(Slave):
    """Readings with the errors of real parts; noise is a function of time and seed alone."""

    model_description = "Accelerometers and rate sensors on the bus, and the base motion estimated from their readings"
    n_states: ClassVar[int] = N_STATES
    n_auxiliary: ClassVar[int] = len(PRODUCTS)  # of the angular velocity, for the centripetal acceleration
    n_row: ClassVar[int] = CHANNELS  # bias and noise of each reading
    block_rows: ClassVar[int] = 2048
    # Start time (s), whether a range was met, clock, zeros, readings as last sampled, past readings.
    n_memory: ClassVar[int] = 3 + 2 * CHANNELS + ring_size(CHANNELS, LONGEST_LATENCY)

    ports: ClassVar[tuple[Port, ...]] = (
        *(
            port
            for name, unit in MOTIONS
            for port in vector(
                f"base_{name}", "xyz", unit, f"True {name.replace('_', ' ')} of B, in B",
                causality="input", nominal=1e-3,
            )
        ),
        *(
            port
            for name, unit in MOTIONS
            for port in vector(
                f"estimated_{name}", "xyz", unit, f"Estimated {name.replace('_', ' ')} of B, in B",
                causality="output", nominal=1e-3,
            )
        ),
        *numbered(
            "channel", ACCELEROMETERS, "m/s2", "Reading of an accelerometer; 0 if it is not enabled",
            causality="output", nominal=1e-3,
        ),
        *numbered(
            "rate_channel", CHANNELS - ACCELEROMETERS, "rad/s", "Reading of a rate sensor; 0 if it is not enabled",
            causality="output", nominal=1e-3,
        ),
        Port("saturated", "output", type="Boolean", description="True: a reading is at the range of its sensor"),
        *make_parameter_ports(DEFAULT),
    )  # fmt: skip

    @refuse_parameters
    def configure(self) -> None:
        """Build the sensors; low-passes settled at the present motion, which the first readings are of."""
        self._build()
        rows, products = self.sensors.reading_rows
        rate = self.view("base_angular_velocity")
        self.a[:] = [rate[i] * rate[j] for i, j in PRODUCTS]
        self.x[:] = 0.0
        self.x[:CHANNELS] = rows @ self.u + products @ self.a
        self.memory[:] = 0.0
        self.memory[0] = self.start_time
        interval = self.sensors.sample_time or self.default_step
        first = self._find_noise(interval)(np.zeros(1, dtype=np.int64))[0]
        readings = self._limit(self.sensors.gain * self.x[:CHANNELS] + first)
        self.kept[:] = readings
        put_before_start(self.ring, readings)
        self.y[:ESTIMATES], self.y[READINGS] = self.sensors.estimator @ readings, readings
        self.y[-1] = (np.abs(readings) >= self.sensors.ranges).any()

    def before_map(self, h: float) -> Sequence[Element]:
        """Products of the angular velocity."""
        places = self.places(self.view("base_angular_velocity"))
        return [Product(places[[i for i, _ in PRODUCTS]], places[[j for _, j in PRODUCTS]], self.a)]

    def step_map(self, h: float) -> NDArray[np.float64]:
        """[y; x] at the end of a step from [x; u; a; r]: readings before limits, without estimates."""
        states, outputs = self._make_parts(h)
        whole = outputs[:, :N_STATES] @ states
        whole[:, N_STATES:] += outputs[:, N_STATES:]
        return np.vstack([whole, states])

    def split_map(self, h: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The low-passes, then readings before limits from them and the noise."""
        return self._make_parts(h)

    def _make_parts(self, h: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        Ad, by_motion, by_products = self.sensors.motion_map(h)
        states = np.hstack([Ad, by_motion, by_products, np.zeros((N_STATES, CHANNELS))])
        outputs = np.zeros((self.y.size, states.shape[1]))
        outputs[READINGS, :CHANNELS] = np.diag(self.sensors.gain * self.sensors.enabled)
        outputs[READINGS, -CHANNELS:] = np.diag(self.sensors.enabled)
        return states, outputs

    def after_map(self, h: float) -> Sequence[Element]:
        """From readings without limits to sampled and delayed ones, and the estimates.

        Of the channels that there are: all others stay 0.
        """
        sensors, on = self.sensors, np.flatnonzero(self.sensors.enabled)
        readings, kept = (self.places(view)[on] for view in (self.y[READINGS], self.kept))
        ranges, resolutions = sensors.ranges[on], sensors.resolutions[on]
        elements: list[Element] = []
        if np.isfinite(ranges).any():
            if not self.memory[1]:
                elements.append(Watch(readings, self.places(self.zeros)[on], ranges))
            elements.append(Clip(readings, -ranges, ranges, "saturated"))
        if resolutions.any():
            elements.append(Quantise(readings, resolutions))
        hold = Hold(readings, kept, self.memory[2:3], sensors.sample_time) if sensors.sample_time else None
        if hold:
            elements.append(hold)
        if sensors.latency:
            elements.append(Delay(self.y[READINGS], self.ring, sensors.latency, hold))
        seen = np.flatnonzero(sensors.estimator.any(axis=1))
        estimates = self.places(self.y[:ESTIMATES])[seen]
        return [*elements, Linear(readings, sensors.estimator[np.ix_(seen, on)], estimates)]

    def rows(self, t: float, h: float, n: int) -> RowParts:
        """Bias and noise of the readings at the ends of n steps, (n, CHANNELS), m/s2 and rad/s, in parts."""
        yield n // 200  # the step at the end of the last table does nothing else
        noise = self._find_noise(self.sensors.sample_time or h)
        index = noise.find_samples(self.times(t, h, n) - self.memory[0])
        yield n // 200
        return (yield from noise.in_parts(index))

    def event(self, t: float, h: float) -> bool:
        """A reading has met the range of its sensor for the first time."""
        sensors = self.sensors
        met = np.flatnonzero(np.abs(self.y[READINGS]) >= sensors.ranges - sensors.resolutions)
        names = [self.layout.describe(self.layout.y.start + ESTIMATES + int(k)) for k in met]
        self.memory[1] = 1.0
        self.remap()
        self.warning(
            f"at t = {t:.9g} s {', '.join(names) or 'a reading'} met the range of its sensor "
            f"({sensors.accelerometer.range:g} m/s2, {sensors.rate_sensor.range:g} rad/s; 0 = no limit): the estimates "
            "are wrong as long as the output saturated is true"
        )
        return False

    @refuse_parameters
    def restore(self) -> None:
        """Rebuild the sensors that the restored parameters stand for."""
        self._build()

    def _build(self) -> None:
        values = self.parameters()
        if getattr(self, "built_from", None) != values:
            sensors = take_values(DEFAULT, values)
            _ = sensors.estimator  # refuses a geometry that cannot see all motion
            self.sensors, self.built_from = sensors, values
            self.noises: dict[float, ChannelNoise] = {}
        zeros, kept = 3, 3 + CHANNELS
        self.zeros, self.kept = self.memory[zeros:kept], self.memory[kept : kept + CHANNELS]
        self.ring = self.memory[kept + CHANNELS :]

    def _limit(self, readings: NDArray[np.float64]) -> NDArray[np.float64]:
        """Readings within range, in whole steps of the resolution."""
        steps = self.sensors.resolutions
        limited = np.clip(readings, -self.sensors.ranges, self.sensors.ranges)
        whole = np.where(steps > 0.0, steps, 1.0)
        return np.where(steps > 0.0, np.rint(limited / whole) * whole, limited)

    def _find_noise(self, interval: float) -> ChannelNoise:
        if interval not in self.noises:
            if len(self.noises) == KEPT_NOISE:
                del self.noises[next(iter(self.noises))]
            self.noises[interval] = self.sensors.make_noise(interval)
        return self.noises[interval]
