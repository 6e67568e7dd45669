"""The budgets of a system: each source of error with its spectrum and its way to the outputs of the plant, and what it
contributes to each target of each requirement, passive and active.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from statistics import NormalDist
from typing import NamedTuple

import numpy as np

from ...cosim import System, UsageError, read_parameters
from ...cosim.description import read_descriptions
from ...cosim.rows import make_layout
from ...cosim.structure import Parameter
from ...disturbance.noise import NoiseSettings
from ...disturbance.spectrum import to_origin
from ...disturbance.tones import ToneSettings
from ...disturbance.wheels import FORCE, TORQUE, WheelSettings, wheel_plane
from ...interface.linear_system import (
    COILS,
    OUTPUT_NAMES,
    PLANT,
    SENSORS,
    SOURCE,
    TRACKER,
    Circuit,
    SystemModel,
    limit_response,
    read_model,
)
from ...mechanism.quantities import Array, Complex
from ...pointing.budget import Budget, Source, UncertaintyFactors, make_budget
from ...requirements.requirement import PEAK, RMS, Requirement, Target, find_targets, read_requirements
from ...runs.setup import RunSystem
from ...theory.transfer_matrices import place_frequencies

CASES = {"passive": False, "active": True}
BANDS = (0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0, 1000.0)  # Hz, edges between bands
_FINE, _LOWEST_DRAWN = 300, 1e-3  # bands of a cumulative curve, and where they begin, Hz
LOWEST = 1e-5  # Hz: below, responses and densities stay as they are there
POINTS, PER_POLE = 1000, 40  # of the frequencies of a density
AXES = ("force x", "force y", "force z", "torque x", "torque y", "torque z")


class BudgetError(ValueError):
    """A source that has no budget; the text says which, and what to do."""


@dataclass(frozen=True, eq=False)
class Wanted:
    """A target of a requirement, among the outputs of the plant."""

    requirement: Requirement
    target: Target
    signals: tuple[str, ...]  # outputs of the plant, whose variances add up
    plant: str  # name of the component

    @property
    def short(self) -> str:
        """The target without the name of the plant's component."""
        return self.target.label.replace(f"{self.plant}.", "")

    @property
    def scale(self) -> float:
        """From the unit of the signals to that of the limit."""
        return self.requirement.limit.value / self.target.limit

    @property
    def gaussian_factor(self) -> float | None:
        """From the RMS to what is compared with the limit, of a Gaussian error; None where that is no matter of RMS.

        That is a peak, or a quantile of the magnitude of several signals.
        """
        if self.requirement.statistic == RMS:
            return 1.0
        if self.requirement.statistic == PEAK or len(self.signals) > 1:
            return None
        assert self.requirement.probability is not None
        return NormalDist().inv_cdf(0.5 * (1.0 + self.requirement.probability))

    @property
    def title(self) -> str:
        """For example ``RPE over 1 s, t uniform, of plant.payload_rotation.x``."""
        return f"{self.requirement.about}, of {self.target.label}"


@dataclass(frozen=True, eq=False)
class SignalBudget:
    """A budget and what it is of."""

    model: SystemModel
    case: str
    wanted: Wanted
    budget: Budget
    sources: tuple[Source, ...]

    @property
    def rms(self) -> float:
        """In the unit of the limit."""
        return self.budget.rms * self.wanted.scale

    @property
    def expected(self) -> float | None:
        """What is compared with the limit if the error is Gaussian, in its unit; None: see :class:`Wanted`."""
        factor = self.wanted.gaussian_factor
        return None if factor is None else factor * self.rms

    @property
    def sentence(self) -> str:
        """Who contributes most, with numbers."""
        unit = self.wanted.requirement.limit.unit
        text = f"{self.wanted.title}, {self.case}: {self.rms:.3g} {unit}"
        if not self.budget.variance:
            return f"{text}, nothing acts on it"
        channel, low, high, share = self.budget.dominant()
        text += f", {100.0 * share:.0f} % from {channel} {describe_band(low, high)}"
        return f"{text}, of which others take away" if share > 1.0 else text

    @cached_property
    def cumulative(self) -> tuple[Array, Array]:
        """Frequencies (n,), Hz, and RMS of all below them (n,), in the unit of the limit."""
        highest = 0.5 / self.model.step
        edges = np.concatenate([[0.0], np.geomspace(_LOWEST_DRAWN, highest, _FINE)])
        densities = [
            replace(
                source, channels=(source.name,), response=np.ones((len(source.frequency), 1, 1), dtype=complex),
                spectrum=source.density()[:, None, None],
            )
            for source in self.sources
        ]  # fmt: skip
        found = make_budget(self.budget.index, densities, edges, step=self.model.step, factors=self.budget.factors)
        return edges[1:], np.sqrt(np.maximum(np.cumsum(found.by_band), 0.0)) * self.wanted.scale


