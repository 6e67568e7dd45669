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

import numpy as np
from numpy.typing import NDArray

from ..pointing.confidence import (
    LEAST_RUNS,
    MARKOV,
    SEEN_AT,
    Statement,
    find_rank,
    samples_needed,
    share_out,
    state_by_moments,
    state_quantile,
    state_rms_of_runs,
    state_worst,
)
from ..pointing.interpretation import Interpretation, quantile_of_peaks, state_pooled
from .distribution import BINS, Distribution, list_edges
from .requirement import Requirement

Array = NDArray[np.float64]
Counts = NDArray[np.int64]

MOST_GROUPS = 400
"""Groups of runs whose histograms are kept; more runs share one.  A group of independent runs is as good a unit as a
run, and 400 take 80 MB however many runs there are."""
MARGIN = 1.3
"""Of an advice: what a record is worth is known to some 30 %."""
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
        return quantile_of_peaks([run.peak for run in runs], probability, confidence)
    counts = np.array([run.counts for run in runs])
    return state_of_counts(counts, list_edges(runs[0].limit, max(run.peak for run in runs)), probability, confidence)


def advise(requirement: Requirement, statement: Statement, runs: int, judged_s: float) -> str:
    """What gives a quantile a bound by order statistics; what narrows it where it has one already.

    ``runs``: how many were judged, each of ``judged_s``.
    """
    probability, confidence = requirement.probability, requirement.confidence
    closest = math.isfinite(statement.bound) and not statement.method.startswith(MARKOV)
    if probability is None or confidence is None or closest:
        longer = requirement.interpretation is Interpretation.TEMPORAL
        return f"As a rule, {'a longer run narrows' if longer else 'more runs narrow'} the interval."
    if requirement.interpretation is Interpretation.TEMPORAL:
        needed = samples_needed(probability, share_out(confidence, runs))
        length = judged_s * needed / statement.independent
        return (
            f"Run about {_round_up(MARGIN * length + requirement.settling_s):g} s: the {judged_s:.4g} s judged have "
            f"{_count_samples(statement.independent)}, and {needed} are needed."
        )
    needed = samples_needed(probability, confidence)
    if requirement.interpretation is Interpretation.MIXED:
        each = statement.independent / runs if runs >= LEAST_RUNS else 1.0
        needed = max(LEAST_RUNS, math.ceil(min(1.0, MARGIN / each) * needed)) if each else needed
    return f"{needed} runs with different seeds are needed, and there {_count(runs)}."


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
        return state_worst([run.state_rms(together) for run in runs], confidence)
    each = [quantile_of_record(run, probability, together) for run in runs]
    for place, (run, one) in enumerate(zip(runs, each, strict=True)):
        if math.isinf(one.bound) and not run.is_constant:
            each[place] = state_by_moments(one, run.state_rms(together), run.kurtosis, probability)
    return state_worst(each, confidence)


def quantile_of_record(run: Distribution, probability: float, confidence: float) -> Statement:
    """As :func:`..pointing.confidence.quantile`, from the distribution of the magnitudes over a run."""
    worth = min(run.weigh_share(probability).count_ranks(confidence), float(run.count))
    return state_quantile(run.value, run.count, worth, probability, confidence, method="order statistics over time")


def state_of_counts(counts: Counts, edges: Array, probability: float, confidence: float) -> Statement:
    """The quantile of the values of all runs.

    Parameters
    ----------
    counts: (runs, bins), values of each run in each bin; fewer than five runs have no bound.
    edges: (bins,), upper ends of the bins.
    """
    up_to = np.cumsum(counts.sum(axis=0))
    total = int(up_to[-1])

    def place(rank: int) -> int:
        return int(np.searchsorted(up_to, rank))

    above = counts[:, place(find_rank(total, min(probability, SEEN_AT))) + 1 :].sum(axis=1)
    each = counts.sum(axis=1)
    stated = state_pooled(lambda rank: float(edges[place(rank)]), total, above / each, probability, confidence)
    if math.isfinite(stated.bound):
        return stated
    mean_squares = counts @ edges**2 / each
    whole = float(mean_squares.mean())
    kurtosis = float(counts.sum(axis=0) @ edges**4) / total / whole**2 if whole else 0.0
    return state_by_moments(stated, state_rms_of_runs(mean_squares, confidence), kurtosis, probability)


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
        """The quantile of all values with its bound, in the unit of the limit."""
        groups = self._groups[: max(1, min(self.runs, len(self._groups)))]
        return state_of_counts(groups, list_edges(self.limit, self._peak * self.limit), probability, confidence)


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
