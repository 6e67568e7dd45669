"""From the distributions of one or more runs to a statement with its confidence.

The runs of a study are pooled for a requirement that holds at a random time of a random run (mixed; ECSS-E-ST-60-10C,
4.1.4.2 and A.1.2): a run hands over its histogram as a text of some kilobytes, and the runs are summed in groups as
they come, so that memory does not grow with their number.
"""

from __future__ import annotations

import base64
import binascii
import math
import struct
import zlib
from collections.abc import Sequence
from dataclasses import replace

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
from .distribution import BINS, Distribution, list_edges
from .requirement import Requirement

Array = NDArray[np.float64]
Counts = NDArray[np.int64]

FEW = 100
"""Independent samples of a record below which their estimated number is so uncertain that bounds hold less often.

Of 600 correlated Gaussian records worth 77 samples 85 % kept a bound of their 95 % quantile at 90 % confidence, of
those worth 120 samples 89 %.  The RMS allows for it: of 400 records worth 25 and 200 samples 88 and 90 % kept it.
"""
MOST_GROUPS = 400
"""Groups that are resampled; more runs share one.  A group of independent runs is as good a unit as a run, and the
bootstrap of 400 takes 1 s and 80 MB however many runs there are."""
_HEADER = struct.Struct("<dI")  # largest value over the limit; number of bins that are filled


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


def pack_distribution(found: Distribution) -> str:
    """The largest value over the limit, and the filled bins of a histogram, as a text; :class:`Pool` reads it."""
    bins = np.flatnonzero(found.counts)
    steps = np.diff(bins, prepend=0).astype("<u2")  # between filled bins: most are 1
    counts = found.counts[bins].astype("<u8")
    content = _HEADER.pack(found.peak / found.limit, len(bins)) + steps.tobytes() + counts.tobytes()
    return base64.b64encode(zlib.compress(content)).decode("ascii")


class Pool:
    """Histograms of independent runs of one target of a requirement.

    Parameters
    ----------
    limit: of the target: the histograms are relative to it, and its unit is that of the result.
    runs: how many there will be.
    """

    def __init__(self, limit: float, runs: int) -> None:
        self.limit = limit
        self.runs = 0
        self._peak = 0.0
        self._groups: Counts = np.zeros((min(max(runs, 1), MOST_GROUPS), BINS), dtype=np.int64)

    def add(self, text: str) -> None:
        """Add the histogram of a run.  Raises ``ValueError`` for a text that is none."""
        peak, bins, counts = _unpack(text)
        # In turn: neighbours in a sequence of Sobol' complement each other, and groups of them would differ too little.
        self._groups[self.runs % len(self._groups), bins] += counts
        self._peak = max(self._peak, peak)
        self.runs += 1

    def state(self, probability: float, confidence: float) -> Statement:
        """The quantile of all values with its bound, in the unit of the limit.  Bootstrap over runs."""
        groups = self._groups[: max(1, min(self.runs, len(self._groups)))]
        stated = state_of_counts(groups, list_edges(self.limit, self._peak * self.limit), probability, confidence)
        return replace(stated, independent=float(self.runs))


def _unpack(text: str) -> tuple[float, NDArray[np.int64], Counts]:
    """Largest value over the limit, filled bins and their counts."""
    try:
        reader = zlib.decompressobj()
        content = reader.decompress(base64.b64decode(text, validate=True), _HEADER.size + 10 * BINS)
        peak, filled = _HEADER.unpack_from(content)
        if not reader.eof or len(content) != _HEADER.size + 10 * filled:
            raise ValueError("it is cut off")
        bins = np.cumsum(np.frombuffer(content, "<u2", filled, _HEADER.size).astype(np.int64))
        counts = np.frombuffer(content, "<u8", filled, _HEADER.size + 2 * filled).astype(np.int64)
    except (binascii.Error, zlib.error, struct.error, ValueError) as error:
        raise ValueError(f"a histogram of a run is damaged: {error}") from error
    if len(bins) and (bins[-1] >= BINS or (np.diff(bins) <= 0).any()):
        raise ValueError("a histogram of a run is damaged: its bins do not ascend")
    return peak, bins, counts
