"""From the distributions of one or more runs to a statement with its confidence."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..pointing.confidence import (
    LEAST_RUNS,
    Statement,
    gaussian_rms,
    quantile,
    samples_needed,
    share_out,
    state_quantile,
    state_worst,
)
from ..pointing.interpretation import Interpretation, bootstrap_quantile, find_pooled
from .distribution import Distribution, list_edges
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
    needed = samples_needed(requirement.probability, share_out(confidence, runs))
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


def _state_peak(runs: Sequence[Distribution]) -> Statement:
    """The largest value of all: known, and no statement on other runs."""
    peak = max(run.peak for run in runs)
    return Statement(
        value=peak, confidence=1.0, lower=peak, upper=peak, bound=peak, independent=float(len(runs)),
        method="largest value",
    )  # fmt: skip


def _state_of_time(probability: float | None, confidence: float, runs: Sequence[Distribution]) -> Statement:
    """The worst run, each with a confidence that makes all bounds hold together."""
    together = share_out(confidence, len(runs))
    if probability is None:
        each = [gaussian_rms(run.rms, run.independent_squares(), together) for run in runs]
    else:
        each = [quantile_of_record(run, probability, together) for run in runs]
    return state_worst(each, confidence)


def quantile_of_record(run: Distribution, probability: float, confidence: float) -> Statement:
    """As :func:`..pointing.confidence.quantile`, from the distribution of the magnitudes over a run."""
    independent = min(run.effective_share(run.quantile(probability)), float(run.count))
    return state_quantile(
        run.value, run.count, independent, probability, confidence, method="order statistics over time"
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

    def count_up_to(which: Counts) -> Counts:
        return np.asarray(below[:, which])

    if len(counts) < LEAST_RUNS:
        return Statement(
            value=float(find_pooled(edges, count_up_to, np.ones((1, len(counts)), dtype=np.int64), probability)[0]),
            confidence=confidence,
            lower=-math.inf,
            upper=math.inf,
            bound=math.inf,
            independent=float(len(counts)),
            method="bootstrap over runs",
            probability=probability,
        )
    return bootstrap_quantile(edges, count_up_to, len(counts), probability, confidence, seed=0)


def _count(runs: int) -> str:
    return "is one" if runs == 1 else f"are {runs}"


def _count_samples(independent: float) -> str:
    number = f"{independent:.3g}"
    return f"{number} independent sample{'' if number == '1' else 's'}"


def _round_up(seconds: float) -> float:
    """To two digits, so that the result is no less."""
    unit = 10.0 ** (math.floor(math.log10(seconds)) - 1)
    return math.ceil(seconds / unit - 1e-9) * unit
