"""Statistical interpretation of a requirement: what the probability is about.  ECSS-E-ST-60-10C, 4.1.4.2 and A.1.2.

An index varies over time in each run, and from run to run over the statistical ensemble.  That it stays below a limit
with the probability P can mean:

``temporal``: for a share P of the time, in any run.
``ensemble``: at all times, in a share P of the runs.
``mixed``: at a random time of a random run with the probability P.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from enum import StrEnum

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .confidence import (
    LEAST_RUNS,
    SEEN_AT,
    Statement,
    find_kurtosis,
    find_rank,
    quantile,
    share_out,
    state_by_moments,
    state_quantile,
    state_rms,
    state_rms_of_runs,
    state_worst,
    weigh_runs,
    weigh_share,
)

Array = NDArray[np.float64]


class Interpretation(StrEnum):
    """The three interpretations of a quantile in the standard."""

    TEMPORAL = "temporal"
    ENSEMBLE = "ensemble"
    MIXED = "mixed"


def quantile_of_runs(
    values: ArrayLike, probability: float, confidence: float, interpretation: Interpretation | str
) -> Statement:
    """Return the quantile of the magnitude of an index over runs and times, with its confidence.

    Parameters
    ----------
    values: the index (runs, times), with or without sign; the runs are independent members of the ensemble.

    ``ensemble``: the quantile over the runs of the largest value of each run; the bound comes from order statistics of
    the runs.  ``temporal``: the largest of the quantiles over time of the runs; bounds come from order statistics with
    the number of independent samples of each run (:func:`.confidence.weigh_share`), at a level at which all bounds hold
    together; ``ensemble_share`` is (1 - confidence)^(1 / runs), the share of the ensemble that the runs represent.
    ``mixed``: the quantile of all values; the bound comes from order statistics with the number of independent samples
    of all runs (:func:`.confidence.weigh_runs`).  With too few samples the bound comes from Markov's inequality; fewer
    than five runs give no such bound.

    Raises ``ValueError`` for other shapes.
    """
    magnitude = np.abs(np.asarray(values, dtype=float))
    if magnitude.ndim != 2 or not magnitude.size:
        raise ValueError(f"values: expected the shape (runs, times), got {magnitude.shape}")
    kind = Interpretation(interpretation)
    if kind is Interpretation.ENSEMBLE:
        return quantile_of_peaks(magnitude.max(axis=1), probability, confidence)
    if kind is Interpretation.TEMPORAL:
        together = share_out(confidence, len(magnitude))
        return state_worst([_state_run(run, probability, together) for run in magnitude], confidence)
    places = np.sort(magnitude, axis=None)
    level = places[find_rank(magnitude.size, min(probability, SEEN_AT)) - 1]
    stated = state_pooled(
        lambda rank: float(places[rank - 1]), magnitude.size, (magnitude > level).mean(axis=1), probability, confidence
    )
    if math.isfinite(stated.bound):
        return stated
    return state_by_moments(
        stated, state_rms_of_runs((magnitude**2).mean(axis=1), confidence), find_kurtosis(magnitude), probability
    )


def quantile_of_peaks(peaks: ArrayLike, probability: float, confidence: float) -> Statement:
    """Quantile of the largest values of independent runs (runs,)."""
    stated = quantile(peaks, probability, confidence)
    if math.isfinite(stated.bound) or len(np.asarray(peaks)) < LEAST_RUNS:
        return stated
    return state_by_moments(stated, state_rms_of_runs(np.square(peaks), confidence), find_kurtosis(peaks), probability)


def state_pooled(
    value: Callable[[int], float], count: int, shares: Array, probability: float, confidence: float
) -> Statement:
    """Quantile of the ``count`` values of all runs together; ``value`` gives that of a rank, from 1.

    ``shares`` (runs,): as for :func:`.confidence.weigh_runs`.  Fewer than five runs have no bound by order statistics.
    """
    worth = min(weigh_runs(shares), float(count))
    stated = state_quantile(value, count, worth, probability, confidence, "order statistics over runs")
    if len(shares) < LEAST_RUNS:
        return replace(stated, lower=-math.inf, upper=math.inf, bound=math.inf)
    return stated


def _state_run(run: Array, probability: float, confidence: float) -> Statement:
    """The quantile of one run (times,) over time."""
    ordered, worth = np.sort(run), weigh_share(run, probability)
    stated = state_quantile(
        lambda rank: float(ordered[rank - 1]), len(run), worth.count_ranks(confidence), probability, confidence,
        method="order statistics over time",
    )  # fmt: skip
    if math.isfinite(stated.bound):
        return stated
    rms = state_rms(math.sqrt(float((run**2).mean())), run**2, confidence)
    return state_by_moments(stated, rms, find_kurtosis(run), probability)
