"""Studies whose runs begin in the state of a checkpoint: it is read and checked once, before anything runs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from ..cosim import CosimError, Value
from ..cosim.checkpoint.warm_start import WarmStart
from ..cosim.graph import check_wiring
from ..cosim.schemes.resolving import resolve_scheme
from ..runs.keeping import find_source
from ..runs.options import OptionError
from ..runs.setup import RunSystem
from .fault_numbers import split_values
from .plan import Plan, list_seeds
from .study import Branch, Study, StudyError

Sources = Mapping[str, WarmStart]
"""The checkpoint that each run begins from, by the name of the run; empty for a study without any."""


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
