"""The trade: jitter of the line of sight over noise and high-pass frequency for each class, in closed form.

Beside it runs of the FMUs, with each class at some high-pass frequencies, and with a bias.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ...control.pointing import PointingLaw
from ...cosim import System, Value, read_parameters
from ...disturbance import multisine_lines, psd_at_origin
from ...disturbance.noise import NoiseSettings
from ...interface.linear_system import Circuit
from ...interface.system_model import PLANT, POINTING, SOURCE, LinearModelError, read_model
from ...mechanism.parameters import Array, Noise, load
from ...mechanism.quantities import Complex, replace_values, take_values
from ...results.observers.sampler import SampleObserver
from ...results.observers.statistics import Statistics
from ...runs.runner import compute
from ...sensors.inertial import InertialSensors, default_sensors
from ...sensors.line_of_sight import DEFAULT_TRACKER, Tracker
from ...theory.line_of_sight import Timing
from ...theory.loop import loop_at
from ...theory.sensed_isolation import (
    Pointing,
    Responses,
    SensedIsolation,
    estimated_bias,
    line_of_sight,
    with_noise,
)

CLASSES = ("seismic", "navigation", "tactical", "mems")
STEP = 1e-4  # s
HIGHPASSES = np.geomspace(0.01, 4.0, 20)  # Hz, of the high-pass
CROSSOVERS = (None, 0.3, 1.25)  # Hz, of the line-of-sight loop; None: there is none; the last is the default design
DENSITIES = np.geomspace(1e-9, 1e-3, 121)  # m/s2/sqrt(Hz), of white noise
MICRO_G = 9.80665e-6  # m/s2

HIGHPASS = "isolator.filters.highpass_frequency"
LINE_OF_SIGHT = ("plant.payload_rotation.x", "plant.payload_rotation.y")
#: High-pass frequencies of the runs, Hz: about the best one of the class, and where noise and disturbance prevail.
MEASURED_HIGHPASSES = {
    "seismic": (0.03, 0.1, 0.3),
    "navigation": (0.3, 1.0, 3.0),
    "tactical": (0.3, 1.0, 3.0),
    "mems": (1.0, 3.0),
}
SETTLED = 0.01  # of the variance of a run: so much of it modes may have that have not settled
BIAS_HIGHPASS = 0.1  # Hz
BIASED = 3  # number of the accelerometer that has a bias of 1 ug: along z, 0.5 m from x


@dataclass(frozen=True, eq=False)
class Sweep:
    """Variances of the line of sight, rad2, at the high-pass frequencies of the trade, (n,), with one loop or none.

    Infinite where the loops are unstable: such a frequency is never the best.
    """

    disturbance: Array  # what the isolator leaves of the disturbance
    sensors: Array  # by the accelerometers' noise
    tracker: Array  # by the noise of the tracker, where there is a loop

    @property
    def rms(self) -> Array:
        """All together, (n,), rad."""
        return np.sqrt(self.disturbance + self.sensors + self.tracker)

    @property
    def best(self) -> int:
        """Place of the best high-pass frequency."""
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
    """RMS over units of the constant offset from the biases that are left, at each high-pass frequency, rad."""


@dataclass(frozen=True, eq=False)
class Design:
    """What the trade is of, but for the accelerometers' class and the high-pass frequency."""

    isolation: SensedIsolation
    law: PointingLaw  # of the line-of-sight loop
    sensors: InertialSensors  # their places
    tracker: Tracker

    @classmethod
    def of_system(cls, system: System | None, points: int) -> Design:
        """The design of a system, which has accelerometers; None: that of the paper.

        ``points``: of the integrals besides those around the resonances.  Raises LinearModelError or ParameterError:
        there is no closed form of the system, or an impossible value; UnstableError: the isolator is unstable.
        """
        p = load()
        law = PointingLaw.from_parameters(p)
        if system is None:
            isolation = SensedIsolation(loop_at(p), p.bus, p.noise, STEP, points=points)
            return cls(isolation, law, default_sensors(), DEFAULT_TRACKER)
        model = read_model(system, STEP)
        Circuit(model.without_pointing(), active=True).require_stable()
        if model.sensors is None:
            needed = "take InertialSensors.ssd, or another system with the component sensors"
            raise LinearModelError(f"{system.path.name}: the system has no accelerometers: {needed}")
        source = model.disturbance
        found = next(kind for _, _, kind in source.list_disturbances() if isinstance(kind, NoiseSettings))
        if not found.enabled or found.spectrum:
            problem = "a spectrum from a file has no place in it" if found.spectrum else "switch it on"
            where = f"{model.component(SOURCE)}.noise"
            raise LinearModelError(f"{where}: the trade is of the noise by wrench_psd; {problem}")
        known = {name: one.value for name, one in system.component(model.component(PLANT)).parameters.items()}
        if POINTING in model.components:
            own = system.component(model.component(POINTING)).parameters
            known |= {name: one.value for name, one in own.items()}
        loop = model.loop.with_delay(model.isolator_delay)
        noise = Noise(found.band, found.scale**2 * found.wrench_psd_B)
        isolation = SensedIsolation(loop, replace(p.bus, com_B=source.bus.com_B), noise, STEP, points=points)
        return cls(isolation, take_values(law, known), model.sensors, model.tracker or DEFAULT_TRACKER)


