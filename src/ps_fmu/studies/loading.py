"""The system of a study, of whatever maker: read as ``ps-fmu run`` reads it, and checked against the study."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from ..cosim import Column, UsageError
from ..cosim.columns import list_run_columns
from ..cosim.description import read_descriptions
from ..cosim.errors import MissingFmuError
from ..cosim.ssp.single import complete_experiment, read_any_system
from ..product.files import find_product
from ..runs.built_fmus import find_built_folder, is_own, list_models, provide_fmus
from ..runs.options import OptionError, RunOptions
from ..runs.scenario import Scenario
from ..runs.setup import SCHEME, ColumnsError, RunSystem, load_system
from .indices import check_windows, find_signals
from .signals import check_signals
from .study import Study, StudyError


def make_options(study: Study, output: Path) -> RunOptions:
    """The study as options of a run.

    Raises :class:`..runs.options.OptionError`.
    """
    scenario = Scenario(
        study.name, f"a case of the study {study.path.name}", "", study.duration_s, study.step_s,
        cases=tuple(study.runs), system=study.system.name, foreign=True,
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
        inputs=study.inputs,
        outside=study.outside,
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
    try:
        system = load_system(make_options(study, Path()))
    except OptionError as error:
        text = str(error)
        if text.startswith(SCHEME):
            raise study.error("rates" if study.scheme.rates else "scheme", text.removeprefix(f"{SCHEME}: ")) from error
        raise StudyError(f"{study.path}, [study], {text.removeprefix('--')}") from error
    except ColumnsError as error:
        own = study.inputs is not None and str(error).startswith(str(study.inputs))
        raise study.error("inputs" if own else "system", str(error)) from error
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
