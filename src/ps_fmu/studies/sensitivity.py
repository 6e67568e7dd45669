"""What the outputs of a study depend on, as its plan tells it: shares of variance, total indices, Morris' effects."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from .plan import Plan
from .study import GRID, MORRIS, SOBOL_INDICES
from .variance import CONFIDENCE, ROUNDING, Estimate, Sample, describe_shape, estimate_share, find_level

Array = NDArray[np.float64]

LEAST_CASES = 4
MOST_USED = 20_000  # cases; of more these are drawn
RESAMPLES = 200  # of the bootstrap of total Sobol' indices


@dataclass(frozen=True)
class Influence:
    """Of the factors on an output; tuples have an entry for each factor."""

    shares: tuple[Estimate | None, ...] = ()
    """Of the variance, that each explains by itself; None: not shown to be above chance, or too few cases."""
    shapes: tuple[str, ...] = ()
    """How the output depends on each whose share or effect is stated: ``rising``, ``least near 3.1e5 N/m``."""
    floor: float | None = None
    """Share that a factor without influence may reach by chance; None: the shares are exact, or there are none."""
    left: Estimate | None = None
    """Share that no sum of curves of the factors explains: the random numbers, and what acts together."""
    pairs: Mapping[tuple[int, int], Estimate] = field(default_factory=dict)
    """Shares that two factors explain together, beyond both by themselves, where above their floor."""
    totals: tuple[Estimate, ...] = ()
    """Total Sobol' indices: the share of each with all that it acts in together with others."""
    effects: tuple[tuple[float, float], ...] = ()
    """Of Morris: mean magnitude mu* and standard deviation of the elementary effects, for one standard deviation of the
    factor, in the unit of the output."""

    def strength(self, place: int) -> float:
        """What the factor at a place is ranked by: its share, or mu*; NaN where it is not stated."""
        if self.effects:
            return self.effects[place][0]
        share = self.shares[place] if self.shares else None
        return math.nan if share is None else share.value

    @property
    def order(self) -> list[int]:
        """Places of the factors, the strongest first; those without a share by their totals."""
        total = [one.value for one in self.totals] or [0.0] * max(len(self.shares), len(self.effects))
        return sorted(range(len(total)), key=lambda place: (-np.nan_to_num(self.strength(place)), -total[place]))


    def describe(self, place: int, unit: str) -> str:
        """How strongly the output, in a unit, depends on a factor, and how; nothing where chance explains as much."""
        if self.effects:
            size, spread = self.effects[place]
            return ", ".join(filter(None, (f"{size:.3g} {unit} (standard deviation {spread:.2g})", self.shapes[place])))
        share = self.shares[place]
        total = self.totals[place] if self.totals else None
        with_others = "" if total is None else f"{_percent(total)} with others"
        if share is not None:
            return ", ".join(filter(None, (_percent(share), self.shapes[place], with_others)))
        return f"by itself not above chance, {with_others}" if total and total.lower > (self.floor or 0.0) else ""

    def describe_floor(self) -> str:
        """What is said of a share that chance explains, too; nothing where shares are exact, or there are none."""
        return "" if self.floor is None else f"not shown to be above chance (noise floor {_number(self.floor)} %)"

    def describe_left(self, plan: Plan) -> str:
        """What no factor explains by itself, and why not; nothing where that is not known."""
        if self.left is None:
            return ""
        names = [factor.name for factor in plan.factors]
        why = ["the seed"] if plan.is_noisy else []
        why += ["what acts together"] if len(names) > 1 else []
        text = f"{_percent(self.left)} by {' and by '.join(why or ['what no curve follows'])}"
        for (i, j), share in self.pairs.items():
            text += f"; {names[i]} together with {names[j]} {_percent(share)}"
        return text

    def as_dict(self, names: Sequence[str]) -> dict[str, object]:
        """The entry of summary.json: null where chance explains as much."""

        def state(shares: Sequence[Estimate | None]) -> dict[str, object]:
            return {name: share and share._asdict() for name, share in zip(names, shares, strict=True)}

        shapes = dict(zip(names, self.shapes, strict=True))
        if self.effects:
            effects = [{"mu_star": size, "sigma": spread} for size, spread in self.effects]
            return {"effects": dict(zip(names, effects, strict=True)), "shape": shapes}
        together = [{"factors": [names[i], names[j]], **share._asdict()} for (i, j), share in self.pairs.items()]
        return {
            "share": state(self.shares), "shape": shapes, "noise_floor": self.floor,
            "left": self.left and self.left._asdict(), "together": together,
            **({"total": state(self.totals)} if self.totals else {}),
        }  # fmt: skip


def find_influences(plan: Plan, values: Array) -> list[Influence | None]:
    """On each output of ``values`` (outputs, cases); None where it does not vary, or too few cases have it."""
    there = np.isfinite(values)
    varies = [
        own.sum() >= LEAST_CASES and np.ptp(column[own]) > 0.0 for column, own in zip(values, there, strict=True)
    ]
    if plan.study.plan == MORRIS:
        found = [None if plan.is_noisy else find_effects(plan, column) for column in values]
    elif plan.study.plan == GRID and not plan.is_noisy and there.all():
        found = [split_grid(plan, column) if own else None for column, own in zip(values, varies, strict=True)]
    else:
        found = find_shares(plan, np.where(np.array(varies)[:, None], values, np.nan))
    return [one if own else None for one, own in zip(found, varies, strict=True)]


