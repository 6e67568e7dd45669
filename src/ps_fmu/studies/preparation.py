"""From a study to what is run: what it observes and varies, where its runs begin, checked; the files for workers."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from ..cosim import CosimError, Value
from ..cosim.checkpoint.warm_start import WarmStart
from ..cosim.clock import StepClock
from ..cosim.faults.binding import bind_faults
from ..cosim.faults.numbers import change_numbers
from ..cosim.graph import check_wiring
from ..cosim.schemes.resolving import resolve_scheme
from ..cosim.structure import Experiment
from ..cosim.system_json import encode_system
from ..pointing.indices import AbsoluteError, MeanError, PointingIndex, RelativeError, ResidualJitter
from ..runs.keeping import find_source
from ..runs.options import OptionError
from ..runs.setup import RunSystem
from .bundle import FAULTS, FMUS, INPUTS, REQUIREMENTS, SYSTEM, TASK, Bundle, Task, result_versions
from .factors import names_faults, split_values
from .loading import list_columns
from .plan import Plan, list_seeds
from .signals import find_columns
from .study import Branch, Observed, Study, StudyError

Sources = Mapping[str, WarmStart]
"""The checkpoint that each run begins from, by the name of the run; empty for a study without any."""
DEFAULT_SIGNAL = "plant.payload_rotation"
DEFAULT_WINDOW_S = 1.0
MOST_LEVELS = 1000  # of a number of faults: more are not checked one by one


def read_sources(study: Study) -> Sources:
    """The checkpoints of a study.

    Raises :class:`.study.StudyError`: none for a run, a damaged one, or some of different times.
    """
    branch = study.branch
    if branch is None:
        return {}
    found: dict[str, WarmStart] = {}
    for run in study.runs:
        try:
            place = find_source(branch.checkpoint, run)
            source = WarmStart(place, branch.anew)
        except (OptionError, CosimError) as error:
            raise _explain(branch, error) from error
        # One object for one file: its content is in memory once.
        found[run] = next((other for other in found.values() if other.path == source.path), source)
        first = next(iter(found))
        if source.time != found[first].time:
            raise branch.error(
                "checkpoint",
                f"that of the run {run!r} is of t = {source.time:.9g} s, that of {first!r} of "
                f"{found[first].time:.9g} s: expected checkpoints of one time",
            )
    return found


def keep_seeds(study: Study, system: RunSystem, sources: Sources) -> RunSystem:
    """The system with the seeds that the states of its FMUs have; there is a warning that no case has others.

    The study has no seeds of its own for them: random numbers go on as in the run of the checkpoint.
    """
    if study.branch is None:
        return system
    first = next(iter(sources.values()))
    kept: dict[str, Value] = {}
    for name in list_seeds(study, system.descriptions):
        if study.branch.keeps(name, system.descriptions):
            seed = first.get_start(name)
            kept |= {} if seed is None else {name: seed}
            component = system.structure.find_port(name).component
            system.warnings.add(
                f"{name} is in the state of its FMU: all cases go on with the random numbers of the checkpoint.  To "
                f"give each its own, begin that FMU anew: [from], anew = [{component!r}]."
            )
    return replace(system, structure=system.structure.with_parameters(kept))


def check_sources(plan: Plan, system: RunSystem, sources: Sources) -> None:
    """Raises :class:`.study.StudyError` for checkpoints that the runs of the study cannot begin from."""
    study, branch = plan.study, plan.study.branch
    if branch is None:
        return
    for run, own in study.runs.items():
        starts, _ = split_values(plan.values(0), system.descriptions)
        given = {**starts, **own}
        try:
            structure = system.structure.with_parameters(given)
            wiring = check_wiring(structure, system.descriptions)
            scheme = resolve_scheme(study.scheme, structure, system.descriptions, study.step_s)
            sources[run].giving(given).check(structure, wiring, system.descriptions, study.step_s, scheme)
        except (CosimError, OSError) as error:
            raise _explain(branch, error, f"run {run!r}: ") from error


def _explain(branch: Branch, error: Exception, where: str = "") -> StudyError:
    """The error with the keys of the study instead of the options of a run."""
    text = str(error).removeprefix("--from: ")
    key = "anew" if text.startswith("anew: ") else "checkpoint"
    text = text.removeprefix("anew: ")
    return branch.error(key, f"{where}{text.replace('--anew ', 'the key anew of [from] for ')}")


def complete_observed(study: Study, system: RunSystem) -> Study:
    """The study; where it observes nothing, with the indices of the payload's rotation over 1 s."""
    if study.observed:
        return study
    indices: list[PointingIndex] = [AbsoluteError()]
    if study.duration_s >= DEFAULT_WINDOW_S:
        window = DEFAULT_WINDOW_S
        indices += [MeanError(window), RelativeError(window, "uniform"), ResidualJitter(window)]
    observed = Observed(f"{study.path}, [[observe]]", (DEFAULT_SIGNAL,), tuple(indices))
    columns = list_columns(study, system)
    if not any(column.name.startswith(f"{DEFAULT_SIGNAL}.") for column in columns):
        reals = [column.name for column in columns if column.type == "Real"]
        raise StudyError(
            f"{observed.place}: is missing, and the system has no {DEFAULT_SIGNAL}, which is observed without one: "
            f"expected a table with a signal such as {', '.join(reals[:5]) or 'none, as it has no Real outputs'}"
        )
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
    """The files of a study.  Raises OSError."""
    start = system.structure.experiment.start_time
    experiment = Experiment(start, start + study.duration_s, study.step_s)
    names, files = _collect_fmus(system)
    files[SYSTEM] = encode_system(replace(system.structure, experiment=experiment), names)
    distinct = list({source.path: source for source in sources.values()}.values())
    kept = {source.path: f"checkpoint_{number}.msgpack" for number, source in enumerate(distinct)}
    with tempfile.TemporaryDirectory(prefix="study_") as folder:
        for source in distinct:
            place = Path(folder, kept[source.path])
            source.write(place)
            files[place.name] = place.read_bytes()
    stored: tuple[str, ...] = ()
    if study.signals is not None:
        stored = find_columns(study.signals, list_columns(study, system))
    task = Task(
        study.step_s, study.duration_s, study.scheme, study.runs, study.observed, result_versions(), stored,
        None if study.signals is None else study.signals.step_s, study.isolation,
        {run: kept[source.path] for run, source in sources.items()}, () if study.branch is None else study.branch.anew,
    )  # fmt: skip
    files[TASK] = task.as_json()
    for name, path in ((REQUIREMENTS, study.requirements), (FAULTS, study.faults), (INPUTS, study.inputs)):
        if path is not None:
            files[name] = path.read_bytes()
    return Bundle.of(files)


def _collect_fmus(system: RunSystem) -> tuple[dict[str, str], dict[str, bytes]]:
    """What the FMU of each component is called in the bundle, and the contents of all files by these names."""
    places: dict[Path, str] = {}
    for component in system.structure.components:
        places.setdefault(component.source, f"{FMUS}/{len(places)}/{component.source.name}")
    names = {component.name: places[component.source] for component in system.structure.components}
    return names, {place: source.read_bytes() for source, place in places.items()}

