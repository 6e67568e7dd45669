"""The budgets of a system: each source of error with its spectrum and its way to the outputs of the plant, and what it
contributes to each target of each requirement, passive and active.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from statistics import NormalDist
from typing import NamedTuple

import numpy as np

from ...cosim import System
from ...cosim.description import read_descriptions
from ...cosim.rows import make_layout
from ...disturbance import Disturbance, multisine_lines
from ...disturbance.noise import NoiseSettings
from ...disturbance.recording import Recording
from ...disturbance.spectrum import edge_frequencies, gaussian_density, to_origin
from ...disturbance.tones import ToneSettings
from ...disturbance.wheels import WheelSettings
from ...interface.linear_system import Circuit
from ...interface.system_model import COILS, OUTPUT_NAMES, PLANT, SENSORS, SOURCE, TRACKER, SystemModel, read_model
from ...mechanism.quantities import Array, Complex, ParameterError
from ...pointing.budget import Budget, Source, UncertaintyFactors, make_budget
from ...pointing.modal import Resonance, find_resonances
from ...pointing.spectra import gather_lines
from ...requirements.requirement import PEAK, RMS, Requirement, Target, find_targets, read_requirements
from ...theory.transfer_matrices import place_frequencies

CASES = {"passive": False, "active": True}
BANDS = (0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0, 1000.0)  # Hz, edges between bands
_FINE, _LOWEST_DRAWN = 300, 1e-3  # bands of a cumulative curve, and where they begin, Hz
LOWEST = 1e-5  # Hz: below, responses and densities stay as they are there
POINTS, PER_POLE = 1000, 40  # of the frequencies of a density
_SAME = 1e-9  # of a frequency: lines that differ by less have the same
_FEWEST = 100  # steps of a recording
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
    def worst_rms(self) -> float:
        """With the worst phases of the wheels' lines, in the unit of the limit."""
        return self.budget.worst_rms * self.wanted.scale

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
        return f"{text}, {100.0 * share:.0f} % from {channel} {describe_band(low, high)}"

    @cached_property
    def cumulative(self) -> tuple[Array, Array]:
        """Frequencies (n,), Hz, and RMS of all below them (n,), in the unit of the limit."""
        highest = 0.5 / self.model.step
        edges = np.concatenate([[0.0], np.geomspace(_LOWEST_DRAWN, highest, _FINE)])
        densities = [
            replace(
                source, channels=(source.name,), response=np.ones((len(source.frequency), 1, 1), dtype=complex),
                spectrum=source.density()[:, None, None], phases=None,
            )
            for source in self.sources
        ]  # fmt: skip
        found = make_budget(self.budget.index, densities, edges, step=self.model.step, factors=self.budget.factors)
        return edges[1:], np.sqrt(np.maximum(np.cumsum(found.by_band), 0.0)) * self.wanted.scale


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
        resonances, sources = list_sources(Circuit(model, active), signals, points)
        for each in wanted:
            rows = [signals.index(name) for name in each.signals]
            own = tuple(select_signals(source, rows) for source in sources)
            index = each.requirement.index
            budget = make_budget(index, own, edges, step=model.step, resonances=resonances, factors=factors)
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


def list_sources(
    circuit: Circuit, signals: Sequence[str], points: int = POINTS
) -> tuple[tuple[Resonance, ...], list[Source]]:
    """The resonances of a circuit, and all its sources with their responses to outputs of the plant.

    ``points``: frequencies of a density besides those around the poles.  Raises :class:`BudgetError` for a disturbance
    that is not stationary, and for one above half the rate of the steps.
    """
    highest = 0.5 / circuit.model.step
    grid = _place(circuit, LOWEST, highest, points)
    sources = [*_list_disturbances(circuit, signals, grid, points), *_list_inner(circuit, signals, grid)]
    return find_resonances(circuit.poles, highest), sources


