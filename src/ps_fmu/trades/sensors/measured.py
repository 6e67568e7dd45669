"""The trade on the running FMUs: jitter with each class at some corners, and the answer to a bias."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np

from ...cosim import System, Value
from ...disturbance import multisine_lines, psd_at_origin
from ...mechanism.parameters import Array
from ...mechanism.quantities import Complex
from ...results.observers.sampler import SampleObserver
from ...results.observers.statistics import Statistics
from ...runs.runner import compute
from ...sensors.inertial import default_sensors
from ...theory.sensed_isolation import SensedIsolation, line_of_sight
from .results import MICRO_G, STEP, Trade

CORNER = "isolator.filters.highpass_frequency"
LINE_OF_SIGHT = ("plant.payload_rotation.x", "plant.payload_rotation.y")
#: Corners of the runs, Hz: about the best one of the class, and where noise and disturbance prevail.
MEASURED_CORNERS = {
    "seismic": (0.03, 0.1, 0.3),
    "navigation": (0.3, 1.0, 3.0),
    "tactical": (0.3, 1.0, 3.0),
    "mems": (1.0, 3.0),
}
BIAS_CORNER = 0.1  # Hz
BIASED = 3  # number of the accelerometer that has a bias of 1 ug: along z, 0.5 m from x


@dataclass(frozen=True)
class Point:
    """One run, and the closed form for it."""

    name: str  # of the class
    corner: float  # Hz
    measured: float  # RMS of the line of sight, rad
    expected: float  # in closed form, rad
    scatter: float  # relative standard deviation of the RMS of a record as long, in closed form, by the sensors' noise

    @property
    def deviation(self) -> float:
        """Measured over expected, less one."""
        return self.measured / self.expected - 1.0

    @property
    def deviations(self) -> float:
        """The same in standard deviations."""
        return self.deviation / self.scatter


@dataclass(frozen=True, eq=False)
class BiasAnswer:
    """Rotation of the payload about x of P after a bias of one accelerometer has begun."""

    time: Array  # (n,), s
    measured: Array  # (n,), rad
    expected: Array  # (n,), rad


def measure_points(
    system: System,
    trade: Trade,
    duration: float,
    seed: int,
    corners: Mapping[str, tuple[float, ...]] = MEASURED_CORNERS,
    progress: Callable[[], object] | None = None,
) -> list[Point]:
    """Run each class at its corners for ``duration``, s, after the filters have settled.  Raises CosimError."""
    cases = [(name, corner) for name, of_class in corners.items() for corner in of_class]
    noise, bus = trade.isolation.noise, trade.isolation.bus
    density = psd_at_origin(noise.wrench_psd_B, bus.com_B)
    frequency, wrench = multisine_lines(density, noise.band, seed, duration)
    at_lines = replace(trade.isolation, lines=frequency)
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        found = []
        runs = pool.map(lambda case: _measure(system, trade, case[0], case[1], duration, seed), cases)
        for case, measured in zip(cases, runs, strict=True):
            point = _compare(trade, at_lines, wrench, *case, measured, duration)
            found.append(point)
            if progress:
                progress()
    return found


def find_settling(corner: float) -> float:
    """Time after which a high-pass of a corner (Hz) has settled to e^-4, and the disturbance has risen, s."""
    return 3.0 + 4.0 / (2.0 * np.pi * corner * np.sqrt(0.5))


def measure_bias(system: System, isolation: SensedIsolation, duration: float = 10.0) -> BiasAnswer:
    """Run without disturbance and noise, with a bias of 1 ug of one accelerometer.  Raises CosimError."""
    values: dict[str, Value] = {
        "disturbance.noise.enabled": False,
        "sensors.accelerometer.noise_density": 0.0,
        "sensors.accelerometer.bias_instability": 0.0,
        "sensors.accelerometer.resolution": 0.0,  # rounding would be as large as the bias
        f"sensors.accelerometer_{BIASED}.bias": MICRO_G,
        CORNER: BIAS_CORNER,
    }
    rows = np.arange(1, 201) * round(duration / STEP / 200)
    samples = compute(
        system.with_parameters(values), STEP, duration,
        lambda columns: SampleObserver(columns, LINE_OF_SIGHT[:1], rows.tolist()), only=LINE_OF_SIGHT,
    )  # fmt: skip
    error = default_sensors().estimator[:6, BIASED - 1] * MICRO_G
    final = float(isolation.solve(default_sensors(), BIAS_CORNER).offset(error)[0])
    time = np.asarray(rows * STEP, dtype=np.float64)
    decay = 2.0 * np.pi * BIAS_CORNER * np.sqrt(0.5)  # rad/s: damping and damped frequency of a Butterworth corner
    rise = 1.0 - np.exp(-decay * time) * (np.cos(decay * time) + np.sin(decay * time))
    return BiasAnswer(time, samples.values(*LINE_OF_SIGHT[:1])[:, 0], final * rise)


def _measure(system: System, trade: Trade, name: str, corner: float, duration: float, seed: int) -> float:
    """RMS of the line of sight in a run, rad."""
    values = {
        **trade.classes[name].values,
        "sensors.accelerometer.bias_spread": 0.0,  # jitter alone; what a bias does is another question
        "sensors.seed": seed,
        "disturbance.seed": seed,
        "disturbance.noise.multisine": True,  # its RMS over a period has no scatter
        "disturbance.noise.period": duration,
        CORNER: corner,
    }
    start = find_settling(corner)
    statistics = compute(
        system.with_parameters(values), STEP, round((start + duration) / STEP) * STEP,
        lambda columns: Statistics(columns, LINE_OF_SIGHT, start_s=start), only=LINE_OF_SIGHT,
    )  # fmt: skip
    return float(np.linalg.norm(statistics.result().rms))


def _compare(
    trade: Trade, at_lines: SensedIsolation, wrench: Complex, name: str, corner: float, measured: float, duration: float
) -> Point:
    sensors = trade.classes[name].sensors
    found = trade.isolation.solve(sensors, corner)
    noise = found.noise_density(sensors)
    covariance = at_lines.solve(sensors, corner).covariance_of_lines(wrench) + found.covariance(noise)
    scatter = found.scatter(noise, found.disturbance_density, duration)
    return Point(name, corner, measured, line_of_sight(covariance), scatter)
