"""Which parameters an output depends on: rank correlation always, Sobol' indices and Morris' effects by their plans."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from .outcome import Outcome, Output
from .plan import MORRIS_LEVELS, describe_problem, study_shares
from .study import MORRIS, SOBOL_INDICES

Array = NDArray[np.float64]

LEAST_CASES = 4  # for a rank correlation that says anything
RESAMPLES = 200  # of the bootstrap of Sobol' indices
CONFIDENCE = 0.9


@dataclass(frozen=True)
class Influence:
    """Of the factors on an output; arrays (factors,)."""

    output: Output
    rank_correlation: Array
    """Spearman's: 1 or -1 where the output rises or falls with the factor; NaN for a factor with one value."""
    measures: Mapping[str, Array] = field(default_factory=dict)
    """``sobol_first`` and ``sobol_total`` with their ``_low`` and ``_high``, ``morris_mu_star``, ``morris_sigma``."""

    @property
    def strength(self) -> Array:
        """What factors are ranked by: the total Sobol' index, Morris' mu*, or the magnitude of the correlation."""
        for name in ("sobol_total", "morris_mu_star"):
            if name in self.measures:
                return np.asarray(np.abs(self.measures[name]))
        return np.asarray(np.nan_to_num(np.abs(self.rank_correlation)))


def find_influences(outcome: Outcome) -> list[Influence]:
    """Of all outputs that vary; those with fewer than four cases are left out."""
    found = []
    for output in outcome.outputs:
        values = outcome.values(output)
        there = np.isfinite(values)
        if there.sum() < LEAST_CASES or np.ptp(values[there]) == 0.0:
            continue
        measures: dict[str, Array] = {}
        if there.all() and outcome.plan.study.plan == SOBOL_INDICES:
            measures = _find_sobol(outcome, values)
        elif there.all() and outcome.plan.study.plan == MORRIS:
            measures = _find_morris(outcome, values)
        found.append(Influence(output, _correlate(outcome.plan.draws[there], values[there]), measures))
    return found


def _correlate(draws: Array, values: Array) -> Array:
    from scipy.stats import spearmanr

    return np.array([
        float(spearmanr(column, values).statistic) if np.ptp(column) > 0.0 else np.nan for column in draws.T
    ])  # fmt: skip


def _find_sobol(outcome: Outcome, values: Array) -> dict[str, Array]:
    """Indices of first order and total (A. Saltelli and others, Comput. Phys. Commun. 181 (2010) 259-270)."""
    from scipy.stats import sobol_indices

    factors = len(outcome.plan.factors)
    n = len(values) // (factors + 2)
    f_A, f_B, f_AB = values[:n], values[n : 2 * n], values[2 * n :].reshape(factors, 1, n)
    found = sobol_indices(func={"f_A": f_A[None], "f_B": f_B[None], "f_AB": f_AB}, n=n, rng=0)
    spread = found.bootstrap(confidence_level=CONFIDENCE, n_resamples=RESAMPLES)
    measures = {}
    for name, index, interval in (
        ("sobol_first", found.first_order, spread.first_order),
        ("sobol_total", found.total_order, spread.total_order),
    ):
        measures[name] = np.ravel(index)
        measures[f"{name}_low"] = np.ravel(interval.confidence_interval.low)
        measures[f"{name}_high"] = np.ravel(interval.confidence_interval.high)
    return measures


def _find_morris(outcome: Outcome, values: Array) -> dict[str, Array]:
    """Mean magnitude and spread of the elementary effects (M. D. Morris, Technometrics 33 (1991) 161-174)."""
    from SALib.analyze import morris

    factors = len(outcome.plan.factors)
    shares = study_shares(outcome.plan.study, factors)
    found = morris.analyze(describe_problem(factors), shares, values, num_levels=MORRIS_LEVELS, seed=0)
    return {"morris_mu_star": np.asarray(found["mu_star"], dtype=float), "morris_sigma": np.asarray(found["sigma"])}