def split_grid(plan: Plan, values: Array) -> Influence:
    """The shares of factors on values (cases,) at all points of a grid, without random numbers: exact for the grid."""
    shares, shapes = [], []
    variance = float(values.var())
    for factor, draws in zip(plan.factors, plan.draws.T, strict=True):
        _, level = np.unique(draws, return_inverse=True)
        means = (np.bincount(level, values) / np.bincount(level))[level]
        shares.append(float(means.var()) / variance)
        shapes.append(describe_shape(factor, draws, values, shares[-1]) if shares[-1] > ROUNDING else "")
    left = max(0.0, 1.0 - sum(shares))
    return Influence(tuple(Estimate(s, s, s) for s in shares), tuple(shapes), None, Estimate(left, left, left))


def find_effects(plan: Plan, values: Array) -> Influence | None:
    """Morris' elementary effects on values (cases,), NaN where a case has none (M. D. Morris, Technometrics 33 (1991)
    161-174; mu* by F. Campolongo and others, Environ. Model. Softw. 22 (2007) 1509-1518), times the standard deviation
    of the factor (G. Sin, K. V. Gernaey, Comput. Aided Chem. Eng. 26 (2009) 925-930).
    """
    size = len(plan.factors) + 1
    steps = np.diff(plan.draws.reshape(-1, size, size - 1), axis=1)
    changes = np.diff(values.reshape(-1, size), axis=1)
    effects, shapes = [], []
    for place, factor in enumerate(plan.factors):
        moved = (steps[:, :, place] != 0.0) & np.isfinite(changes)
        own = changes[moved] / steps[:, :, place][moved] * factor.deviation
        if not len(own):
            return None
        size_of = float(np.abs(own).mean())
        effects.append((size_of, float(own.std(ddof=1)) if len(own) > 1 else math.nan))
        one_way = abs(float(own.mean())) > 0.999 * size_of > 0.0
        shapes.append(("rising" if own.mean() > 0.0 else "falling") if one_way else "both ways" if size_of else "")
    return Influence(effects=tuple(effects), shapes=tuple(shapes))


def find_shares(plan: Plan, values: Array) -> list[Influence | None]:
    """Of the factors on each output of ``values`` (outputs, cases), NaN where a case has none; None: too few cases."""
    factors = plan.factors
    points = len(plan) // (len(factors) + 2)
    used = np.arange(2 * points if plan.study.plan == SOBOL_INDICES else len(plan))  # the matrices A and B are a sample
    if len(used) > MOST_USED:
        used = np.sort(np.random.default_rng(0).choice(used, MOST_USED, replace=False))
    there = np.isfinite(values[:, used])
    samples = []
    for mask in np.unique(there, axis=0):
        if mask.sum() >= LEAST_CASES:
            outputs = np.flatnonzero((there == mask).all(axis=1))
            samples.append(Sample(factors, plan.draws[used[mask]], values[np.ix_(outputs, used[mask])].T, outputs))
    alone = find_level([sample.chances for sample in samples])
    together = find_level([sample.pair_chances for sample in samples])
    found: list[Influence | None] = [None] * len(values)
    for sample in samples:
        for column, output in enumerate(sample.outputs):
            found[output] = _state_influence(plan, sample, column, alone, together)
    if plan.study.plan == SOBOL_INDICES and not plan.is_noisy:
        for output in range(len(values)):
            own = found[output]
            if own is not None and np.isfinite(values[output]).all():
                found[output] = _add_totals(own, values[output], len(factors))
    return found


def _state_influence(plan: Plan, sample: Sample, column: int, level: float, pair_level: float) -> Influence:
    """Of the factors on one output; ``level``: of the test of a share, ``pair_level``: of that of a pair."""
    y = sample.centred[:, column]
    shares = [sample.estimate(place, column, level) for place in range(len(plan.factors))]
    shapes = [
        "" if share is None else describe_shape(factor, draws, y, share.value)
        for factor, draws, share in zip(plan.factors, sample.draws.T, shares, strict=True)
    ]
    left = None
    if sample.joint.shape[1]:
        sums = estimate_share(sample.joint, y)
        left = Estimate(*(min(1.0, 1.0 - end) for end in (sums.value, sums.upper, sums.lower)))
    found = {
        (i, j): sample.estimate_pair(i, j, column)
        for place, (i, j) in enumerate(sample.list_pairs())
        if sample.pair_chances[column, place] <= pair_level
    }
    pairs = {pair: share for pair, share in found.items() if share.lower > 0.0}
    return Influence(tuple(shares), tuple(shapes), sample.find_floor(level), left, pairs)


def _add_totals(influence: Influence, values: Array, factors: int) -> Influence:
    """With total indices (A. Saltelli and others, Comput. Phys. Commun. 181 (2010) 259-270), which are 0 to 1."""
    from scipy.stats import sobol_indices

    n = len(values) // (factors + 2)
    f_A, f_B, f_AB = values[:n], values[n : 2 * n], values[2 * n :].reshape(factors, 1, n)
    found = sobol_indices(func={"f_A": f_A[None], "f_B": f_B[None], "f_AB": f_AB}, n=n, rng=0)
    spread = found.bootstrap(confidence_level=CONFIDENCE, n_resamples=RESAMPLES).total_order.confidence_interval
    ends = (np.clip(np.ravel(one), 0.0, 1.0) for one in (found.total_order, spread.low, spread.high))
    totals = zip(*(one.tolist() for one in ends), strict=True)
    return replace(influence, totals=tuple(Estimate(*one) for one in totals))


def _percent(share: Estimate) -> str:
    """A share with its interval; an exact one without."""
    interval = "" if share.lower == share.upper else f" ({_number(share.lower)} to {_number(share.upper)})"
    return f"{_number(share.value)} %{interval}"


def _number(share: float) -> str:
    """In per cent."""
    return f"{100.0 * share:.0f}" if share == 0.0 or share >= 0.0995 else f"{100.0 * share:.1f}"
