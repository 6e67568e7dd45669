"""Makes the system of a run: the wiring, the settings of the scenario, the parameter files of the user."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from fmpy.model_description import ModelDescription

from ..cosim import System, UsageError, Value, read_parameters, read_system
from ..cosim.clock import StepClock
from ..cosim.columns import list_run_columns
from ..cosim.description import index_variables, read_descriptions
from ..cosim.faults.active import make_faults
from ..cosim.faults.reading import read_faults
from ..cosim.graph import Wiring, check_wiring
from ..cosim.recording.thinner import matches, select_names
from ..cosim.replacing import replace_components
from ..cosim.rows import Column
from ..cosim.schemes.resolving import resolve_scheme
from ..cosim.schemes.scheme import Scheme, make_scheme
from ..cosim.signals import read_signals
from ..cosim.ssp.reading import complete_experiment, fit_duration, read_any_system
from ..cosim.structure import Parameter, PortName, parse_port
from ..interface.system_model import DELAYS
from ..mechanism.quantities import ParameterError
from ..theory.sampled import round_delay
from .index_record import IndexLog
from .judge import read_judge
from .logs import WarningLog
from .options import PARAMETERS, OptionError, RunOptions
from .system import HIGHEST_NOISE, LOWEST_NOISE, MULTISINE, NOISE, RECORDING_PATH, SEED, RunSystem, has_disturbance

BASE, OWN_BASE = "plant.base", "own"
#: Highest frequency of the noise over the rate of the steps.  What is above half that rate would fold down to low
#: frequencies, where the same force moves the bus a thousand times more.
HIGHEST_PER_RATE = 0.4
SCHEME = "--scheme and --rate"
"""What an :class:`.options.OptionError` begins with that is about the order of exchange."""


class ColumnsError(UsageError):
    """Inputs over time, or outputs of the system, that cannot be."""


@dataclass(frozen=True, eq=False)
class SystemFiles:
    """What the files of a system say, before a scenario and its user change anything."""

    structure: System
    descriptions: Mapping[str, ModelDescription]
    warnings: tuple[str, ...] = ()
    instrument: Mapping[str, Parameter] = field(default_factory=dict)
    """Start values of the options' instrument, by ``component.variable``."""


def read_files(options: RunOptions) -> SystemFiles:
    """Read a system; one that is foreign as SSP says, with the values of the parameter files behind all its bindings.

    Raises :class:`ps_fmu.cosim.SystemFileError` or :class:`ps_fmu.cosim.UsageError`, naming the file and line, and
    :class:`OptionError` for an FMU that cannot take the place of a component, and an instrument that cannot be used.
    """
    warnings = WarningLog()
    if not options.scenario.foreign:
        structure = read_system(options.system, options.fmus, outside=options.outside)
        structure = _replace_components(structure, options)
        descriptions = read_descriptions(structure)
        values, texts = read_instrument_values(options.instrument, structure, descriptions)
        return SystemFiles(structure, descriptions, texts, values)
    with warnings.collect():
        sets = [read_parameters(path).entries() for path in options.parameters]
        structure = read_any_system(options.system, options.fmus, outside=options.outside, values=sets)
        structure = _replace_components(structure, options)
        descriptions = read_descriptions(structure, lenient=True)
        values, texts = read_instrument_values(options.instrument, structure, descriptions)
        return SystemFiles(structure, descriptions, (*warnings.texts, *texts), values)


def read_instrument_values(
    path: Path | None, structure: System, descriptions: Mapping[str, ModelDescription]
) -> tuple[dict[str, Parameter], tuple[str, ...]]:
    """Start values of the components for the instrument of a file, and warnings on it; none without a file.

    Raises :class:`OptionError` for an instrument that cannot be used.
    """
    if path is None:
        return {}, ()
    from ..interface.instrument_file import read_start_values  # runs without an instrument do not need it

    try:
        return read_start_values(path, structure, descriptions)
    except ParameterError as error:
        raise OptionError(f"--instrument: {path}: {error}") from error


def _replace_components(structure: System, options: RunOptions) -> System:
    try:
        return replace_components(structure, options.replace)
    except UsageError as error:
        raise OptionError(f"--replace: {str(error).removeprefix('--replace: ')}") from error


def settle_times(options: RunOptions, files: SystemFiles) -> RunOptions:
    """The options with step and duration of the system, or else of its FMUs, where none is given.

    A default duration is cut to whole steps, one of the user's has to be that.  Raises :class:`OptionError`.
    """
    if not options.is_plain:
        return options
    experiment = complete_experiment(files.structure, files.descriptions)
    step, duration = experiment.step if math.isnan(options.step_s) else options.step_s, options.duration_s
    if step is None:
        raise OptionError(f"--step: neither {options.system} nor its FMUs state a step: give it in seconds")
    if math.isnan(duration):
        if experiment.stop_time is None:
            stated = f"neither {options.system} nor its FMUs state a stop time"
            raise OptionError(f"--duration: {stated}: give it in seconds")
        duration = fit_duration(experiment.stop_time - experiment.start_time, step)
    return replace(options, step_s=step, duration_s=duration)


