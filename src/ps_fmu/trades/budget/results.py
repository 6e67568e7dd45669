"""The budgets of a system: for each target of each requirement, passive and active."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from statistics import NormalDist

import numpy as np

from ...cosim import System, UsageError, read_parameters
from ...cosim.description import read_descriptions
from ...cosim.rows import make_layout
from ...cosim.structure import Parameter
from ...mechanism.quantities import Array
from ...pointing.budget import Budget, Source, UncertaintyFactors, make_budget
from ...requirements.requirement import PEAK, RMS, Requirement, Target, find_targets, read_requirements
from ...runs.setup import RunSystem
from .sources import POINTS, list_sources, select_signals
from .system_model import OUTPUT_NAMES, PLANT, Circuit, SystemModel, read_model

CASES = {"passive": False, "active": True}
BANDS = (0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0, 1000.0)  # Hz, edges between bands
_FINE, _LOWEST_DRAWN = 300, 1e-3  # bands of a cumulative curve, and where they begin, Hz


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
class Entry:
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
) -> Iterator[Entry]:
    """The budgets of all targets, passive and then active.

    ``points``: frequencies of a density besides those around the poles.  Raises ``BudgetError``, ``ParameterError``.
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
            yield Entry(model, case, each, budget, own)


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
