"""The system of a run: its wiring and start values, and what is found while it runs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

from fmpy.model_description import ModelDescription

from ..cosim import System, UsageError, Value
from ..cosim.description import convert_value, find_variable, get_unit, index_variables, read_start
from ..cosim.faults.reading import FaultFile
from ..cosim.rows import Column
from ..cosim.schemes.scheme import Scheme
from ..cosim.signals import Signal
from ..cosim.structure import Parameter, PortName, parse_port
from ..results.observers.bins import MeanObserver
from ..results.summary import FmuFile
from .index_record import IndexLog
from .judge import RunJudge
from .logs import CostLog, WarningLog
from .options import RunOptions
from .runner import Runner
from .scenario import Need
from .stored_rows import KeptRows

if TYPE_CHECKING:
    from ..interface.linear_system import Circuit

SEED = "disturbance.seed"
RECORDING_PATH = "disturbance.recording.path"
NOISE, MULTISINE = "disturbance.noise.enabled", "disturbance.noise.multisine"
DISTURBED = (Need(SEED, "parameter", "Integer"), Need(NOISE, "parameter", "Boolean"))
"""What scenarios need that set the disturbance themselves."""
LOWEST_NOISE, HIGHEST_NOISE = "disturbance.noise.band.min", "disturbance.noise.band.max"  # Hz


@dataclass(frozen=True, eq=False)
class RunSystem:
    """The system of a run: its files are read once, by :func:`load_system`."""

    structure: System
    """Wiring and start values."""
    descriptions: Mapping[str, ModelDescription]
    """Model descriptions of the FMUs by component."""
    given: Mapping[str, Parameter]
    """What the user's parameter files set, by ``component.variable``."""
    scheme: Scheme = Scheme()
    """How the FMUs exchange values, with rates that the system states."""
    warnings: WarningLog = field(default_factory=WarningLog)
    """What the user should know about the run."""
    judge: RunJudge = field(default_factory=RunJudge)
    """The requirements, and what is needed for their verdicts."""
    indices: IndexLog = field(default_factory=IndexLog)
    """The pointing error indices of the runs."""
    costs: CostLog = field(default_factory=CostLog)
    """Where the time of the runs goes, if the options ask for it."""
    faults: FaultFile | None = None
    """What happens to signals and parameters in each run."""
    inputs: Mapping[str, Signal] = field(default_factory=dict)
    """Inputs over time, by the name of an input of the system or by ``component.variable``."""
    also: frozenset[PortName] = frozenset()
    """Variables that are recorded beside the outputs."""
    columns: tuple[Column, ...] = ()
    """All that a run can record."""
    kept: KeptRows | None = None
    """Where the rows of the runs are kept in memory; None: they are written into results.nc."""
    motions: dict[str, MeanObserver] = field(default_factory=dict)
    """Mean motion of base and payload in the rows of each case that are written into results.nc."""
    circuits: dict[tuple[object, ...], Circuit] = field(default_factory=dict)
    """Linear models of cases, by their step and what they set, see :mod:`.divergence`."""
    runner: Runner | None = None
    """Has the FMUs, where they stay loaded from run to run."""

    @cached_property
    def fmus(self) -> tuple[FmuFile, ...]:
        """Name and SHA-256 of the FMU of each component."""
        return tuple(FmuFile.of(component.source) for component in self.structure.components)

    def get_start(self, name: str) -> Value:
        """The value that ``component.variable`` will start with: as set in the system, or else as its FMU has it.

        Raises :class:`ps_fmu.cosim.UsageError` for a value that is not of the variable's type or unit.
        """
        port = self.structure.find_port(name)
        entry = self.structure.component(port.component).parameters.get(port.variable)
        variable = find_variable(self.descriptions[port.component], port.variable)
        if entry is None:
            return read_start(variable)
        unit = get_unit(variable)
        if entry.unit and unit and entry.unit != unit:
            raise UsageError(f"{name} ({entry.origin}): is given in {entry.unit!r}, its unit is {unit!r}")
        try:
            return convert_value(variable, entry.value)
        except UsageError as error:
            raise UsageError(f"{name} ({entry.origin}): {error}") from error

    def get_number(self, name: str) -> float:
        """:meth:`get_start` of a number."""
        return float(self.get_start(name))

    def get_origin(self, name: str) -> str:
        """Where the start value of ``component.variable`` comes from: a file with its line, or the FMU."""
        port = self.structure.find_port(name)
        component = self.structure.component(port.component)
        entry = component.parameters.get(port.variable)
        return component.source.name if entry is None else entry.origin


def has_disturbance(descriptions: Mapping[str, ModelDescription]) -> bool:
    """Whether there is a disturbance source of ps_fmu: a component of another maker may have the same name."""
    component = parse_port(SEED).component
    known = index_variables(descriptions[component]) if component in descriptions else {}
    return all(parse_port(name).variable in known for name in (SEED, HIGHEST_NOISE))


def collect_parameters(options: RunOptions, system: RunSystem) -> dict[str, object]:
    """Options, the seed, and all start values that differ from those of the FMUs, for report and summary."""
    found: dict[str, object] = {
        "scenario": options.scenario.name,
        "duration (s)": options.duration_s,
        "step (s)": options.step_s,
        "storage step (s)": options.storage_s,
        "scheme": str(system.scheme),
        **({SEED: system.get_start(SEED)} if has_disturbance(system.descriptions) else {}),
        **({} if options.faults is None else {"faults": options.faults.name}),
    }
    for component in system.structure.components:
        variables = index_variables(system.descriptions[component.name])
        found |= {
            f"{component.name}.{name}": entry.value
            for name, entry in component.parameters.items()
            if variables[name].start is None or entry.value != read_start(variables[name])
        }
    return found