def load_system(
    options: RunOptions, defaults: Mapping[str, Value] | None = None, files: SystemFiles | None = None
) -> RunSystem:
    """The system of the options, with the scenario's ``defaults``, the seed, and then the user's parameter files.

    A recorded disturbance takes the place of the noise; a parameter file may switch the noise on again.
    Where the step is too long for the band of the noise, and no parameter file sets that band, the band is lowered,
    with a warning.  ``files``: those of the system, where they have been read.

    Raises :class:`OptionError` for a step that is too long for any noise, for a scheme, requirements or a recorded
    disturbance that cannot be used, for outputs to store that there are not, and for a recorded disturbance in a
    scenario whose defaults are a recording or a multisine; :class:`ps_fmu.cosim.SystemFileError` or
    :class:`ps_fmu.cosim.UsageError` naming the file and line.
    """
    files = read_files(options) if files is None else files
    given: dict[str, Parameter] = {}
    for path in options.parameters:
        given |= read_parameters(path).entries()
    described = {name: entry for name, entry in files.instrument.items() if name not in given}
    given = described | given
    given |= {name: Parameter(value, None, PARAMETERS) for name, value in options.values.items()}
    own = _read_disturbance(options, defaults or {}, given)
    structure, descriptions, foreign = files.structure, files.descriptions, options.scenario.foreign
    check_needs(options, structure, descriptions)
    disturbed = has_disturbance(descriptions)
    if disturbed and options.seed is not None:
        own[SEED] = options.seed
    elif options.seed != options.scenario.seed or (own and not disturbed):
        option = "--disturbance" if own else "--seed"
        raise OptionError(f"{option}: {options.system} has no disturbance source of ps_fmu")
    warnings = WarningLog(files.warnings)
    with warnings.collect():
        if foreign:
            structure = structure.with_parameters({name: own[name] for name in own.keys() - given.keys()})
            structure = structure.with_parameters({name: given[name] for name in (*described, *options.values)})
            wiring = check_wiring(structure, descriptions)
            for text in (*wiring.remarks, *(_list_silent(structure, options) if options.is_plain else ())):
                warnings.add(text)
            structure = settle(structure, wiring)
        else:
            structure = structure.with_parameters({**_keep_known(defaults or {}, disturbed, warnings), **own})
            structure = structure.with_parameters(given)
            for text in structure.remarks:
                warnings.add(text)
        clock, scheme = StepClock(0.0, options.step_s), _resolve_scheme(options, structure, descriptions)
    faults = None if options.faults is None else read_faults(options.faults)
    seen = make_faults(faults, structure, descriptions, clock, scheme).recorded
    inputs = {} if options.inputs is None else read_signals(options.inputs)
    also = _find_others(descriptions, options.observe) if options.is_plain else set()
    try:
        columns = list_run_columns(structure, descriptions, inputs, scheme, options.step_s, {*also, *seen})
    except UsageError as error:
        raise ColumnsError(str(error)) from error
    select_stored(columns, options.observe)
    judge = read_judge(options, columns, floats=_floats(structure, descriptions))
    system = RunSystem(
        structure, descriptions, given, scheme, warnings, judge, IndexLog(judge.list_windows()), faults=faults,
        inputs=inputs,
        also=frozenset(also), columns=columns,
    )  # fmt: skip
    source = parse_port(SEED).component
    if disturbed and parse_port(RECORDING_PATH).variable in structure.component(source).parameters:
        from .recorded import explain_drift  # with all kinds of disturbance, which other runs do not need

        for text in explain_drift(structure, source, options.duration_s):
            warnings.add(text)
    for name, set_s in list_delays(system):
        if (acts_s := round_delay(set_s, options.step_s)) != set_s:
            system.warnings.add(describe_rounding(name, system.get_origin(name), set_s, acts_s, options.step_s))
    return limit_noise(system, options.step_s) if disturbed and not options.is_plain else system


def _keep_known(defaults: Mapping[str, Value], disturbed: bool, warnings: WarningLog) -> dict[str, Value]:
    """The scenario's settings, without those of a disturbance source that there is not: a warning names them."""
    source = f"{parse_port(SEED).component}."
    left = [] if disturbed else [name for name in defaults if name.startswith(source)]
    if left:
        warnings.add(f"the system has no DisturbanceSource: the scenario does not set {', '.join(left)}")
    return {name: value for name, value in defaults.items() if name not in left}


def check_needs(options: RunOptions, structure: System, descriptions: Mapping[str, ModelDescription]) -> None:
    """Raise :class:`OptionError` for a system without a variable that its scenario sets or reads: it names all."""
    scenario = options.scenario
    absent: dict[str, list[str]] = {}
    problems = []
    for need in scenario.find_needs():
        component, name = parse_port(need.name)
        if component not in descriptions:
            absent.setdefault(component, []).append(name)
        elif not need.is_met_by(found := index_variables(descriptions[component]).get(name)):
            there = "" if found is None else f"; {name} is {found.causality}, {found.type}"
            why = f": {need.purpose}" if need.purpose else ""
            problems.append(
                f"{component} ({structure.component(component).source.name}) has no {need.causality} {name} of type "
                f"{need.type}, which the scenario {need.use}{there}{why}"
            )
    for component, names in absent.items():
        problems.append(f"there is no component {component!r}, of which the scenario uses {', '.join(names)}")
    if scenario.module and not scenario.foreign and (source := parse_port(SEED).component) not in descriptions:
        problems.append(f"there is no component {source!r}, which shakes the bus: add one")
    if problems:
        listed = "\n".join(f"- {text}" for text in problems)
        raise OptionError(
            f"--system: {options.system} does not fit the scenario {scenario.name}:\n{listed}\n"
            f"ps-fmu list {scenario.name} lists all that it uses; ps-fmu run {options.system} runs any system"
        )