def keep_noise(system: System) -> tuple[System, list[str]]:
    """The system without start values of other disturbances than the noise, which are off then; their names."""
    left: list[str] = []
    components = []
    for one in system.components:
        own = dict(one.parameters)
        if one.source.stem == SOURCE:
            left = [name for name in own if not name.startswith(("noise.", "bus.", "seed", "rise_time"))]
            own = {name: entry for name, entry in own.items() if name not in left}
        components.append(replace(one, parameters=own))
    return replace(system, components=tuple(components)), sorted({name.partition(".")[0] for name in left})


@dataclass(frozen=True, eq=False)
class Trade:
    """All of it."""

    design: Design
    highpasses: Array  # of the high-pass in all sweeps, (n,), Hz
    passive: float  # RMS of the line of sight without isolator and loop, rad
    loops_alone: Mapping[float, float]  # with a loop and without isolator, by crossover, rad
    white: Mapping[float | None, Sweep]  # with white noise of a density of one, by crossover
    classes: Mapping[str, ClassResult]

    @property
    def isolation(self) -> SensedIsolation:
        """Plant, isolator and disturbance."""
        return self.design.isolation


def compute_trade(
    parameters: Path, highpasses: Array = HIGHPASSES, points: int = 500, system: System | None = None
) -> Trade:
    """All sweeps, from the parameter files of the classes in a folder, for a system, by default that of the paper.

    Raises CosimError or ParameterError for a file that cannot be used, and as :meth:`Design.of_system`.
    """
    design = Design.of_system(system, points)
    isolation, tracker = design.isolation, design.tracker
    loops = {crossover: _make_loop(crossover, design) for crossover in CROSSOVERS}
    unit = with_noise(design.sensors, 1.0)
    white = {key: _sweep(design, unit, highpasses, loop) for key, loop in loops.items()}
    classes = {name: _compute_class(design, name, parameters, highpasses, loops) for name in CLASSES}
    off = isolation.solve(None, 1.0)
    alone = {}
    for crossover, loop in loops.items():
        if crossover is not None and loop is not None:
            found = line_of_sight(_all_but_sensors(isolation.solve(None, 1.0, loop), tracker))
            alone[crossover] = found if isolation.is_stable(None, 1.0, loop) else np.inf
    return Trade(design, highpasses, line_of_sight(off.covariance(off.disturbance_density)), alone, white, classes)


def read_class(parameters: Path, name: str, base: InertialSensors) -> tuple[InertialSensors, dict[str, Value]]:
    """Sensors of a class in the places of others, and its start values by name, from its file in a folder."""
    values = dict(read_parameters(parameters / f"sensors_{name}.ssv"))
    own = {key.removeprefix("sensors."): value for key, value in values.items()}
    return replace_values(base, own), values


def needed_density(trade: Trade, crossover: float | None, goal: float) -> float | None:
    """Largest noise density, m/s2/sqrt(Hz), at which the best high-pass is within a goal, rad; None: none."""
    white = trade.white[crossover]
    left = goal**2 - white.disturbance - white.tracker  # for the variance by the sensors, at each frequency
    reached = left > 0.0  # of unstable loops it is not
    return float(np.sqrt((left[reached] / white.sensors[reached]).max())) if reached.any() else None


