"""From the distributions of one or more runs to a statement with its confidence."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..pointing.confidence import (
    LEAST_RUNS,
    Statement,
    bootstrap_counts,
    bounding_rank,
    gaussian_rms,
    quantile,
    samples_needed,
)
from ..pointing.interpretation import Interpretation
from .distribution import Distribution, find_rank, list_edges
from .requirement import Requirement

Array = NDArray[np.float64]
Counts = NDArray[np.int64]

FEW = 100
"""Independent samples of a record below which their estimated number is so uncertain that bounds hold less often.

Of 600 correlated Gaussian records worth 77 samples 85 % kept a bound of their 95 % quantile at 90 % confidence, of
those worth 120 samples 89 %.  The RMS allows for it: of 400 records worth 25 and 200 samples 88 and 90 % kept it.
"""


def state(requirement: Requirement, runs: Sequence[Distribution]) -> Statement:
    """Best estimate and bound of a requirement's statistic, in the unit of the signal; an infinite bound: too few.

    ``runs``: the distributions of independent members of the ensemble, one at least.  The interpretations are those of
    :func:`..pointing.interpretation.quantile_of_runs`.
    """
    probability, confidence = requirement.probability, requirement.confidence
    if confidence is None:
        return _state_peak(runs)
    if requirement.interpretation is Interpretation.TEMPORAL:
        return _state_of_time(probability, confidence, runs)
    assert probability is not None  # an RMS is temporal
    if requirement.interpretation is Interpretation.ENSEMBLE:
        return quantile([run.peak for run in runs], probability, confidence)
    return _state_of_all(probability, confidence, runs)


def explain_lack(requirement: Requirement, statement: Statement, runs: int, judged_s: float) -> str:
    """Why there is no bound, and how much there would have to be for one."""
    assert requirement.probability is not None and requirement.confidence is not None  # others always have a bound
    if requirement.interpretation is Interpretation.MIXED:
        return f"a bootstrap needs {LEAST_RUNS} runs with different seeds, there {_count(runs)}"
    confidence = requirement.confidence
    if requirement.interpretation is Interpretation.ENSEMBLE:
        needed = samples_needed(requirement.probability, confidence)
        return f"{needed} runs with different seeds are needed, there {_count(runs)}"
    needed = samples_needed(requirement.probability, _share_out(confidence, runs))
    length = judged_s * needed / statement.independent
    return (
        f"{_count_samples(statement.independent)} in {judged_s:.4g} s; {needed} are needed: run about "
        f"{_round_up(length + requirement.settling_s):g} s"
    )


def qualify(requirement: Requirement, statement: Statement) -> str:
    """What is to be said of a bound that rests on few samples of a record; nothing otherwise."""
    known = requirement.confidence is None or requirement.interpretation is not Interpretation.TEMPORAL
    if known or statement.independent >= FEW:
        return ""
    number = _count_samples(statement.independent)
    return f"the bound rests on {number}: so few that their number is uncertain, and the bound with it"


def _share_out(confidence: float, runs: int) -> float:
    """The confidence of each run's bound with which all hold together."""
    return 1.0 - (1.0 - confidence) / runs


def _state_peak(runs: Sequence[Distribution]) -> Statement:
    """The largest value of all: known, and no statement on other runs."""
    peak = max(run.peak for run in runs)
    return Statement(
        value=peak, confidence=1.0, lower=peak, upper=peak, bound=peak, independent=float(len(runs)),
        method="largest value",
    )  # fmt: skip


def _state_of_time(probability: float | None, confidence: float, runs: Sequence[Distribution]) -> Statement:
    """The worst run, each with a confidence that makes all bounds hold together."""
    together = _share_out(confidence, len(runs))
    if probability is None:
        each = [gaussian_rms(run.rms, run.independent_squares(), together) for run in runs]
    else:
        each = [quantile_of_record(run, probability, together) for run in runs]
    worst = max(each, key=lambda one: one.value)
    return replace(
        worst,
        confidence=confidence,
        lower=max(one.lower for one in each),
        upper=max(one.upper for one in each),
        bound=max(one.bound for one in each),
        independent=min(one.independent for one in each),
        method=worst.method if len(runs) == 1 else f"{worst.method}, worst of {len(runs)} runs",
        ensemble_share=(1.0 - confidence) ** (1.0 / len(runs)),
    )


def quantile_of_record(run: Distribution, probability: float, confidence: float) -> Statement:
    """As :func:`..pointing.confidence.quantile`, from the distribution of the magnitudes over a run."""
    value = run.quantile(probability)
    independent = min(run.effective_share(value), float(run.count))
    cases = math.floor(independent + 1e-9)

    def above(level: float) -> float:
        rank = bounding_rank(cases, probability, level)
        return math.inf if rank is None else run.value(find_rank(run.count, rank / cases))

    def below(level: float) -> float:
        rank = bounding_rank(cases, 1.0 - probability, level)
        if rank is None:
            return -math.inf
        return run.value(max(1, math.floor((cases - rank + 1) / cases * run.count + 1e-9)))

    side = 0.5 * (1.0 + confidence)
    return Statement(
        value=value,
        confidence=confidence,
        lower=below(side),
        upper=above(side),
        bound=above(confidence),
        independent=independent,
        method="order statistics over time",
        probability=probability,
    )


def _state_of_all(probability: float, confidence: float, runs: Sequence[Distribution]) -> Statement:
    counts = np.array([run.counts for run in runs])
    return state_of_counts(counts, list_edges(runs[0].limit, max(run.peak for run in runs)), probability, confidence)


def state_of_counts(counts: Counts, edges: Array, probability: float, confidence: float) -> Statement:
    """The quantile of the values of all runs, with a bootstrap that resamples whole runs.

    Parameters
    ----------
    counts: (runs, bins), values of each run in each bin; fewer than five runs have no bound.
    edges: (bins,), upper ends of the bins.
    """
    filled = counts.any(axis=0)  # a tenth of the bins or less
    edges = edges[filled]
    below = np.cumsum(counts[:, filled], axis=1)

    def find_quantiles(often: Counts) -> Array:
        """Of resamples (k, runs): bisection for the first bin below whose end the wanted share of the values lies."""
        needed = np.array([find_rank(int(total), probability) for total in often @ below[:, -1]])
        low, high = np.zeros(len(often), dtype=np.int64), np.full(len(often), len(edges) - 1)
        for _ in range(len(edges).bit_length()):
            middle = (low + high) // 2
            enough = (often * below[:, middle].T).sum(axis=1) >= needed
            high, low = np.where(enough, middle, high), np.where(enough, low, middle + 1)
        return np.asarray(edges[high])

    if len(counts) < LEAST_RUNS:
        return Statement(
            value=float(find_quantiles(np.ones((1, len(counts)), dtype=np.int64))[0]),
            confidence=confidence,
            lower=-math.inf,
            upper=math.inf,
            bound=math.inf,
            independent=float(len(counts)),
            method="bootstrap over runs",
            probability=probability,
        )
    return bootstrap_counts(len(counts), find_quantiles, confidence, seed=0, probability=probability)


def _count(runs: int) -> str:
    return "is one" if runs == 1 else f"are {runs}"


def _count_samples(independent: float) -> str:
    number = f"{independent:.3g}"
    return f"{number} independent sample{'' if number == '1' else 's'}"


def _round_up(seconds: float) -> float:
    """To two digits, so that the result is no less."""
    unit = 10.0 ** (math.floor(math.log10(seconds)) - 1)
    return math.ceil(seconds / unit - 1e-9) * unit