def select_signals(source: Source, rows: Sequence[int]) -> Source:
    """The same source for some of its signals."""
    return replace(source, response=source.response[..., list(rows), :])


class Line(NamedTuple):
    """A sine of the disturbance."""

    name: str
    frequency: float  # Hz
    wrench_B: Complex  # complex amplitude (6,), N, N.m, at the origin of B
    phase: str  # lines of equal ones have phases that are known relative to each other


def _list_disturbances(circuit: Circuit, signals: Sequence[str], grid: Array, points: int) -> Iterator[Source]:
    """Noise by axis, recording by axis, wheels by harmonic, sines."""
    lines: list[Line] = []
    try:
        Disturbance(circuit.model.disturbance)  # which names the parameter of a file that cannot be used
    except ParameterError as error:
        raise ParameterError(f"{circuit.model.component(SOURCE)}.{error.name}", error.problem) from None
    for name, number, kind in circuit.model.disturbance.list_disturbances():
        where = f"{circuit.model.component(SOURCE)}.{name}"
        if isinstance(kind, NoiseSettings):
            if kind.enabled:
                _check_rate(f"{where}.band.max", float(kind.band[1]), grid[-1])
                yield _make_noise(circuit, kind, signals, grid[-1], points)
        elif isinstance(kind, WheelSettings):
            if kind.enabled:
                lines += _list_harmonics(circuit, kind, number, where)
        elif isinstance(kind, ToneSettings):
            wrench = np.concatenate([kind.force_B, kind.torque_B]) * np.exp(1j * kind.phase)
            lines.append(Line(f"sine {number}", kind.frequency, wrench, "sines"))
        elif (source := kind.make_source(circuit.model.disturbance, number)) is not None:
            if not isinstance(source, Recording):
                raise BudgetError(f"{where}: it is not stationary, and has no budget; switch it off")
            yield _make_recording(circuit, source, signals, grid, where)
    yield from _make_lines(circuit, [line for line in lines if line.wrench_B.any()], signals, grid[-1])


def _make_noise(
    circuit: Circuit, noise: NoiseSettings, signals: Sequence[str], highest: float, points: int
) -> Source:
    """Six axes at the centre of mass of the bus: with the density of Gaussian noise, or the lines of a multisine."""
    shared, names = circuit.model.disturbance, tuple(f"noise {axis}" for axis in AXES)
    move, table = to_origin(shared.bus.com_B), noise.table
    if noise.multisine:
        inputs = noise.make_inputs(shared.bus.com_B)
        frequency, wrench = multisine_lines(inputs, noise.band, shared.seed, noise.period)
        at_centre = np.asarray(np.linalg.solve(move, wrench.T).T, dtype=complex)
        spectrum: Complex = np.asarray(0.5 * at_centre[:, :, None] * at_centre[:, None, :].conj())
    else:
        edge = edge_frequencies(noise.band, noise.period)
        between = _place(circuit, max(edge[0], LOWEST), min(edge[-1], highest), points)
        rows = edge if table is None else np.concatenate([edge, table.frequency])
        frequency = np.unique(np.concatenate([between, rows]))
        frequency = frequency[frequency <= between[-1]]
        spectrum = np.zeros((len(frequency), 6, 6), dtype=complex)
        if table is None:
            density = gaussian_density(noise.band, noise.period, frequency)
            spectrum += density[:, None, None] * (noise.scale**2 * noise.wrench_psd_B)
        else:
            of_axes = gaussian_density(noise.band, noise.period, frequency, table.root)
            spectrum[:, table.axes, table.axes] = noise.scale**2 * of_axes.T
    response = circuit.respond(frequency, signals, [SOURCE]) @ move
    return Source("noise", names, frequency, response, spectrum, lines=noise.multisine)