def _compute_class(
    design: Design, name: str, parameters: Path, highpasses: Array, loops: Mapping[float | None, Pointing]
) -> ClassResult:
    sensors, values = read_class(parameters, name, design.sensors)
    offsets = [_offset(design.isolation.solve(sensors, highpass), sensors) for highpass in highpasses]
    sweeps = {key: _sweep(design, sensors, highpasses, loop) for key, loop in loops.items()}
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


def _make_loop(crossover: float | None, trade_design: Design) -> Pointing:
    if crossover is None:
        return None
    law, tracker = trade_design.law, trade_design.tracker
    ratio = crossover / law.loop.crossover_frequency
    design = replace(law.loop, crossover_frequency=crossover, integral_frequency=ratio * law.loop.integral_frequency)
    timing = Timing(sample_time=tracker.sample_time, latency=tracker.latency, step=STEP)
    return law.with_design(design).controller(np.zeros(3)), timing


def _sweep(design: Design, sensors: InertialSensors, highpasses: Array, loop: Pointing) -> Sweep:
    return Sweep(*np.array([_compute_variances(design, sensors, highpass, loop) for highpass in highpasses]).T)


def _compute_variances(
    design: Design, sensors: InertialSensors, highpass: float, loop: Pointing
) -> tuple[float, float, float]:
    """By disturbance, sensors and tracker, rad2; infinite where the loops are unstable."""
    if not design.isolation.is_stable(sensors, highpass, loop):
        return np.inf, np.inf, np.inf
    one = design.isolation.solve(sensors, highpass, loop)
    left, noise, tracked = (
        line_of_sight(one.covariance(density)) ** 2
        for density in (one.disturbance_density, one.noise_density(sensors), _tracker(one, design.tracker))
    )
    return left, noise, tracked


def _tracker(found: Responses, tracker: Tracker) -> Array:
    return found.tracker_density(tracker.noise_equivalent_angle_P, tracker.sample_time)


def _all_but_sensors(found: Responses, tracker: Tracker) -> Array:
    return found.covariance(found.disturbance_density + _tracker(found, tracker))


@dataclass(frozen=True)
class Point:
    """One run, and the closed form for it."""

    name: str  # of the class
    highpass: float  # Hz
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
    highpasses: Mapping[str, tuple[float, ...]] = MEASURED_HIGHPASSES,
    progress: Callable[[], object] | None = None,
) -> list[Point]:
    """Run each class at its high-pass frequencies for ``duration``, s, after filters and modes have settled.

    Raises CosimError.  Those frequencies at which the isolator is unstable are left out.
    """
    cases = [
        (name, highpass)
        for name, of_class in highpasses.items()
        for highpass in of_class
        if trade.isolation.is_stable(trade.classes[name].sensors, highpass)
    ]
    noise, bus = trade.isolation.noise, trade.isolation.bus
    density = psd_at_origin(noise.wrench_psd_B, bus.com_B)
    frequency, wrench = multisine_lines(density, noise.band, seed, duration)
    at_lines = replace(trade.isolation, lines=frequency)
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        found = []
        starts = [find_settling(trade, at_lines, wrench, *case, 1.0 / duration) for case in cases]
        runs = pool.map(lambda each: _measure(system, trade, each, duration, seed), zip(cases, starts, strict=True))
        for case, measured in zip(cases, runs, strict=True):
            point = _compare(trade, at_lines, wrench, *case, measured, duration)
            found.append(point)
            if progress:
                progress()
    return found


def settle_highpass(highpass: float) -> float:
    """Time after which a high-pass with a frequency (Hz) has settled to e^-4, and the disturbance has risen, s."""
    return 3.0 + 4.0 / (2.0 * np.pi * highpass * np.sqrt(0.5))


