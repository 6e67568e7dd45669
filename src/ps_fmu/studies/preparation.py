"""From a study to what is run: its system, checked against all that the study names, and the files for the workers."""

from __future__ import annotations

import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ..cosim import CosimError, UsageError, write_ssp
from ..cosim.clock import StepClock
from ..cosim.faults.active import make_faults
from ..cosim.faults.binding import bind_faults
from ..cosim.faults.numbers import change_numbers
from ..cosim.rows import make_layout
from ..cosim.schemes.scheme import make_scheme
from ..cosim.structure import Experiment
from ..pointing.indices import AbsoluteError, MeanError, PointingIndex, RelativeError, ResidualJitter
from ..runs.options import OptionError, RunOptions, Scenario
from ..runs.setup import RunSystem, load_system
from .branching import Sources
from .bundle import FAULTS, REQUIREMENTS, SYSTEM, TASK, Bundle
from .fault_numbers import names_faults, split_values
from .indices import check_windows, find_signals
from .plan import Plan
from .signals import check_signals, find_columns
from .study import Observed, Study, StudyError
from .task import Task, result_versions

DEFAULT_SIGNAL = "plant.payload_rotation"
DEFAULT_WINDOW_S = 1.0
MOST_LEVELS = 1000  # of a number of faults: more are not checked one by one


def make_options(study: Study, output: Path, run: Any = None) -> RunOptions:
    """The study as options of a run.  ``run``: runs them, for a case that is run again.

    Raises :class:`..runs.options.OptionError`.
    """
    scenario = Scenario(
        study.name, study.name, run, study.duration_s, study.step_s, cases=tuple(study.runs), system=study.system.name
    )
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


def load_study_system(study: Study) -> RunSystem:
    """The system of a study; requirements, signals and windows are checked against it.

    Raises :class:`.study.StudyError`, and :class:`..cosim.CosimError` for a system that cannot be read.
    """
    try:
        system = load_system(make_options(study, Path()))
    except OptionError as error:
        raise StudyError(f"{study.path}, [study], {_as_key(str(error))}") from error
    clock, scheme = StepClock(0.0, study.step_s), make_scheme(study.scheme)
    make_faults(system.faults, system.structure, system.descriptions, clock, scheme)
    if study.isolation is not None:
        try:
            study.isolation.check(system.structure)
        except UsageError as error:
            raise study.error("isolate", str(error)) from error
    columns = make_layout(system.descriptions).columns
    for observed in study.observed:
        find_signals(observed, columns)
        check_windows(observed, study.step_s, study.duration_s)
    if study.signals is not None:
        check_signals(study.signals, columns, study.step_s, study.duration_s)
    return system


def complete_observed(study: Study, system: RunSystem) -> Study:
    """The study; where it observes nothing, with the indices of the payload's rotation over 1 s."""
    if study.observed:
        return study
    indices: list[PointingIndex] = [AbsoluteError()]
    if study.duration_s >= DEFAULT_WINDOW_S:
        window = DEFAULT_WINDOW_S
        indices += [MeanError(window), RelativeError(window, "uniform"), ResidualJitter(window)]
    observed = Observed(f"{study.path}, [[observe]]", (DEFAULT_SIGNAL,), tuple(indices))
    find_signals(observed, make_layout(system.descriptions).columns)
    return replace(study, observed=(observed,))


def check_numbers(plan: Plan, system: RunSystem) -> None:
    """Raises :class:`.study.StudyError` for numbers of faults that no run can have, with the first such case, and
    :class:`..cosim.SystemFileError` for faults that would never act.

    Of a continuous distribution, and of more than :data:`MOST_LEVELS` values, the smallest and the largest are checked.
    """
    file, study = system.faults, plan.study
    if file is None:
        return
    clock = StepClock(0.0, study.step_s)

    def check(case: int) -> None:
        _, numbers = split_values(plan.values(case), system.descriptions)
        bound = bind_faults(change_numbers(file, numbers), system.structure, system.descriptions, clock)
        bound.check_end(clock, clock.steps(study.duration_s))

    varied = [
        (factor, draws)
        for factor, draws in zip(plan.factors, plan.draws.T, strict=True)
        if names_faults(factor.targets[0], system.descriptions)
    ]
    if not varied:
        check(0)
    for factor, draws in varied:
        _, cases = np.unique(draws, return_index=True)
        for case in cases if factor.levels and len(cases) <= MOST_LEVELS else cases[[0, -1]]:
            try:
                check(int(case))
            except CosimError as error:
                key = "values" if factor.spread is None else "low"
                raise factor.vary.error(key, f"case {case}: {error}") from error


def make_bundle(study: Study, system: RunSystem, sources: Sources) -> Bundle:
    """The files of a study.  Raises as :func:`..cosim.write_ssp`, OSError."""
    experiment = Experiment(0.0, study.duration_s, study.step_s)
    distinct = list({source.path: source for source in sources.values()}.values())
    names = {source.path: f"checkpoint_{number}.zip" for number, source in enumerate(distinct)}
    with tempfile.TemporaryDirectory(prefix="study_") as folder:
        path = Path(folder, SYSTEM)
        write_ssp(replace(system.structure, experiment=experiment), path)
        archive, checkpoints = path.read_bytes(), {}
        for source in distinct:
            place = Path(folder, names[source.path])
            source.write(place)
            checkpoints[place.name] = place.read_bytes()
    stored: tuple[str, ...] = ()
    if study.signals is not None:
        stored = find_columns(study.signals, make_layout(system.descriptions).columns)
    task = Task(
        study.step_s, study.duration_s, study.scheme, study.runs, study.observed, result_versions(), stored,
        None if study.signals is None else study.signals.step_s, study.isolation,
        {run: names[source.path] for run, source in sources.items()}, () if study.branch is None else study.branch.anew,
    )  # fmt: skip
    files = {SYSTEM: archive, TASK: task.as_json(), **checkpoints}
    if study.requirements is not None:
        files[REQUIREMENTS] = study.requirements.read_bytes()
    if study.faults is not None:
        files[FAULTS] = study.faults.read_bytes()
    return Bundle.of(files)


def _as_key(problem: str) -> str:
    """The text of an option's error with the key of the study instead of the option."""
    return problem.removeprefix("--")
