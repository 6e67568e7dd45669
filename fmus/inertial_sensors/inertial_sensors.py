"""InertialSensors: accelerometers and rate sensors on the bus, and the base motion estimated from their readings."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from ps_fmu.interface.ports import make_parameter_ports, refuse_delays, refuse_parameters
from ps_fmu.mechanism.quantities import take_values
from ps_fmu.numerics.library import find_arithmetic
from ps_fmu.sensors.inertial import (
    ACCELEROMETERS,
    CHANNELS,
    ESTIMATES,
    N_STATES,
    PRODUCTS,
    default_sensors,
)
from ps_fmu.slavekit.author.elements import (
    Call,
    Clip,
    Delay,
    Element,
    Hold,
    Linear,
    Quantise,
    put_before_start,
    ring_size,
)
from ps_fmu.slavekit.author.model import Matrices
from ps_fmu.slavekit.author.slave import Slave
from ps_fmu.slavekit.author.variables import Port, numbered, vector

DEFAULT = default_sensors()
LONGEST_LATENCY = 200  # steps
READINGS = slice(ESTIMATES, ESTIMATES + CHANNELS)  # of the outputs
MOTIONS = (("acceleration", "m/s2"), ("angular_acceleration", "rad/s2"), ("angular_velocity", "rad/s"))


class InertialSensors(Slave):
    """Readings with the errors of real parts; noise is a function of time and seed alone."""

    model_description = "Accelerometers and rate sensors on the bus, and the base motion estimated from their readings"
    n_states: ClassVar[int] = N_STATES
    any_step: ClassVar[bool] = True
    provides_derivatives: ClassVar[bool] = True
    # Start time (s), whether a range was met, clock, readings as last sampled, past readings.
    n_memory: ClassVar[int] = 3 + CHANNELS + ring_size(CHANNELS, LONGEST_LATENCY)

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
        self.x[:] = 0.0
        self.x[:CHANNELS] = rows @ self.u + products @ [rate[i] * rate[j] for i, j in PRODUCTS]
        self.memory[:] = 0.0
        self.memory[0] = self.start_time
        interval = self.sensors.sample_time or self.default_step
        first = self.sensors.compute_errors(interval, np.zeros(1, dtype=np.int64))[0]
        readings = self._limit(self.sensors.gain * self.x[:CHANNELS] + first)
        self.kept[:] = readings
        put_before_start(self.ring, readings)
        self.y[:ESTIMATES], self.y[READINGS] = self.sensors.estimator @ readings, readings
        self.y[-1] = (np.abs(readings) >= self.sensors.ranges).any()

    def step_map(self, h: float) -> None:
        """None: elements do all."""

    def before_map(self, h: float) -> Sequence[Element]:
        """The low-passes, and readings without limits: with scale factor, bias and noise of a sample."""
        layout, memory, words = self.layout, self.layout.memory.start, self.sensors.describe()
        words.states, words.motion, words.readings = layout.x.start, layout.u.start, layout.y.start + ESTIMATES
        words.start, words.met, words.saturated = memory, memory + 1, layout.y.stop - 1
        target = [self.places(view) for view in (self.x, self.y[ESTIMATES:], self.memory[1:2])]
        return [Call(find_arithmetic().step_inertial, words, np.concatenate(target), words.kept)]

    def after_map(self, h: float) -> Sequence[Element]:
        """From readings without limits to sampled and delayed ones, and the estimates.

        Of the channels that there are: all others stay 0.
        """
        sensors, on = self.sensors, np.flatnonzero(self.sensors.enabled)
        readings, kept = (self.places(view)[on] for view in (self.y[READINGS], self.kept))
        ranges, resolutions = sensors.ranges[on], sensors.resolutions[on]
        elements: list[Element] = []
        if np.isfinite(ranges).any():
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

    def linearise(self) -> tuple[Matrices, NDArray[np.float64]]:
        """About the present angular velocity, within the ranges, without noise and resolution."""
        sensors, w = self.sensors, self.view("base_angular_velocity")
        refuse_delays(sample_time=sensors.sample_time, latency=sensors.latency)
        rows, products = sensors.reading_rows
        true, slopes = np.array([w[i] * w[j] for i, j in PRODUCTS]), np.zeros((len(PRODUCTS), 9))
        for k, (i, j) in enumerate(PRODUCTS):
            slopes[k, 6 + i] += w[j]
            slopes[k, 6 + j] += w[i]
        kinds = [sensors.accelerometer] * ACCELEROMETERS + [sensors.rate_sensor] * (CHANNELS - ACCELEROMETERS)
        A, b = (np.array(parts) for parts in zip(*(kind.lowpass.matrices for kind in kinds), strict=True))
        A, b = A * sensors.enabled[:, None, None], b * sensors.enabled[:, None]
        through = np.array([not kind.lowpass.bandwidth for kind in kinds])
        all_A = np.block([[np.diag(A[:, i, j]) for j in (0, 1)] for i in (0, 1)])
        to_states = np.vstack([np.diag(b[:, 0]), np.diag(b[:, 1])])
        readings = np.vstack([sensors.estimator, np.eye(CHANNELS), np.zeros((1, CHANNELS))])
        readings *= sensors.gain * sensors.enabled
        C = np.hstack([readings * ~through, np.zeros((self.y.size, CHANNELS))])
        turned = rows + products @ slopes
        rates = all_A @ self.x + to_states @ (rows @ self.u + products @ true)
        return (all_A, to_states @ turned, C, readings * through @ turned), rates

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
        self.kept, self.ring = np.split(self.memory[3:], [CHANNELS])

    def _limit(self, readings: NDArray[np.float64]) -> NDArray[np.float64]:
        """Readings within range, in whole steps of the resolution."""
        steps = self.sensors.resolutions
        limited = np.clip(readings, -self.sensors.ranges, self.sensors.ranges)
        whole = np.where(steps > 0.0, steps, 1.0)
        return np.where(steps > 0.0, np.rint(limited / whole) * whole, limited)
