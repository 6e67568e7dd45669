"""What makes errors in a system: each source with its spectrum and its way to the outputs of the plant."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ...disturbance.noise import NoiseSettings
from ...disturbance.spectrum import to_origin
from ...disturbance.tones import ToneSettings
from ...disturbance.wheels import FORCE, TORQUE, WheelSettings, wheel_plane
from ...mechanism.quantities import Array, Complex
from ...pointing.budget import Source
from ...theory.transfer_matrices import place_frequencies
from .system_model import COILS, SENSORS, SOURCE, TRACKER, BudgetError, Circuit, limit_response

LOWEST = 1e-5  # Hz: below, responses and densities stay as they are there
POINTS, PER_POLE = 1000, 40  # of the frequencies of a density
AXES = ("force x", "force y", "force z", "torque x", "torque y", "torque z")


def list_sources(
    circuit: Circuit, signals: Sequence[str], points: int = POINTS
) -> tuple[tuple[str, ...], list[Source]]:
    """Names of the modes, and all sources of a circuit with their responses to outputs of the plant.

    ``points``: frequencies of a density besides those around the poles.  Raises :class:`BudgetError` for a disturbance
    that is not stationary, and for one above half the rate of the steps.
    """
    highest = 0.5 / circuit.model.step
    grid = np.concatenate([[0.0], _place(circuit, LOWEST, highest, points)])
    sources = [*_list_disturbances(circuit, signals, highest, points), *_list_inner(circuit, signals, grid)]
    modes = circuit.respond(np.array([1.0]), signals[:1], [SOURCE]).names
    return modes, sources


def select_signals(source: Source, rows: Sequence[int]) -> Source:
    """The same source for some of its signals."""
    return replace(source, response=source.response[..., list(rows), :])


class Line(NamedTuple):
    """A sine of the disturbance."""

    name: str
    frequency: float  # Hz
    wrench_B: Complex  # complex amplitude (6,), N, N.m, at the origin of B


def _list_disturbances(circuit: Circuit, signals: Sequence[str], highest: float, points: int) -> Iterator[Source]:
    """Noise by axis, wheels by harmonic, sines."""
    lines: list[Line] = []
    for name, number, kind in circuit.model.disturbance.list_disturbances():
        where = f"{circuit.model.component(SOURCE)}.{name}"
        if isinstance(kind, NoiseSettings):
            if kind.enabled:
                _check_rate(f"{where}.band.max", float(kind.band[1]), highest)
                yield _make_noise(circuit, kind, signals, points)
        elif isinstance(kind, WheelSettings):
            if kind.enabled:
                lines += _list_harmonics(kind, number, where)
        elif isinstance(kind, ToneSettings):
            wrench = np.concatenate([kind.force_B, kind.torque_B])
            lines.append(Line(f"sine {number}", kind.frequency, wrench.astype(complex)))
        elif kind.make_source(circuit.model.disturbance, number) is not None:
            raise BudgetError(f"{where}: it is not stationary, and has no budget; switch it off")
    yield from _make_lines(circuit, [line for line in lines if line.wrench_B.any()], signals, highest)


def _make_noise(circuit: Circuit, noise: NoiseSettings, signals: Sequence[str], points: int) -> Source:
    """Six axes at the centre of mass of the bus, correlated as the spectrum says."""
    low, high = map(float, noise.band)
    frequency = _place(circuit, low, high, points)
    parts = circuit.respond(frequency, signals, [SOURCE]).parts @ to_origin(circuit.model.disturbance.bus.com_B)
    spectrum = noise.scale**2 * noise.wrench_psd_B
    return Source("noise", tuple(f"noise {axis}" for axis in AXES), frequency, parts, spectrum)


def _list_harmonics(wheel: WheelSettings, number: int, where: str) -> Iterator[Line]:
    """The harmonics of a wheel at its speed: each a vector C W^2 that turns in the plane of the wheel."""
    if wheel.speed_profile:
        text = f"its speed comes from {wheel.speed_profile}; a budget needs a constant one: leave speed_profile empty"
        raise BudgetError(f"{where}: {text}")
    if wheel.initial_speed != wheel.final_speed:
        speeds = f"{wheel.initial_speed:g} to {wheel.final_speed:g} rad/s"
        raise BudgetError(f"{where}: its speed goes from {speeds}; a budget needs a constant one: set both alike")
    speed = abs(wheel.initial_speed)
    one_B, other_B = wheel_plane(wheel.spin_axis_B)
    # The real part of turning exp(i speed t) turns; the other way round for a negative speed.
    turning = one_B - 1j * np.copysign(1.0, wheel.initial_speed) * other_B
    at_origin = to_origin(wheel.position_B)
    for place, kind, harmonics in ((0, "force", FORCE), (3, "torque", TORQUE)):
        for order, coefficient in zip(harmonics.orders, harmonics.coefficients, strict=True):
            wrench = np.zeros(6, dtype=complex)
            wrench[place : place + 3] = wheel.scale * coefficient * speed**2 * turning
            frequency = order * speed / (2.0 * np.pi)
            yield Line(f"wheel {number} {kind} {order:g}", frequency, np.asarray(at_origin @ wrench))


def _make_lines(
    circuit: Circuit, lines: Sequence[Line], signals: Sequence[str], highest: float
) -> Iterator[Source]:
    """Lines as if their phases were independent: the mean over all phases where frequencies are equal."""
    for line in lines:
        _check_rate(line.name, line.frequency, highest)
    if lines:
        frequency = np.array([line.frequency for line in lines])
        parts = circuit.respond(frequency, signals, [SOURCE]).parts
        for k, line in enumerate(lines):
            own = parts[:, k : k + 1] @ line.wrench_B[:, None]
            yield Source(line.name, (line.name,), frequency[k : k + 1], own, np.array([[0.5]]), lines=True)


def _list_inner(circuit: Circuit, signals: Sequence[str], grid: Array) -> Iterator[Source]:
    """Sensors, coils and tracker: each channel independent of all others; grid (n,), Hz, begins with 0."""
    m, h = circuit.model, circuit.model.step
    present = [fmu for fmu in (SENSORS, COILS, TRACKER) if fmu in circuit.channels]
    if not present:
        return
    parts = limit_response(circuit.respond(grid[1:], signals, present))
    first = 0
    for fmu in present:
        count = len(circuit.channels[fmu])
        own = parts[..., first : first + count]
        first += count
        if fmu == SENSORS:
            assert m.sensors is not None
            kind = m.sensors.accelerometer
            interval = m.sensors.sample_time or h
            densities = kind.noise.spectrum(np.maximum(grid, LOWEST)) + kind.resolution**2 * interval / 6.0
            numbers = np.flatnonzero(m.sensors.enabled[:12]) + 1
            names = tuple(f"accelerometer {k}" for k in numbers)
            yield Source("accelerometers", names, grid, own, densities[:, None, None] * np.eye(count))
        elif fmu == COILS:
            assert m.coils is not None
            driver = m.coils.driver
            # A demand that stays at zero is not rounded to anything else.
            rounding = driver.current_resolution**2 * h / 6.0 if circuit.active else 0.0
            names = tuple(f"coil {k}" for k in range(1, count + 1))
            yield Source("coils", names, grid, own, (driver.noise**2 + rounding) * np.eye(count))
        else:
            assert m.tracker is not None
            names = tuple(f"tracker {axis}" for axis in "xyz")
            density = 2.0 * m.tracker.sample_time * m.tracker.noise_equivalent_angle_P**2
            yield Source("tracker", names, grid, own, np.diag(density))


def _place(circuit: Circuit, low: float, high: float, points: int) -> Array:
    """Frequencies, Hz, from low to high, dense around the poles."""
    grid = place_frequencies(circuit.poles, low, high, points, PER_POLE)
    grid[0], grid[-1] = low, high  # of a geometric series, but for rounding
    return grid


def _check_rate(name: str, frequency: float, highest: float) -> None:
    if frequency > highest:
        limit = f"{highest:g} Hz, half the rate of the steps"
        raise BudgetError(f"{name}: {frequency:.5g} Hz is above {limit}, and folds down")
