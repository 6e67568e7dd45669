"""All cases of a study before any is run: draws, start values, seeds; and the hash that names them."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from fmpy.model_description import ModelDescription
from numpy.typing import NDArray

from ..cosim import UsageError, Value
from ..cosim.description import convert_value, find_variable, index_variables
from ..cosim.graph import check_wiring
from ..cosim.structure import parse_port, split_port
from ..runs.setup import RunSystem
from .factors import Factor, convert_level, explain_fed, explain_unvaried, find_factor
from .rows import OWN, VERDICT
from .sampling import draw_cases
from .study import COMMON, GRID, LIST, MOST_CASES, Study, StudyError
from .task import result_versions

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Plan:
    """The cases of a study, in order."""

    study: Study
    factors: tuple[Factor, ...]
    draws: Array
    """(cases, factors), in the units of the factors."""
    seed_names: tuple[str, ...]
    """``component.parameter`` of each seed."""

    def __len__(self) -> int:
        return len(self.draws)

    def values(self, index: int) -> dict[str, Value]:
        """What case ``index`` sets: what is varied, by the names of the targets, and the seeds."""
        found: dict[str, Value] = {}
        for factor, draw in zip(self.factors, self.draws[index].tolist(), strict=True):
            found |= factor.values(draw)
        return found | self.seeds(index)

    def seeds(self, index: int) -> dict[str, int]:
        """Seeds of a case, from 0 to 2^31 - 1, by ``component.parameter``.

        Those of different cases come from different children of the study's ``SeedSequence``.
        """
        child = 0 if self.study.seeds == COMMON else index
        sequence = np.random.SeedSequence(self.study.seed, spawn_key=(1, child))
        states = sequence.generate_state(len(self.seed_names), np.uint32) if self.seed_names else ()
        return {name: int(state) % 2**31 for name, state in zip(self.seed_names, states, strict=True)}

    @cached_property
    def targets(self) -> tuple[str, ...]:
        """All start values and numbers of faults that a case sets, but for the seeds."""
        return tuple(name for factor in self.factors for name in factor.targets)


def make_plan(study: Study, system: RunSystem) -> Plan:
    """The plan of a study for a system.

    Raises :class:`.study.StudyError`: what cannot be varied in this system, too many cases, two ``[[vary]]`` or a run
    that set the same, a value outside the bounds of its FMU.
    """
    wiring = check_wiring(system.structure, system.descriptions)
    factors = tuple(find_factor(vary, system, wiring, study.branch) for vary in study.varied)
    _check_targets(study, factors)
    study = replace(study, runs=_convert_runs(study, system.descriptions, explain_fed(system, wiring)))
    if study.plan in (GRID, LIST):
        counts = [len(factor.levels) for factor in factors]
        total = math.prod(counts) if study.plan == GRID else max(counts)
        if total > MOST_CASES:
            raise study.error("plan", f"{total} cases are too many: expected at most {MOST_CASES}")
    plan = Plan(study, factors, draw_cases(study, factors), find_seeds(study, system.descriptions, factors))
    _check_values(plan)
    _check_names(plan)
    return plan


def find_seeds(
    study: Study, descriptions: Mapping[str, ModelDescription], factors: Sequence[Factor]
) -> tuple[str, ...]:
    """``component.parameter`` of all seeds that a case can have and that the study does not set itself."""
    own = {name for factor in factors for name in factor.targets}
    branch = study.branch
    return tuple(
        name
        for name in list_seeds(study, descriptions)
        if name not in own and (branch is None or not branch.keeps(name, descriptions))
    )


def list_seeds(study: Study, descriptions: Mapping[str, ModelDescription]) -> list[str]:
    """``component.parameter`` of all Integer parameters called ``seed`` that no run of the study sets."""
    own = {name for run in study.runs.values() for name in run}
    found = [
        f"{component}.{name}"
        for component, description in descriptions.items()
        for name, variable in index_variables(description).items()
        if variable.causality == "parameter" and variable.type == "Integer" and name.split(".")[-1] == "seed"
    ]
    return [name for name in found if name not in own]


def hash_plan(
    plan: Plan,
    fmus: Mapping[str, str],
    system_sha256: str,
    requirements: bytes,
    faults: bytes = b"",
    checkpoints: Mapping[str, str] | None = None,
    inputs: bytes = b"",
) -> str:
    """SHA-256, hexadecimal, of all that decides the rows of the study.

    Parameters
    ----------
    fmus: SHA-256 of each FMU by its name.
    system_sha256: of wiring and start values, which the FMUs share.
    requirements, faults, inputs: contents of the files, empty without one.
    checkpoints: SHA-256 of that of each run, None without any.
    """
    study = plan.study
    stated: dict[str, Any] = {
        "factors": [(factor.name, factor.unit, factor.targets, factor.ratios) for factor in plan.factors],
        "draws": hashlib.sha256(plan.draws.astype("<f8").tobytes()).hexdigest(),
        "levels": [factor.levels for factor in plan.factors],
        "seed": (study.seed, study.seeds, plan.seed_names),
        "runs": study.runs,
        "times": (study.duration_s, study.step_s, study.scheme.as_dict()),
        "observed": [{**observed.as_dict(), "place": ""} for observed in study.observed],
        "requirements": hashlib.sha256(requirements).hexdigest(),
        "system": system_sha256,
        "fmus": fmus,
        "versions": result_versions(),
    }
    if faults:
        stated["faults"] = hashlib.sha256(faults).hexdigest()
    if inputs:
        stated["inputs"] = hashlib.sha256(inputs).hexdigest()
    if study.branch is not None:
        stated["from"] = (checkpoints, sorted(study.branch.anew))
    return hashlib.sha256(json.dumps(stated, sort_keys=True).encode()).hexdigest()


def _check_targets(study: Study, factors: Sequence[Factor]) -> None:
    owner: dict[str, Factor] = {}
    for factor in factors:
        for name in factor.targets:
            if name in owner:
                raise factor.vary.error("parameter", f"{name} is varied by [[vary]] {owner[name].name!r}, too")
            owner[name] = factor
    for run, values in study.runs.items():
        for name in values:
            if name in owner:
                raise StudyError(f"{study.path}, [runs.{run}], {name}: is varied by [[vary]] {owner[name].name!r}")


def _convert_runs(
    study: Study, descriptions: Mapping[str, ModelDescription], fed: Mapping[str, str]
) -> dict[str, dict[str, Value]]:
    """The start values of the runs as their FMUs take them; ``fed``: what gets none, and why.

    Raises :class:`.study.StudyError`.
    """
    found: dict[str, dict[str, Value]] = {run: {} for run in study.runs}
    for run, values in study.runs.items():
        for name, value in values.items():
            try:
                port = split_port(name, descriptions)
                if port is None:
                    component = parse_port(name).component
                    raise UsageError(f"there is no component {component!r}; there are {', '.join(descriptions)}")
                variable = find_variable(descriptions[port.component], port.variable)
                if name in fed:
                    raise UsageError(f"{fed[name]}: nothing can be set")
                if reason := explain_unvaried(variable):
                    raise UsageError(reason)
                found[run][name] = convert_level(variable, value)
            except UsageError as error:
                raise StudyError(f"{study.path}, [runs.{run}], {name}: {error}") from None
    return found


def _check_names(plan: Plan) -> None:
    """Each draw that is not that of the start value of its name has a column of that name beside all others."""
    runs = tuple(f"{run}." for run in plan.study.runs)
    for factor in plan.factors:
        if factor.name in factor.targets:
            continue
        what = "as a column that all studies have" if factor.name in OWN else None
        if factor.name in (*plan.targets, *plan.seed_names):
            what = "as a start value or seed that the study sets, too"
        elif factor.name.startswith((*runs, VERDICT)):
            what = "like the result of a run"
        if what is not None:
            raise factor.vary.error("name", f"{factor.name!r} is called {what}: give it a name of its own")


def _check_values(plan: Plan) -> None:
    """Bounds of the FMUs, by the smallest and the largest draw: whatever lies between is inside, too."""
    for place, factor in enumerate(plan.factors):
        for index in (int(plan.draws[:, place].argmin()), int(plan.draws[:, place].argmax())):
            values = factor.values(float(plan.draws[index, place]))
            for variable, (name, value) in zip(factor.variables, values.items(), strict=True):
                try:
                    convert_value(variable, value)
                except UsageError as error:
                    key = "values" if factor.spread is None else "low"
                    raise factor.vary.error(key, f"case {index}, {name}: {error}; truncate with low and high") from None

