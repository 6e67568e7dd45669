"""From a study to what is run: its system, of whatever maker, read as ``ps-fmu run`` reads it, and checked.

What it observes and varies, where its runs begin, and the files for workers.
"""

from __future__ import annotations

import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

from ..cosim import Column, CosimError, UsageError, Value
from ..cosim.checkpoint.warm_start import WarmStart
from ..cosim.clock import StepClock
from ..cosim.columns import list_run_columns
from ..cosim.faults.binding import bind_faults
from ..cosim.faults.numbers import change_numbers
from ..cosim.graph import check_wiring
from ..cosim.schemes.resolving import resolve_scheme
from ..cosim.ssp.packing import Packed, pack_files
from ..cosim.ssp.reading import complete_experiment
from ..cosim.structure import Experiment, encode_system
from ..requirements.quantity import Names, Time
from ..runs.keeping import find_source
from ..runs.options import OptionError, RunOptions
from ..runs.scenario import Scenario
from ..runs.setup import SCHEME, ColumnsError, list_delays, load_system, read_files
from ..runs.system import RunSystem
from ..theory.sampled import round_delay
from .bundle import FAULTS, FMUS, INPUTS, REQUIREMENTS, SYSTEM, TASK, Bundle, Sources, Task, worker_versions
from .factors import names_faults, split_values
from .observed import check_signals, check_windows, find_columns, find_signals
from .plan import Plan, list_seeds
from .study import Branch, Observed, Study, StudyError

DEFAULT_SIGNAL = "plant.payload_rotation"
DEFAULT_WINDOW_S = 1.0
MOST_LEVELS = 1000  # of a number of faults: more are not checked one by one


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
        disturbance=study.disturbance,
        outside=study.outside,
        isolation=study.isolation,
        fmus=study.fmus,
        replace=study.replace,
        progress=False,
    )


def load_study_system(study: Study) -> tuple[Study, RunSystem]:
    """The system of a study; requirements, signals and windows are checked against it.

    Start values are those that the FMUs take, behind all bindings, mappings and units.  The study has the step of its
    system, or else of its FMUs, where it states none itself.

    Raises :class:`.study.StudyError`, and :class:`..cosim.CosimError` for a system that cannot be read.
    """
    try:
        files = read_files(make_options(study, Path()))
        stated = complete_experiment(files.structure, files.descriptions).step
        if not study.states_step and stated is not None:
            study = replace(study, step_s=stated)
        system = load_system(make_options(study, Path()), files=files)
    except OptionError as error:
        text = str(error)
        if text.startswith(SCHEME):
            raise study.error("rates" if study.scheme.rates else "scheme", text.removeprefix(f"{SCHEME}: ")) from error
        raise StudyError(f"{study.path}, study, {text.removeprefix('--')}") from error
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
    return study, system


def list_columns(study: Study, system: RunSystem) -> tuple[Column, ...]:
    """What a run of the study can record, in order: outputs, inputs over time, outputs of the system."""
    return list_run_columns(system.structure, system.descriptions, system.inputs, study.scheme, study.step_s)


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
    own = {"window": Time(DEFAULT_WINDOW_S), "at": "uniform"} if study.duration_s >= DEFAULT_WINDOW_S else {}
    symbols = ("APE", "MPE", "RPE", "jitter") if own else ("APE",)
    observed = Observed(signal=Names((DEFAULT_SIGNAL,)), index=Names(symbols), **own)  # type: ignore[arg-type]
    observed.put(f"{study.path}, observe")
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
                whole = "" if factor.levels or "whole steps" not in str(error) else (
                    f'. To draw multiples of the step, write multiple_of = "{1e3 * study.step_s:g} ms"'
                )  # fmt: skip
                raise factor.vary.error(key, f"case {case}: {error}{whole}") from error


def warn_of_delays(plan: Plan, system: RunSystem) -> None:
    """Add a warning for each ``[[vary]]`` with draws of a delay that are no multiples of the step."""
    step, delays = plan.study.step_s, dict(list_delays(system))
    for factor, draws in zip(plan.factors, plan.draws.T, strict=True):
        if factor.has_texts or not delays.keys() & set(factor.targets):
            continue
        acts = np.array([round_delay(draw, step) for draw in draws.tolist()])
        if len(rounded := np.flatnonzero(acts != draws)):
            case = int(rounded[0])
            size = f"{1e3 * step:g} ms"
            system.warnings.add(
                f"{factor.name}: {len(rounded)} of {len(draws)} draws are not multiples of the step of {step:g} s. The "
                f"FMU rounds each up: case {case} draws {draws[case]:.6g} s and delays by {acts[case]:.6g} s. To draw "
                f'multiples, write multiple_of = "{size}" in this [[vary]], or values = ["0 ms", "{size}", ...].'
            )


def make_bundle(study: Study, system: RunSystem, sources: Sources) -> Bundle:
    """The files of a study.  Raises OSError."""
    start = system.structure.experiment.start_time
    experiment = Experiment(start, start + study.duration_s, study.step_s)
    components = system.structure.components
    if study.branch is None:
        packed = pack_files(components)
    else:  # a state is of the FMU and the paths of its run
        packed = Packed(components, {one.source: one.source.read_bytes() for one in components}, ())
    names, files = _collect_fmus(packed)
    structure = replace(system.structure, experiment=experiment, components=packed.components)
    files[SYSTEM] = encode_system(structure, names)
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
        step_s=study.step_s, duration_s=study.duration_s, scheme=study.scheme, observed=study.observed,
        runs={run: dict(values) for run, values in study.runs.items()}, versions=worker_versions(), stored=stored,
        stored_step_s=None if study.signals is None else study.signals.step, isolation=study.isolation,
        sources={run: kept[source.path] for run, source in sources.items()},
        anew=() if study.branch is None else study.branch.anew,
    )  # fmt: skip
    files[TASK] = task.as_json()
    for name, path in ((REQUIREMENTS, study.requirements), (FAULTS, study.faults), (INPUTS, study.inputs)):
        if path is not None:
            files[name] = path.read_bytes()
    return Bundle.of(files)


def _collect_fmus(packed: Packed) -> tuple[dict[str, str], dict[str, bytes]]:
    """What the FMU of each component is called in the bundle, and the contents of all files by these names."""
    places = {source: f"{FMUS}/{number}/{source.name}" for number, source in enumerate(packed.fmus)}
    names = {component.name: places[component.source] for component in packed.components}
    return names, {place: packed.fmus[source] for source, place in places.items()}

