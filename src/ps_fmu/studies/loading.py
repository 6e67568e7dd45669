"""The system of a study, of whatever maker: read as ``ps-fmu run`` reads it, and checked against the study."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from fmpy.model_description import ModelDescription

from ..cosim import Column, System, UsageError, read_parameters
from ..cosim.clock import StepClock
from ..cosim.columns import list_run_columns
from ..cosim.description import index_variables, read_descriptions
from ..cosim.errors import MissingFmuError
from ..cosim.faults.active import make_faults
from ..cosim.faults.reading import read_faults
from ..cosim.graph import Wiring, check_wiring
from ..cosim.schemes.resolving import resolve_scheme
from ..cosim.signals import read_signals
from ..cosim.ssp.reading import complete_experiment, read_any_system
from ..cosim.structure import Parameter, parse_port
from ..product.files import find_product
from ..runs.built_fmus import find_built_folder, is_own, list_models, provide_fmus
from ..runs.judge import read_judge
from ..runs.options import OptionError, RunOptions
from ..runs.scenario import Scenario
from ..runs.setup import HIGHEST_NOISE, SEED, RunSystem, limit_noise
from ..runs.warning_log import WarningLog
from .indices import check_windows, find_signals
from .signals import check_signals
from .study import Study, StudyError


def make_options(study: Study, output: Path) -> RunOptions:
    """The study as options of a run.

    Raises :class:`..runs.options.OptionError`.
    """
    scenario = Scenario(
        study.name, f"a case of the study {study.path.name}", "", study.duration_s, study.step_s,
        cases=tuple(study.runs), system=study.system.name,
    )  # fmt: skip
    return RunOptions(
        scenario,
        system=study.system,
        output=output,
        duration_s=study.duration_s,
        step_s=study.step_s,
        parameters=study.parameters,
        scheme=study.scheme,
        requirements=study.requirements,
        faults=study.faults,
        isolation=study.isolation,
        fmus=study.fmus,
        progress=False,
    )


def choose_fmus(study: Study, folder: Path | None) -> Path | None:
    """Where the FMUs of a study are sought first: in ``folder``, or in that of ps_fmu's own, built if need be.

    None: where the system says.  Raises BuildError, OSError, and CosimError for a system that cannot be read.
    """
    if folder is not None or study.system.suffix.lower() in (".ssp", ".fmu"):
        return folder
    own = find_built_folder()
    if not is_own(study.system):
        try:
            read_any_system(study.system, outside=study.outside)
            return None
        except MissingFmuError as error:
            if error.fmu.stem not in list_models(find_product().root):
                raise
    provide_fmus(own, study.system)
    return own


def choose_step(study: Study) -> Study:
    """The study with the step of its system, or else of its FMUs, where it states none itself.

    Raises CosimError for a system that cannot be read.
    """
    if study.states_step:
        return study
    system = read_any_system(study.system, study.fmus, outside=study.outside)
    stated = complete_experiment(system, read_descriptions(system, lenient=True)).step
    return study if stated is None else replace(study, step_s=stated)


def load_study_system(study: Study) -> RunSystem:
    """The system of a study; requirements, signals and windows are checked against it.

    Start values are those that the FMUs take, behind all bindings, mappings and units.

    Raises :class:`.study.StudyError`, and :class:`..cosim.CosimError` for a system that cannot be read.
    """
    warnings = WarningLog()
    with warnings.collect():
        try:
            system = _read(study, make_options(study, Path()), warnings)
        except OptionError as error:
            raise StudyError(f"{study.path}, [study], {str(error).removeprefix('--')}") from error
    if study.isolation is not None:
        try:
            study.isolation.check(system.structure)
        except UsageError as error:
            raise study.error("isolate", str(error)) from error
    columns = list_columns(study, system)
    for observed in study.observed:
        find_signals(observed, columns)
        check_windows(observed, study.step_s, study.duration_s)
    if study.signals is not None:
        check_signals(study.signals, columns, study.step_s, study.duration_s)
    return system


def list_columns(study: Study, system: RunSystem) -> tuple[Column, ...]:
    """What a run of the study can record, in order: outputs, inputs over time, outputs of the system."""
    return list_run_columns(system.structure, system.descriptions, system.inputs, study.scheme, study.step_s)


def _read(study: Study, options: RunOptions, warnings: WarningLog) -> RunSystem:
    given: dict[str, Parameter] = {}
    sets = [read_parameters(path).entries() for path in study.parameters]
    for one in sets:
        given |= one
    structure = read_any_system(study.system, study.fmus, outside=study.outside, values=sets)
    descriptions = read_descriptions(structure, lenient=True)
    disturbed = _has_disturbance(descriptions)
    if disturbed and SEED not in given:
        structure = structure.with_parameters({SEED: options.seed})
    wiring = check_wiring(structure, descriptions)
    for text in wiring.remarks:
        warnings.add(text)
    inputs = {} if study.inputs is None else read_signals(study.inputs)
    faults = None if study.faults is None else read_faults(study.faults)
    system = RunSystem(
        _settle(structure, wiring), descriptions, given, warnings=warnings, faults=faults, inputs=inputs
    )
    make_faults(faults, structure, descriptions, StepClock(0.0, study.step_s), study.scheme)
    try:
        resolve_scheme(study.scheme, structure, descriptions, study.step_s)
    except UsageError as error:
        raise study.error("rates" if study.scheme.rates else "scheme", str(error)) from error
    try:
        columns = list_columns(study, system)
    except UsageError as error:
        own = study.inputs is not None and str(error).startswith(str(study.inputs))
        raise study.error("inputs" if own else "system", str(error)) from error
    system = replace(system, judge=read_judge(options, columns))
    return limit_noise(system, study.step_s) if disturbed else system


def _has_disturbance(descriptions: Mapping[str, ModelDescription]) -> bool:
    """Whether there is a disturbance source of ps_fmu: a component of another maker may have the same name."""
    component = parse_port(SEED).component
    known = index_variables(descriptions[component]) if component in descriptions else {}
    return all(parse_port(name).variable in known for name in (SEED, HIGHEST_NOISE))


def _settle(structure: System, wiring: Wiring) -> System:
    """The system with start values as the FMUs take them, and without those that are ignored."""
    return replace(
        structure,
        components=tuple(
            replace(
                component,
                parameters={
                    name: replace(entry, value=wiring.starts[component.name][name], unit=None, defined=None,
                                  items=None, hops=())
                    for name, entry in component.parameters.items()
                    if name in wiring.starts[component.name]
                },
            )
            for component in structure.components
        ),
    )  # fmt: skip

