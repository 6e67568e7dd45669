"""Statistical interpretation of a requirement: what the probability is about.  ECSS-E-ST-60-10C, 4.1.4.2 and A.1.2.

An index varies over time in each run, and from run to run over the statistical ensemble.  That it stays below a limit
with the probability P can mean:

``temporal``: for a share P of the time, in any run.
``ensemble``: at all times, in a share P of the runs.
``mixed``: at a random time of a random run with the probability P.
"""

from __future__ import annotations

import math
from dataclasses import replace
from enum import StrEnum

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .confidence import Statement, bootstrap_counts, effective_share, quantile


class Interpretation(StrEnum):
    """The three that the standard names."""

    TEMPORAL = "temporal"
    ENSEMBLE = "ensemble"
    MIXED = "mixed"


def quantile_of_runs(
    values: ArrayLike, probability: float, confidence: float, interpretation: Interpretation | str, *, seed: int = 0
) -> Statement:
    """Quantile of the magnitude of an index over runs and times, with its confidence.

    Parameters
    ----------
    values: (runs, times), the index with or without sign; the runs are independent members of the ensemble.
    seed: of the bootstrap (mixed).

    ``ensemble``: the quantile over the runs of the largest value of each; order statistics of the runs.  ``temporal``:
    the largest of the runs' quantiles over time; bounds from order statistics with the effective number of samples of
    each run, at a level that makes all of them hold together; how much of the ensemble the runs stand for is in
    ``ensemble_share``, (1 - confidence)^(1 / runs).  ``mixed``: the quantile of all values; bootstrap over runs, five
    at least.

    Raises ``ValueError`` for other shapes, and for too few runs (mixed).
    """
    magnitude = np.abs(np.asarray(values, dtype=float))
    if magnitude.ndim != 2 or not magnitude.size:
        raise ValueError(f"values: expected the shape (runs, times), got {magnitude.shape}")
    kind = Interpretation(interpretation)
    if kind is Interpretation.ENSEMBLE:
        return quantile(magnitude.max(axis=1), probability, confidence)
    if kind is Interpretation.MIXED:
        return _pooled(magnitude, probability, confidence, seed)
    runs = len(magnitude)
    together = 1.0 - (1.0 - confidence) / runs
    each = []
    for run in magnitude:
        level = float(np.quantile(run, probability, method="inverted_cdf"))
        each.append(quantile(run, probability, together, independent=effective_share(run, level)))
    return replace(
        max(each, key=lambda one: one.value),
        confidence=confidence,
        lower=max(one.lower for one in each),
        upper=max(one.upper for one in each),
        bound=max(one.bound for one in each),
        independent=min(one.independent for one in each),
        method=f"order statistics over time, worst of {runs} runs",
        ensemble_share=(1.0 - confidence) ** (1.0 / runs),
    )


def _pooled(magnitude: NDArray[np.float64], probability: float, confidence: float, seed: int) -> Statement:
    """The quantile of all values, with a bootstrap over runs.

    Each resample is searched by bisection among the sorted values, all resamples at once; the values of a run below a
    place are counted in its own sorted row.  400 runs of 500 take 0.9 s, with each resample sorted 16 s; and the time
    hardly grows with the length of the runs.
    """
    if not 0.0 < probability < 1.0:
        raise ValueError(f"probability: expected between 0 and 1, got {probability!r}")
    runs = np.sort(magnitude, axis=1)
    places = np.sort(magnitude, axis=None)

    def quantiles(counts: NDArray[np.int64]) -> NDArray[np.float64]:
        # Less a rounding: 0.8 of 5 values are 4 of them, not 4.000...01.
        needed = np.ceil(probability * runs.shape[1] * counts.sum(axis=1) * (1.0 - 1e-14))
        low, high = np.full(len(counts), -1), np.full(len(counts), len(places) - 1)
        for _ in range(math.ceil(math.log2(len(places) + 1)) + 1):
            middle = (low + high) // 2
            at = places[np.maximum(middle, 0)]
            below = sum(
                count * np.searchsorted(run, at, side="right") for count, run in zip(counts.T, runs, strict=True)
            )
            enough = (below >= needed) & (middle >= 0)
            high, low = np.where(enough, middle, high), np.where(enough, low, np.maximum(middle, low))
        return np.asarray(places[high])

    return bootstrap_counts(len(runs), quantiles, confidence, seed=seed, probability=probability)
