"""The system of a run: the wiring, the scenario's settings, the user's parameter files, and what they add up to."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

from fmpy.model_description import ModelDescription

from ..cosim import System, UsageError, Value, read_parameters, read_system
from ..cosim.clock import StepClock
from ..cosim.description import convert_value, find_variable, get_unit, index_variables, read_descriptions, read_start
from ..cosim.faults.active import make_faults
from ..cosim.faults.reading import FaultFile, read_faults
from ..cosim.recording.thinner import select_names
from ..cosim.rows import Column, make_layout
from ..cosim.schemes.scheme import make_scheme
from ..cosim.signals import Signal
from ..cosim.structure import Parameter, parse_port
from ..results.summary import FmuFile
from .cost_log import CostLog
from .index_record import IndexLog
from .judge import RunJudge, read_judge
from .kept_rows import KeptRows
from .loaded import LoadedSystem
from .options import PARAMETERS, OptionError, RunOptions
from .warning_log import WarningLog

SEED = "disturbance.seed"
RECORDING_PATH = "disturbance.recording.path"
NOISE, MULTISINE = "disturbance.noise.enabled", "disturbance.noise.multisine"
LOWEST_NOISE, HIGHEST_NOISE = "disturbance.noise.band.min", "disturbance.noise.band.max"  # Hz
#: Highest frequency of the noise over the rate of the steps.  What is above half that rate would fold down to low
#: frequencies, where the same force moves the bus a thousand times more.
HIGHEST_PER_RATE = 0.4


@dataclass(frozen=True, eq=False)
class RunSystem:
    """The system of a run: its files are read once, by :func:`load_system`."""

    structure: System
    """Wiring and start values."""
    descriptions: Mapping[str, ModelDescription]
    """Model descriptions of the FMUs by component."""
    given: Mapping[str, Parameter]
    """What the user's parameter files set, by ``component.variable``."""
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
    kept: KeptRows | None = None
    """Where the rows of the runs are kept in memory; None: they are written into results.nc."""
    loaded: LoadedSystem | None = None
    """The FMUs, where they stay loaded from run to run."""

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


def load_system(
    options: RunOptions,
    defaults: Mapping[str, Value] | None = None,
    base: System | None = None,
    descriptions: Mapping[str, ModelDescription] | None = None,
) -> RunSystem:
    """The system of the options, with the scenario's ``defaults``, the seed, and then the user's parameter files.

    A recorded disturbance takes the place of the noise; a parameter file may switch the noise on again.
    Where the step is too long for the band of the noise, and no parameter file sets that band, the band is lowered,
    with a warning.  ``base`` and ``descriptions``: the system and its model descriptions, where they have been read.

    Raises :class:`OptionError` for a step that is too long for any noise, for requirements or a recorded disturbance
    that cannot be used, for outputs to store that there are not, and for a recorded disturbance in a scenario whose
    defaults are a recording or a multisine; :class:`ps_fmu.cosim.SystemFileError` or :class:`ps_fmu.cosim.UsageError`
    naming the file and line, and for a system without a disturbance source.
    """
    given: dict[str, Parameter] = {}
    for path in options.parameters:
        given |= read_parameters(path).entries()
    given |= {name: Parameter(value, None, PARAMETERS) for name, value in options.values.items()}
    if options.disturbance is not None and RECORDING_PATH in given:
        origin = given[RECORDING_PATH].origin
        raise OptionError(f"--disturbance: {origin} sets {RECORDING_PATH}, too; expected one of both")
    if options.disturbance is not None and {RECORDING_PATH, MULTISINE} & set(defaults or {}):
        raise OptionError(
            f"--disturbance: the scenario {options.scenario.name} has a disturbance of its own, and its results need it"
        )
    recorded = _read_disturbance(options)
    structure = read_system(options.system, options.fmus) if base is None else base
    if (source := parse_port(SEED).component) not in {component.name for component in structure.components}:
        raise UsageError(f"{options.system}: there is no component {source!r}, whose noise scenarios need: add one")
    first = {**(defaults or {}), SEED: options.seed, **({NOISE: False} if recorded else {}), **recorded}
    structure = structure.with_parameters(first).with_parameters(given)
    descriptions = read_descriptions(structure) if descriptions is None else descriptions
    faults = None if options.faults is None else read_faults(options.faults)
    clock, scheme = StepClock(0.0, options.step_s), make_scheme(options.scheme)
    seen = make_faults(faults, structure, descriptions, clock, scheme).recorded
    columns = make_layout(descriptions, seen).columns
    select_stored(columns, options.observe)
    system = RunSystem(structure, descriptions, given, judge=read_judge(options, columns), faults=faults)
    return limit_noise(system, options.step_s)


def _read_disturbance(options: RunOptions) -> dict[str, Value]:
    """Start values that make the disturbance source a recording of the options' file; none without one."""
    if options.disturbance is None:
        return {}
    from .recorded import provide_recording  # with all kinds of disturbance, which runs without one do not need

    return {RECORDING_PATH: str(provide_recording(options, options.disturbance))}


def select_stored(columns: Sequence[Column], patterns: Sequence[str]) -> list[str]:
    """Names of the columns that are stored.  Raises :class:`OptionError` for a pattern that matches none."""
    try:
        return select_names((column.name for column in columns), patterns)
    except UsageError as error:
        raise OptionError(f"--observe: {error}") from error


def collect_parameters(options: RunOptions, system: RunSystem) -> dict[str, object]:
    """Options, the seed, and all start values that differ from those of the FMUs, for report and summary."""
    found: dict[str, object] = {
        "scenario": options.scenario.name,
        "duration (s)": options.duration_s,
        "step (s)": options.step_s,
        "storage step (s)": options.storage_s,
        "scheme": str(options.scheme),
        SEED: system.get_start(SEED),
        **({} if options.faults is None else {"faults": options.faults.name}),
    }
    for component in system.structure.components:
        variables = index_variables(system.descriptions[component.name])
        found |= {
            f"{component.name}.{name}": entry.value
            for name, entry in component.parameters.items()
            if entry.value != read_start(variables[name])
        }
    return found


def identify_fmus(system: RunSystem) -> tuple[FmuFile, ...]:
    """Name and SHA-256 of each FMU of the system."""
    return tuple(FmuFile.of(component.source) for component in system.structure.components)


def limit_noise(system: RunSystem, step_s: float) -> RunSystem:
    """Have the noise end where steps [s] would fold it to low frequencies, unless a parameter file sets its end.

    Raises :class:`OptionError` for a step that is too long for any noise.
    """
    highest = HIGHEST_PER_RATE / step_s
    if HIGHEST_NOISE in system.given or not system.get_start(NOISE) or highest >= system.get_number(HIGHEST_NOISE):
        return system
    lowest = system.get_number(LOWEST_NOISE)
    if highest <= lowest:
        raise OptionError(
            f"--step: {step_s:g} s is too long for the noise, which begins at {lowest:g} Hz ({LOWEST_NOISE}): expected "
            f"less than {HIGHEST_PER_RATE / lowest:g} s, or {NOISE} set to false in a parameter file"
        )
    system.warnings.add(
        f"The noise ends at {highest:g} Hz: a step of {step_s:g} s would fold what is above down to low "
        f"frequencies ({HIGHEST_NOISE} in a parameter file overrides this)."
    )
    return replace(system, structure=system.structure.with_parameters({HIGHEST_NOISE: highest}))
