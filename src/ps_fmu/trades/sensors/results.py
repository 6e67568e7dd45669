"""The trade in closed form: jitter of the line of sight over noise and corner, for each class of accelerometers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ...control.pointing import PointingFilter, PointingLaw
from ...cosim import Value, read_parameters
from ...mechanism.parameters import Array, load
from ...mechanism.quantities import replace_values
from ...sensors.inertial import InertialSensors, default_sensors
from ...sensors.line_of_sight import DEFAULT_TRACKER
from ...theory.line_of_sight import Timing
from ...theory.loop import loop_at
from ...theory.sensed_isolation import (
    Responses,
    SensedIsolation,
    estimated_bias,
    line_of_sight,
    with_noise,
)

CLASSES = ("seismic", "navigation", "tactical", "mems")
STEP = 1e-4  # s
CORNERS = np.geomspace(0.01, 4.0, 20)  # Hz, of the high-pass
CROSSOVERS = (None, 0.3, 1.25)  # Hz, of the line-of-sight loop; None: there is none; the last is the default design
DENSITIES = np.geomspace(1e-9, 1e-3, 121)  # m/s2/sqrt(Hz), of white noise
MICRO_G = 9.80665e-6  # m/s2

Pointing = tuple[PointingFilter, Timing] | None


@dataclass(frozen=True, eq=False)
class Sweep:
    """Variances of the line of sight, rad2, at the corners of the trade, (n,), with one line-of-sight loop or none."""

    disturbance: Array  # what the isolator leaves of the disturbance
    sensors: Array  # by the accelerometers' noise
    tracker: Array  # by the noise of the tracker, where there is a loop

    @property
    def rms(self) -> Array:
        """All together, (n,), rad."""
        return np.sqrt(self.disturbance + self.sensors + self.tracker)

    @property
    def best(self) -> int:
        """Place of the best corner."""
        return int(self.rms.argmin())

    def with_density(self, density: Array) -> Array:
        """RMS (densities, n), rad, where ``sensors`` is that of a density of one."""
        return np.sqrt(self.disturbance + self.tracker + self.sensors * np.square(density)[:, None])


@dataclass(frozen=True, eq=False)
class ClassResult:
    """A class of accelerometers."""

    name: str
    sensors: InertialSensors
    values: Mapping[str, Value]  # its parameter file
    sweeps: Mapping[float | None, Sweep]  # by crossover of the line-of-sight loop
    offsets: Array
    """RMS over units of the constant offset from the biases that are left, at the corners of the trade, rad."""


@dataclass(frozen=True, eq=False)
class Trade:
    """All of it."""

    isolation: SensedIsolation
    corners: Array  # of the high-pass in all sweeps, (n,), Hz
    passive: float  # RMS of the line of sight without isolator and loop, rad
    loops_alone: Mapping[float, float]  # with a loop and without isolator, by crossover, rad
    white: Mapping[float | None, Sweep]  # with white noise of a density of one, by crossover
    classes: Mapping[str, ClassResult]


def compute_trade(parameters: Path, corners: Array = CORNERS, points: int = 500) -> Trade:
    """All sweeps, from the parameter files of the classes in a folder.

    Raises CosimError or ParameterError for a file that cannot be used.
    """
    p = load()
    isolation = SensedIsolation(loop_at(p), p.bus, p.noise, STEP, points=points)
    loops = {crossover: _make_loop(crossover) for crossover in CROSSOVERS}
    base = default_sensors()
    unit = with_noise(base, 1.0)
    white = {key: _sweep(isolation, unit, corners, loop) for key, loop in loops.items()}
    classes = {name: _compute_class(isolation, name, parameters, corners, loops) for name in CLASSES}
    off = isolation.solve(None, 1.0)
    alone = {}
    for crossover, loop in loops.items():
        if crossover is not None and loop is not None:
            alone[crossover] = line_of_sight(_all_but_sensors(isolation.solve(None, 1.0, loop)))
    return Trade(isolation, corners, line_of_sight(off.covariance(off.disturbance_density)), alone, white, classes)


def read_class(parameters: Path, name: str) -> tuple[InertialSensors, dict[str, Value]]:
    """Sensors of a class, and its start values by ``component.parameter``, from its file in a folder."""
    values = dict(read_parameters(parameters / f"sensors_{name}.ssv"))
    own = {key.removeprefix("sensors."): value for key, value in values.items()}
    return replace_values(default_sensors(), own), values


def needed_density(trade: Trade, crossover: float | None, goal: float) -> float | None:
    """Largest noise density, m/s2/sqrt(Hz), at which the best corner is within a goal, rad; None: none of them."""
    within = trade.white[crossover].with_density(DENSITIES).min(axis=1) <= goal
    return float(DENSITIES[within][-1]) if within.any() else None


def _compute_class(
    isolation: SensedIsolation, name: str, parameters: Path, corners: Array, loops: Mapping[float | None, Pointing]
) -> ClassResult:
    sensors, values = read_class(parameters, name)
    offsets = [_offset(isolation.solve(sensors, corner), sensors) for corner in corners]
    sweeps = {key: _sweep(isolation, sensors, corners, loop) for key, loop in loops.items()}
    return ClassResult(name, sensors, values, sweeps, np.array(offsets))


def _offset(found: Responses, sensors: InertialSensors) -> float:
    """RMS over units of parts: each bias independent, with the spread of the class."""
    on = np.flatnonzero(sensors.enabled)
    total = 0.0
    for k in on:
        one = tuple(
            replace(each, bias=float(sensors.accelerometer.bias_spread) if i == k else 0.0)
            for i, each in enumerate(sensors.accelerometers)
        )
        quiet = replace(sensors.accelerometer, bias_spread=0.0)
        moved = found.offset(estimated_bias(replace(sensors, accelerometer=quiet, accelerometers=one)))
        total += float(moved[:2] @ moved[:2])
    return float(np.sqrt(total))


def _make_loop(crossover: float | None) -> Pointing:
    if crossover is None:
        return None
    law = PointingLaw.from_parameters(load())
    ratio = crossover / law.loop.crossover_frequency
    design = replace(law.loop, crossover_frequency=crossover, integral_frequency=ratio * law.loop.integral_frequency)
    tracker = DEFAULT_TRACKER
    timing = Timing(sample_time=tracker.sample_time, latency=tracker.latency, step=STEP)
    return law.with_design(design).controller(np.zeros(3)), timing


def _sweep(isolation: SensedIsolation, sensors: InertialSensors, corners: Array, loop: Pointing) -> Sweep:
    found = [isolation.solve(sensors, corner, loop) for corner in corners]
    parts = [
        [
            line_of_sight(one.covariance(density)) ** 2
            for density in (one.disturbance_density, one.noise_density(sensors), _tracker(one))
        ]
        for one in found
    ]
    return Sweep(*np.array(parts).T)


def _tracker(found: Responses) -> Array:
    tracker = DEFAULT_TRACKER
    return found.tracker_density(tracker.noise_equivalent_angle_P, tracker.sample_time)


def _all_but_sensors(found: Responses) -> Array:
    return found.covariance(found.disturbance_density + _tracker(found))