def _floats(structure: System, descriptions: Mapping[str, ModelDescription]) -> bool:
    """Whether there is a plant of ps_fmu with a bus that moves as the forces on it make it."""
    component = parse_port(BASE).component
    variables = index_variables(descriptions[component]) if component in descriptions else {}
    if parse_port(BASE).variable not in variables:
        return False
    entry = structure.component(component).parameters.get(parse_port(BASE).variable)
    return (variables[parse_port(BASE).variable].start if entry is None else entry.value) == OWN_BASE


def list_delays(system: RunSystem) -> Iterator[tuple[str, float]]:
    """Name and start value, s, of each delay of an FMU of ps_fmu that steps as the run does."""
    for component in system.structure.components:
        name = DELAYS.get(component.source.stem, "")
        if name in index_variables(system.descriptions[component.name]) and component.name not in system.scheme.rates:
            yield f"{component.name}.{name}", system.get_number(f"{component.name}.{name}")


def describe_rounding(name: str, origin: str, set_s: float, acts_s: float, step_s: float) -> str:
    """What a user reads of a delay, s, that is no multiple of the step, and acts as the next one."""
    below = f"{acts_s - step_s:.6g} s or " if acts_s > step_s else ""
    return (
        f"{name}: {set_s:g} s ({origin}) is not a multiple of the step of {step_s:g} s. The FMU rounds it up: it "
        f"delays by {acts_s:.6g} s. Set {below}{acts_s:.6g} s to choose the delay."
    )


def settle(structure: System, wiring: Wiring) -> System:
    """The system with start values as the FMUs take them, behind all bindings, and without those that are ignored."""
    return replace(
        structure,
        components=tuple(
            replace(
                component,
                parameters={
                    name: replace(
                        entry, value=wiring.starts[component.name][name], unit=None, defined=None, items=None, hops=()
                    )
                    for name, entry in component.parameters.items()
                    if name in wiring.starts[component.name]
                },
            )
            for component in structure.components
        ),
    )


def _resolve_scheme(options: RunOptions, structure: System, descriptions: Mapping[str, ModelDescription]) -> Scheme:
    try:
        return resolve_scheme(make_scheme(options.scheme), structure, descriptions, options.step_s)
    except UsageError as error:
        raise OptionError(f"{SCHEME}: {error}") from error


def _find_others(descriptions: Mapping[str, ModelDescription], patterns: Sequence[str]) -> set[PortName]:
    """Variables beside the outputs that a pattern fits."""
    return {
        port
        for name, description in descriptions.items()
        for variable in description.modelVariables
        if patterns and variable.causality not in ("output", "independent") and variable.type != "String"
        for port in [PortName(name, variable.name)]
        if any(matches(str(port), pattern) for pattern in patterns)
    }


def _list_silent(system: System, options: RunOptions) -> Iterator[str]:
    """A text on the inputs of the system that keep their start values, if there are any."""
    fed = () if options.inputs is None else read_signals(options.inputs).keys()
    given = {port for c in system.components for port in (PortName(c.name, name) for name in c.parameters)}
    silent = [
        item.name
        for item in system.inputs
        if item.name not in fed and not any(port in given for port, _ in item.targets)
    ]
    if silent:
        yield f"inputs of the system that keep their start values: {', '.join(silent)}"


def _read_disturbance(
    options: RunOptions, defaults: Mapping[str, Value], given: Mapping[str, Parameter]
) -> dict[str, Value]:
    """Start values that make the disturbance source a recording of the options' file; none without one."""
    if options.disturbance is None:
        return {}
    if RECORDING_PATH in given:
        origin = given[RECORDING_PATH].origin
        raise OptionError(f"--disturbance: {origin} sets {RECORDING_PATH}, too; expected one of both")
    if {RECORDING_PATH, MULTISINE} & set(defaults):
        raise OptionError(
            f"--disturbance: the scenario {options.scenario.name} has a disturbance of its own, and its results need it"
        )
    from .recorded import provide_recording  # with all kinds of disturbance, which runs without one do not need

    return {NOISE: False, RECORDING_PATH: str(provide_recording(options, options.disturbance))}


def select_stored(columns: Sequence[Column], patterns: Sequence[str]) -> list[str]:
    """Names of the columns that are stored.  Raises :class:`OptionError` for a pattern that matches none."""
    try:
        return select_names((column.name for column in columns), patterns)
    except UsageError as error:
        raise OptionError(f"--observe: {error}") from error


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
