"""All cases of a study before any is run: points in the unit cube, draws, start values, seeds."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from fmpy.model_description import ModelDescription
from numpy.typing import NDArray

from ..cosim import UsageError, Value
from ..cosim.description import convert_value, find_variable, index_variables
from ..cosim.faults.numbers import list_numbers
from ..cosim.graph import check_wiring
from ..cosim.structure import parse_port, split_port
from ..runs.system import RunSystem
from .factors import Factor, convert_level, explain_fed, explain_unvaried, find_factor
from .rows import OWN, VERDICT
from .study import (
    COMMON,
    GRID,
    LATIN,
    LIST,
    MORRIS,
    MOST_CASES,
    RANDOM,
    SOBOL,
    SOBOL_INDICES,
    Correlation,
    Study,
    StudyError,
)

Array = NDArray[np.float64]

MORRIS_LEVELS = 4  # of each factor: the usual choice (Saltelli and others, Sensitivity Analysis in Practice, 2004, 4.2)
SMALLEST_EIGENVALUE = 1e-10  # of a correlation matrix; below it is singular to rounding
ROUNDS = 6  # of the correction of rank correlations: more change little
RELAXATION = 0.7  # of what ranks lack, in each round


def draw_cases(study: Study, factors: Sequence[Factor]) -> Array:
    """Draws (cases, factors), in the units of the factors; the same for the same study.

    Raises :class:`.study.StudyError` for a number of cases or a correlation that the plan cannot have.
    """
    if study.plan in (GRID, LIST):
        return _combine_levels(study, factors)
    rng = np.random.default_rng(np.random.SeedSequence(study.seed, spawn_key=(0,)))
    shares = make_shares(study, len(factors), rng)
    correlation = join_correlations(study, [factor.name for factor in factors])
    if correlation is not None:
        shares = correlate(shares, correlation)
    return np.column_stack([factor.draw(column) for factor, column in zip(factors, shares.T, strict=True)])


def make_shares(study: Study, factors: int, rng: np.random.Generator) -> Array:
    """Points (cases, factors) in the unit cube, columns not correlated.

    ``sobol-indices``: matrices A, B and A with one column of B, one below the other, as Saltelli (2010) has them.
    ``morris``: trajectories over four levels, the medians of the quarters of each distribution, from 1/8 to 7/8: the
    ends of a normal distribution are nowhere.
    Raises :class:`.study.StudyError` for a number of cases that the plan cannot have.
    """
    from scipy.stats import qmc

    cases = study.cases
    assert cases is not None  # reading refuses it for these plans
    if study.plan == RANDOM:
        return rng.random((cases, factors))
    if study.plan == LATIN:
        return np.asarray(qmc.LatinHypercube(factors, rng=rng).random(cases))
    if study.plan == SOBOL:
        return _draw_sobol(_count_points(study, cases, 1, powers=True), factors, rng)
    if study.plan == SOBOL_INDICES:
        both = _draw_sobol(_count_points(study, cases, factors + 2, powers=True), 2 * factors, rng)
        A, B = both[:, :factors], both[:, factors:]
        mixed = np.tile(A, (factors, 1, 1))
        for i in range(factors):
            mixed[i, :, i] = B[:, i]
        return np.concatenate([A, B, *mixed])
    assert study.plan == MORRIS
    return _draw_trajectories(_count_points(study, cases, factors + 1, powers=False), factors, rng)


def join_correlations(study: Study, names: Sequence[str]) -> Array | None:
    """Rank correlations (factors, factors) of all factors; None where none is stated.

    Raises :class:`.study.StudyError`: a pair that is stated twice, a plan that needs independent factors, a matrix
    that no random numbers have.
    """
    if not study.correlations:
        return None
    if study.plan in (GRID, LIST, SOBOL_INDICES, MORRIS):
        place = study.correlations[0].place
        why = f"the plan {study.plan!r} varies each parameter by itself"
        raise StudyError(f"{place}: {why}: a correlation is not possible")
    matrix = np.eye(len(names))
    stated: set[frozenset[str]] = set()
    for group in study.correlations:
        for i, one in enumerate(group.parameters):
            for j, other in enumerate(group.parameters[:i]):
                pair = frozenset((one, other))
                if pair in stated:
                    raise StudyError(f"{group.place}: the correlation of {one!r} and {other!r} is stated twice")
                stated.add(pair)
                row, column = names.index(one), names.index(other)
                matrix[row, column] = matrix[column, row] = group.matrix[i][j]  # type: ignore[index]
    _check_definite(matrix, study.correlations)
    return matrix


def correlate(shares: Array, rank_correlation: Array) -> Array:
    """Points (cases, factors) with each column's own values in another order, so that their ranks are correlated.

    A Gaussian copula: normal scores with the correlation 2 sin(pi rho / 6) have the rank correlation rho.  The sample's
    own correlation is taken out of the scores, and the values of each column are put into their order (R. L. Iman,
    W. J. Conover, A distribution-free approach to inducing rank correlation among input variables, Commun. Stat. Simul.
    Comput. 11 (1982) 311-334): a Latin hypercube stays one.  Of :data:`ROUNDS` corrections of what the ranks lack the
    nearest is taken: 0.01 off at 20 cases (standard deviation).  Columns without a correlation stay as they are.  A few
    cases keep what they have of their own where it cannot be taken out: they are no more than the columns, or their
    ranks coincide.
    """
    from scipy.stats import norm, rankdata

    place = np.flatnonzero((rank_correlation != np.eye(len(rank_correlation))).any(axis=0))
    own, wanted = shares[:, place], rank_correlation[np.ix_(place, place)]
    scores = norm.ppf((rankdata(own, axis=0) - 0.5) / len(own))
    sampled = np.corrcoef(scores, rowvar=False) if len(own) > len(place) else np.zeros(wanted.shape)
    if _is_definite(sampled):
        scores = np.linalg.solve(np.linalg.cholesky(sampled), scores.T).T
    aim, least = wanted.copy(), math.inf
    ordered = own
    for _ in range(ROUNDS):
        normal = _to_normal(aim)
        if not _is_definite(normal):
            break
        ranks = np.argsort(np.argsort(scores @ np.linalg.cholesky(normal).T, axis=0), axis=0)
        lack = wanted - (np.corrcoef(ranks, rowvar=False) if len(own) > 1 else wanted)
        if np.abs(lack).max() < least:
            least, ordered = float(np.abs(lack).max()), np.take_along_axis(np.sort(own, axis=0), ranks, axis=0)
        aim = np.clip(aim + RELAXATION * lack, -1.0, 1.0)
    found = shares.copy()
    found[:, place] = ordered
    return found


def _to_normal(rank_correlation: Array) -> Array:
    """Correlation of normal scores for a rank correlation."""
    found = 2.0 * np.sin(np.pi / 6.0 * rank_correlation)
    np.fill_diagonal(found, 1.0)
    return np.asarray(found)


def _is_definite(matrix: Array) -> bool:
    """Whether a symmetric matrix is positive definite, beyond rounding."""
    return bool(np.linalg.eigvalsh(matrix).min() >= SMALLEST_EIGENVALUE)


def _check_definite(matrix: Array, groups: Sequence[Correlation]) -> None:
    lowest = float(np.linalg.eigvalsh(_to_normal(matrix)).min())
    if lowest < SMALLEST_EIGENVALUE:
        raise StudyError(
            f"{groups[-1].place}: the correlation matrix is not positive definite (lowest eigenvalue {lowest:.3g}): no "
            "random numbers are correlated like this; bring the correlations nearer to 0, or state those between all"
        )


def _combine_levels(study: Study, factors: Sequence[Factor]) -> Array:
    join_correlations(study, [factor.name for factor in factors])
    levels = [factor.numbers for factor in factors]
    if study.plan == LIST:
        lengths = {len(own) for own in levels}
        if len(lengths) > 1:
            named = ", ".join(f"{factor.name}: {len(factor.levels)}" for factor in factors)
            raise study.error("plan", f"a list needs as many values of each, got {named}")
        return np.column_stack(levels)
    return np.stack(np.meshgrid(*levels, indexing="ij"), axis=-1).reshape(-1, len(levels))


def _draw_sobol(cases: int, dimensions: int, rng: np.random.Generator) -> Array:
    from scipy.stats import qmc

    return np.asarray(qmc.Sobol(dimensions, rng=rng).random(cases))


def _count_points(study: Study, cases: int, each: int, *, powers: bool) -> int:
    """Points of which each takes ``each`` cases; ``powers``: Sobol' points come by powers of 2."""
    least = 1 if each == 1 else 2
    points = max(least, cases // each)
    lower = 2 ** (points.bit_length() - 1) if powers else points
    if lower * each != cases:
        upper = 2 * lower if powers else lower + 1
        why = f"the plan {study.plan!r} takes {each} cases a point" if each > 1 else "Sobol' points"
        by = " and points come by powers of 2" if powers and each > 1 else " come by powers of 2" if powers else ""
        raise study.error("cases", f"{why}{by}: expected {lower * each} or {upper * each}, not {cases}")
    return lower


def _draw_trajectories(trajectories: int, factors: int, rng: np.random.Generator) -> Array:
    """Each from a random point, with every factor in turn moved by half of the levels, up or down, in random order."""
    jump = MORRIS_LEVELS // 2
    start = rng.integers(jump, size=(trajectories, 1, factors))
    falls = rng.integers(2, size=(trajectories, 1, factors)) == 1
    turn = rng.permuted(np.tile(np.arange(factors), (trajectories, 1)), axis=1)[:, None, :]
    moved = np.arange(factors + 1)[:, None] > turn
    return np.asarray((start + jump * (moved ^ falls) + 0.5) / MORRIS_LEVELS).reshape(-1, factors)


@dataclass(frozen=True, eq=False)
class Plan:
    """The cases of a study, in order."""

    study: Study
    factors: tuple[Factor, ...]
    draws: Array
    """(cases, factors), in the units of the factors."""
    seed_names: tuple[str, ...]
    """``component.parameter`` of each seed."""
    shared_seeds: tuple[str, ...] = ()
    """Seeds that are the same in all cases, also those of faults: all cases have the same record of this noise."""

    def __len__(self) -> int:
        return len(self.draws)

    @property
    def is_noisy(self) -> bool:
        """Whether cases differ by random numbers of their own, too."""
        return bool(self.seed_names) and self.study.seeds != COMMON

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
    seeds = find_seeds(study, system.descriptions, factors)
    plan = Plan(study, factors, draw_cases(study, factors), seeds, find_shared_seeds(study, system, factors, seeds))
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
    return [name for name in _list_all_seeds(descriptions) if name not in own]


def find_shared_seeds(
    study: Study, system: RunSystem, factors: Sequence[Factor], seeds: Sequence[str]
) -> tuple[str, ...]:
    """The seeds that all cases share, of parameters and of faults; ``seeds``: those that a case can have."""
    events = () if system.faults is None else system.faults.events
    found = [name for name in _list_all_seeds(system.descriptions) if study.seeds == COMMON or name not in seeds]
    found += [f"faults.{e.name or place}.seed" for place, e in enumerate(events) if "seed" in list_numbers(e)]
    varied = {name for factor in factors for name in factor.targets}
    return tuple(name for name in found if name not in varied)


def _list_all_seeds(descriptions: Mapping[str, ModelDescription]) -> list[str]:
    return [
        f"{component}.{name}"
        for component, description in descriptions.items()
        for name, variable in index_variables(description).items()
        if variable.causality == "parameter" and variable.type == "Integer" and name.split(".")[-1] == "seed"
    ]


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
                raise StudyError(f"{study.path}, runs.{run}, {name}: is varied by [[vary]] {owner[name].name!r}")


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
                    raise UsageError(f"{fed[name]}: a start value would have no effect")
                if reason := explain_unvaried(variable):
                    raise UsageError(reason)
                found[run][name] = convert_level(variable, value)
            except UsageError as error:
                raise StudyError(f"{study.path}, runs.{run}, {name}: {error}") from None
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