def read_with_parameters(systems: Sequence[System], files: Sequence[Path]) -> list[System]:
    """The systems with the start values of files; those of components that one does not have are left out of it.

    Raises ``CosimError``: a value of a component, parameter or unit that none of the systems has.
    """
    given: dict[str, Parameter] = {}
    for path in files:
        given |= read_parameters(path).entries()
    names = {component.name for system in systems for component in system.components}
    for name, entry in given.items():
        if name.partition(".")[0] not in names:
            raise UsageError(f"{name} ({entry.origin}): there is no such component")
    return [_set_values(system, given) for system in systems]


def list_wanted(path: Path, system: System, step: float) -> list[Wanted]:
    """The targets of the requirements of a file among the plant's outputs.

    Raises ``RequirementError``: a requirement that cannot be used, windows that are no whole steps, a signal that is
    not of the plant.
    """
    columns = make_layout(read_descriptions(system)).columns
    plant = next(component.name for component in system.components if component.source.stem == PLANT)
    found = []
    for requirement in read_requirements(path):
        requirement.check_times(step, np.inf, f" of {step:g} s")
        for target in find_targets(requirement, columns):
            names = [columns[place].name for place in target.places]
            signals = tuple(name.removeprefix(f"{plant}.") for name in names)
            if any(name not in OUTPUT_NAMES for name in signals):
                raise requirement.error("signal", f"{target.label}: a budget is of outputs of {plant}")
            found.append(Wanted(requirement, target, signals, plant))
    return found


def compute_budgets(
    system: System, wanted: Sequence[Wanted], factors: UncertaintyFactors, points: int = POINTS
) -> Iterator[SignalBudget]:
    """The budgets of all targets, passive and then active.

    ``points``: frequencies of a density besides those around the poles.  Raises ``BudgetError``, ``LinearModelError``,
    ``ParameterError``.
    """
    model = read_model(system)
    signals = tuple(dict.fromkeys(name for each in wanted for name in each.signals))
    edges = find_edges(0.5 / model.step)
    for case, active in CASES.items():
        modes, sources = list_sources(Circuit(model, active), signals, points)
        for each in wanted:
            rows = [signals.index(name) for name in each.signals]
            own = tuple(select_signals(source, rows) for source in sources)
            index = each.requirement.index
            budget = make_budget(index, own, edges, step=model.step, modes=modes, factors=factors)
            yield SignalBudget(model, case, each, budget, own)


def find_edges(highest: float) -> Array:
    """Edges of the bands up to half the rate of the steps, Hz."""
    return np.array([0.0, *(edge for edge in BANDS if edge < highest), highest])


def describe_band(low: float, high: float) -> str:
    """For example ``between 2 and 5 Hz``."""
    return f"below {high:g} Hz" if low == 0.0 else f"between {low:g} and {high:g} Hz"


def read_factors(numbers: Sequence[float]) -> UncertaintyFactors:
    """Uncertainty factors from ``factor limit factor ...``.  Raises ``ValueError``."""
    if not numbers:
        return UncertaintyFactors()
    if len(numbers) % 2 == 0:
        raise ValueError(f"--uncertainty: expected factors and between them limits in Hz, got {len(numbers)} numbers")
    try:
        return UncertaintyFactors(tuple(numbers[1::2]), tuple(numbers[::2]))
    except ValueError as error:
        raise ValueError(f"--uncertainty, {error}") from None


def _set_values(system: System, given: Mapping[str, Parameter]) -> System:
    names = {component.name for component in system.components}
    own = {name: entry for name, entry in given.items() if name.partition(".")[0] in names}
    changed = system.with_parameters(own)
    checked = RunSystem(changed, read_descriptions(changed), own)
    for name in own:
        checked.get_start(name)
    return changed


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