def find_settling(
    trade: Trade, at_lines: SensedIsolation, wrench: Complex, name: str, highpass: float, spacing: float
) -> float:
    """Time to wait before a run is measured, s: until the high-pass has settled, and modes that matter.

    A mode begins with the amplitude that it keeps.  As exp(-decay t) it leaves, and its variance is a share of the
    whole: that of the spectral lines (n,), ``spacing`` Hz apart, beside its frequency.  The run waits until what is
    left times this share is :data:`SETTLED`.
    """
    poles, found = at_lines.loop.plant_poles(), at_lines.solve(trade.classes[name].sensors, highpass)
    whole = line_of_sight(found.covariance_of_lines(wrench)) ** 2
    times = [settle_highpass(highpass)]
    for pole in poles[(poles.imag > 0.0) & (poles.real < 0.0)]:
        beside = np.abs(at_lines.frequency - abs(pole) / (2.0 * np.pi)) <= spacing
        share = line_of_sight(found.covariance_of_lines(beside[:, None] * wrench)) ** 2 / whole
        times.append(np.log(max(share, SETTLED) / SETTLED) / -float(pole.real))
    return float(max(times))


def measure_bias(system: System, design: Design, duration: float = 10.0) -> BiasAnswer:
    """Run without disturbance and noise, with a bias of 1 ug of one accelerometer.  Raises CosimError."""
    values: dict[str, Value] = {
        **_open_loop(system),
        "disturbance.noise.enabled": False,
        "sensors.accelerometer.noise_density": 0.0,
        "sensors.accelerometer.bias_instability": 0.0,
        "sensors.accelerometer.resolution": 0.0,  # rounding would be as large as the bias
        f"sensors.accelerometer_{BIASED}.bias": MICRO_G,
        HIGHPASS: BIAS_HIGHPASS,
    }
    rows = np.arange(1, 201) * round(duration / STEP / 200)
    samples = compute(
        system.with_parameters(values), STEP, duration,
        lambda columns: SampleObserver(columns, LINE_OF_SIGHT[:1], rows.tolist()), only=LINE_OF_SIGHT,
    )  # fmt: skip
    error = design.sensors.estimator[:6, BIASED - 1] * MICRO_G
    final = float(design.isolation.solve(design.sensors, BIAS_HIGHPASS).offset(error)[0])
    time = np.asarray(rows * STEP, dtype=np.float64)
    decay = 2.0 * np.pi * BIAS_HIGHPASS * np.sqrt(0.5)  # rad/s: damping and damped frequency of a Butterworth high-pass
    rise = 1.0 - np.exp(-decay * time) * (np.cos(decay * time) + np.sin(decay * time))
    return BiasAnswer(time, samples.values(*LINE_OF_SIGHT[:1])[:, 0], final * rise)


def _open_loop(system: System) -> dict[str, Value]:
    """Start values that switch a line-of-sight loop off."""
    return {f"{one.name}.enabled": False for one in system.components if one.source.stem == POINTING}


def _measure(
    system: System, trade: Trade, case: tuple[tuple[str, float], float], duration: float, seed: int
) -> float:
    """RMS of the line of sight in a run, rad.  ``case``: class and high-pass, Hz, and the time to wait before, s."""
    (name, highpass), start = case
    values = {
        **_open_loop(system),
        **trade.classes[name].values,
        "sensors.accelerometer.bias_spread": 0.0,  # jitter alone; what a bias does is another question
        "sensors.seed": seed,
        "disturbance.seed": seed,
        "disturbance.noise.multisine": True,  # its RMS over a period has no scatter
        "disturbance.noise.period": duration,
        HIGHPASS: highpass,
    }
    statistics = compute(
        system.with_parameters(values), STEP, round((start + duration) / STEP) * STEP,
        lambda columns: Statistics(columns, LINE_OF_SIGHT, start_s=start), only=LINE_OF_SIGHT,
    )  # fmt: skip
    return float(np.linalg.norm(statistics.result().rms))


def _compare(
    trade: Trade,
    at_lines: SensedIsolation,
    wrench: Complex,
    name: str,
    highpass: float,
    measured: float,
    duration: float,
) -> Point:
    sensors = trade.classes[name].sensors
    found = trade.isolation.solve(sensors, highpass)
    noise = found.noise_density(sensors)
    covariance = at_lines.solve(sensors, highpass).covariance_of_lines(wrench) + found.covariance(noise)
    scatter = found.scatter(noise, found.disturbance_density, duration)
    return Point(name, highpass, measured, line_of_sight(covariance), scatter)