def _make_recording(
    circuit: Circuit, recording: Recording, signals: Sequence[str], grid: Array, where: str
) -> Source:
    """The lines of a recording, as the steps sample it: six axes at the origin of B."""
    first, last = recording.span
    edges = np.concatenate([[0.0], np.sqrt(grid[1:] * grid[:-1]), [grid[-1]]])
    step, count = circuit.model.step, round((last - first) / circuit.model.step)
    if count < _FEWEST:
        raise BudgetError(f"{where}: it lasts {last - first:g} s; a budget needs {_FEWEST} steps of {step:g} s")
    # Of one that repeats, not the first pass, which may be faded in.
    start = last if recording.repeats else first
    frequency, spectrum = gather_lines(
        lambda rows: recording(np.asarray(start + step * rows)), count, step, edges, repeats=recording.repeats
    )
    response = circuit.respond(frequency, signals, [SOURCE])
    return Source("recording", tuple(f"recording {axis}" for axis in AXES), frequency, response, spectrum, lines=True)


def _list_harmonics(circuit: Circuit, wheel: WheelSettings, number: int, where: str) -> Iterator[Line]:
    """The harmonics of a wheel at its speed."""
    if wheel.speed_profile:
        text = f"its speed comes from {wheel.speed_profile}; a budget needs a constant one: leave speed_profile empty"
        raise BudgetError(f"{where}: {text}")
    if wheel.initial_speed != wheel.final_speed:
        speeds = f"{wheel.initial_speed:g} to {wheel.final_speed:g} rad/s"
        raise BudgetError(f"{where}: its speed goes from {speeds}; a budget needs a constant one: set both alike")
    source = wheel.make_source(circuit.model.disturbance, number)
    assert source is not None  # it is on
    amplitudes = source.amplitudes(wheel.initial_speed)
    for k, order in enumerate(source.orders.tolist()):
        name = f"wheel {number} {'force' if k < len(source.force.orders) else 'torque'} {order:g}"
        # The real part of the amplitude times exp(i speed t) turns; the other way round for a negative speed.
        wrench = amplitudes[k] if wheel.initial_speed > 0.0 else amplitudes[k].conj()
        yield Line(name, order * abs(wheel.initial_speed) / (2.0 * np.pi), wrench, name)


def _make_lines(
    circuit: Circuit, lines: Sequence[Line], signals: Sequence[str], highest: float
) -> Iterator[Source]:
    """A source for the lines of each frequency: the sines as they are, wheels on average over their initial phases."""
    for line in lines:
        _check_rate(line.name, line.frequency, highest)
    groups: list[list[Line]] = []
    for line in sorted(lines, key=lambda line: line.frequency):
        if groups and line.frequency - groups[-1][0].frequency <= _SAME * line.frequency:
            groups[-1].append(line)
        else:
            groups.append([line])
    if not groups:
        return
    frequency = np.array([group[0].frequency for group in groups])
    for k, (group, response) in enumerate(zip(groups, circuit.respond(frequency, signals, [SOURCE]), strict=True)):
        phases = [line.phase for line in group]
        coherent = 0.5 * np.array([[one == other for other in phases] for one in phases])
        own = response[None] @ np.stack([line.wrench_B for line in group], axis=1)
        names = tuple(line.name for line in group)
        yield Source(names[0], names, frequency[k : k + 1], own, coherent, lines=True, phases=tuple(phases))


def _list_inner(circuit: Circuit, signals: Sequence[str], grid: Array) -> Iterator[Source]:
    """Sensors, coils and tracker: each channel independent of all others; below the grid (n,), Hz, nothing changes."""
    m, h = circuit.model, circuit.model.step
    present = [fmu for fmu in (SENSORS, COILS, TRACKER) if fmu in circuit.channels]
    if not present:
        return
    found, grid, first = circuit.respond(grid, signals, present), np.concatenate([[0.0], grid]), 0
    found = np.concatenate([found[:1], found])
    for fmu in present:
        count = len(circuit.channels[fmu])
        own = found[..., first : first + count]
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
