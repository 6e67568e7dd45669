"""How sure a quantile or a mean square is: order statistics, the worth of a record, Markov's inequality.

Every function returns a :class:`Statement`.  Samples that follow each other in time are not independent:
:func:`weigh_record` says how many independent ones they are worth.  For any other statistic of independent runs
``scipy.stats.bootstrap`` resamples whole runs.

Order statistics: S. S. Wilks, Determination of sample sizes for setting tolerance limits, Ann. Math. Statist. 12 (1941)
91-96.  The largest of n independent cases bounds the quantile P with the confidence gamma if 1 - P^n >= gamma.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

WINDOW_FACTOR = 2.5  # correlation times up to which lags are summed: 5 of Sokal's, whose time is half as long
LEAST_RUNS = 5  # for a statement on the ensemble without order statistics
LEAST_BATCHES, MOST_BATCHES = 64, 2048  # of a record, whose means show its slow part
SEEN_AT = 0.95
"""The correlation of a record is measured at this quantile, where it has enough exceedances; those of a higher level
come in clusters that are no longer."""
MARKOV = "Markov's inequality"
# Allowances, chosen so that bounds of 90 % hold in 87 % of records at least (python tests/support/coverage.py):
DOUBTED = 0.35
"""Standard deviations of what batches say that are taken off before they count."""
HIDDEN = 15.0
"""A slow part of so many stretches may have as much variance again in what is slower still."""
SPARE = 5.0
"""k squares of a record are worth k^2 / (k + SPARE) only: a record that drifts hides how slow it is."""
LEAST_SQUARES = 3.0
"""Gaussian squares that a mean square is worth at least: as many as a Markov process gives in 2.4 correlation times,
x / (1 - (1 - exp(-2 x)) / (2 x)) in x of them.  In fewer, what is slow looks like a bias."""
SKEWER = 1.6
"""Skewness of squares over that of a record, which seldom has the strongest bursts."""


@dataclass(frozen=True)
class Statement:
    """A number with its confidence interval and bound, in the unit of the values."""

    value: float  # best estimate
    confidence: float
    """Probability with which the interval holds the true value, and with which ``bound`` is not below it."""
    lower: float  # lower end of the two-sided interval; -inf where there are too few samples for one
    upper: float  # upper end of the two-sided interval; inf where there are too few samples for one
    bound: float  # one-sided upper bound, which a limit is compared with; inf where there are too few samples for one
    independent: float  # number of independent samples that the statement rests on
    method: str  # how interval and bound were found
    probability: float | None = None  # of the quantile; None if the value is not a quantile
    ensemble_share: float | None = None
    """Share of all possible runs that the bound covers, where it holds for every run of a sample (temporal)."""

    def __str__(self) -> str:
        """One line, for example ``0.41 (95 % quantile), below 0.46 with 90 % confidence, 59 independent samples``."""
        what = "" if self.probability is None else f" ({100.0 * self.probability:g} % quantile)"
        sure = f"{100.0 * self.confidence:g} % confidence"
        bound = f"below {self.bound:.4g} with {sure}" if math.isfinite(self.bound) else f"no bound with {sure}"
        return f"{self.value:.4g}{what}, {bound}, {self.independent:.4g} independent samples ({self.method})"


def samples_needed(probability: float, confidence: float) -> int:
    """Return the least number of independent cases whose largest value bounds a quantile: n >= ln(1 - gamma) / ln P.

    59 for 95 % at 95 % confidence, 852 for 99.73 % at 90 %.
    """
    _check(probability, "probability")
    _check(confidence, "confidence")
    n = math.ceil(math.log1p(-confidence) / math.log(probability) - 1e-9)
    return max(n, 1)


def bounding_rank(count: int, probability: float, confidence: float) -> int | None:
    """Rank r, from 1: the r-th smallest of ``count`` cases is the lowest that bounds the quantile from above.

    The quantile P lies below it with a probability of sum_{k<r} binomial(n, k) P^k (1 - P)^(n - k), which is at least
    ``confidence``.  None if there are fewer cases than :func:`samples_needed`.
    """
    _check(probability, "probability")
    _check(confidence, "confidence")
    below = _find_binomial(count, probability, confidence * (1.0 - 1e-12))
    return below + 1 if below < count else None


def _find_binomial(count: int, probability: float, level: float) -> int:
    """The smallest k with sum_{j<=k} binomial(n, j) P^j (1 - P)^(n - j) of ``level`` at least.

    Terms from their ratios, outwards from the largest, as far as they are not zero.  ``scipy.special`` has the sum, and
    takes 0.2 s to be imported: a tenth of a short run.
    """
    largest = min(count, math.floor((count + 1) * probability))
    reach = math.ceil(40.0 * math.sqrt(count * probability * (1.0 - probability))) + 400
    first, last = max(0, largest - reach), min(count, largest + reach)
    odds = probability / (1.0 - probability)
    above = np.arange(largest + 1, last + 1, dtype=float)
    under = np.arange(largest, first, -1, dtype=float)
    rising = np.cumprod((count - above + 1.0) / above * odds)
    falling = np.cumprod(under / (count - under + 1.0) / odds)
    sums = np.cumsum(np.concatenate((falling[::-1], [1.0], rising)))
    return min(last, first + int(np.searchsorted(sums, level * sums[-1])))


def quantile(
    values: ArrayLike, probability: float, confidence: float = 0.95, *, independent: float | None = None
) -> Statement:
    """Return a quantile of values (n,), with interval and bound from order statistics, for any distribution.

    Parameters
    ----------
    values: magnitudes of an index, of independent cases or of a record.
    independent: number of independent samples that the values are equivalent to; None: all n.  For values of a record
        see :func:`effective_samples`.  The ranks follow from this number.
    """
    ordered = np.sort(_finite(values))
    number = float(len(ordered)) if independent is None else float(independent)
    if not 0.0 < number <= len(ordered):
        raise ValueError(f"independent: expected above 0 and at most {len(ordered)}, got {number!r}")
    return state_quantile(lambda rank: float(ordered[rank - 1]), len(ordered), number, probability, confidence)


def state_quantile(
    value: Callable[[int], float],
    count: int,
    independent: float,
    probability: float,
    confidence: float,
    method: str = "order statistics",
) -> Statement:
    """As :func:`quantile`, of ``count`` values of which ``value`` gives that of a rank, from 1, in ascending order."""
    _check(probability, "probability")
    _check(confidence, "confidence")
    cases = math.floor(independent + 1e-9)

    # A rank among the independent cases stands for the same share of all values: rounded up for a bound from above,
    # down for one from below.
    def above(level: float) -> float:
        rank = bounding_rank(cases, probability, level) if cases else None
        return math.inf if rank is None else value(-(-rank * count // cases))

    def below(level: float) -> float:
        # Mirrored: the r-th largest bounds the quantile from below as the r-th smallest of -values does from above.
        rank = bounding_rank(cases, 1.0 - probability, level) if cases else None
        return -math.inf if rank is None else value((cases - rank) * count // cases + 1)

    side = 0.5 * (1.0 + confidence)
    return Statement(
        value=value(find_rank(count, probability)),
        confidence=confidence,
        lower=below(side),
        upper=above(side),
        bound=above(confidence),
        independent=independent,
        method=method,
        probability=probability,
    )


def find_rank(count: int, share: float) -> int:
    """Rank, from 1, of the value below which, or at which, a share of ``count`` values lies."""
    return min(count, max(1, math.ceil(share * count - 1e-9)))


def share_out(confidence: float, runs: int) -> float:
    """The confidence of each run's bound with which all hold together."""
    return 1.0 - (1.0 - confidence) / runs


def state_worst(each: Sequence[Statement], confidence: float) -> Statement:
    """The worst of several runs, from statements on each at the confidence of :func:`share_out`."""
    worst, runs = max(each, key=lambda one: one.value), len(each)
    return replace(
        worst,
        confidence=confidence,
        lower=max(one.lower for one in each),
        upper=max(one.upper for one in each),
        bound=max(one.bound for one in each),
        independent=min(one.independent for one in each),
        method=worst.method if runs == 1 else f"{worst.method}, worst of {runs} runs",
        ensemble_share=(1.0 - confidence) ** (1.0 / runs),
    )


def gaussian_rms(rms: float, independent: float, confidence: float = 0.95) -> Statement:
    """State the RMS of a Gaussian error without bias from ``independent`` samples.

    ``independent`` s^2 / sigma^2 follows a chi-square distribution.  For a record the number of samples is
    ``effective_samples(values**2)``.
    """
    if not independent > 0.0:
        raise ValueError(f"independent: expected above 0, got {independent!r}")
    return _state_rms(rms, math.sqrt(2.0 / independent) * rms**2, independent, independent, confidence)


def state_rms(rms: float, squares: ArrayLike, confidence: float, sizes: ArrayLike | None = None) -> Statement:
    """RMS of a record, whatever its distribution and correlation, from a series of its squares (n,).

    The mean square is taken for a gamma variable with a shift, which has the record's variance and skewness (Pearson's
    type III).  For independent Gaussian values that is :func:`gaussian_rms`; for bursts and slow parts it is wider.

    Parameters
    ----------
    rms: of all values; the series may be a part of them.
    sizes: as for :func:`weigh_record`; by default the roots of the squares.
    """
    series = _finite(squares)
    worth = weigh_record(series, np.sqrt(series) if sizes is None else sizes)
    deviation, mean = series - series.mean(), float(series.mean())
    spread = float(series.std())
    freedom = _allow(worth.slowest)
    independent = max(1.0, worth.independent * freedom / worth.slowest)
    # Few squares without a large one among them vary too little: they are worth no more than Gaussian ones.
    error = max(spread, math.sqrt(2.0) * mean) / math.sqrt(independent)
    skewness = SKEWER * float((deviation**3).mean()) / spread**3 if worth.independent > 1.0 else 0.0
    if skewness > 0.0:
        freedom = max(LEAST_SQUARES, min(freedom, 8.0 * independent / skewness**2))
    return _state_rms(rms, error * (rms**2 / mean if mean else 1.0), freedom, worth.independent, confidence)


def _allow(squares: float) -> float:
    """See :data:`SPARE` and :data:`LEAST_SQUARES`."""
    return max(LEAST_SQUARES, squares**2 / (squares + SPARE))


def _state_rms(rms: float, error: float, freedom: float, independent: float, confidence: float) -> Statement:
    """The mean square has the standard deviation ``error``, and the skewness of ``freedom`` Gaussian squares."""
    from scipy.special import chdtri

    _check(confidence, "confidence")
    moving = error * math.sqrt(0.5 * freedom)  # the part of the mean square that varies, if these squares make it

    def at(level: float) -> float:  # with this probability the true value is above it
        found = rms**2 + moving * (freedom / float(chdtri(freedom, 1.0 - level)) - 1.0)
        return math.sqrt(max(found, (1.0 - level) * rms**2))  # Markov's inequality holds for any mean square

    side = 0.5 * (1.0 - confidence)
    return Statement(
        value=rms,
        confidence=confidence,
        lower=at(1.0 - side),
        upper=at(side),
        bound=at(1.0 - confidence),
        independent=independent,
        method="mean square",
    )


def windows_rms(values: ArrayLike, confidence: float = 0.95) -> Statement:
    """State the RMS of an index over the windows of one record: :func:`state_rms` of the mean squares of the windows.

    ``values``: of one signal, (windows, r, 1) as :meth:`.index.PointingIndex.values` returns them, (windows, r), or
    (windows,).
    """
    squares = np.asarray(values, dtype=float) ** 2
    if squares.ndim > 3 or squares.shape[2:] not in ((), (1,)):
        raise ValueError(f"values: expected those of one signal, got the shape {squares.shape}")
    squares = _finite(squares if squares.ndim == 1 else squares.reshape(len(squares), -1).mean(axis=1))
    if not float(squares.var()) > 0.0:
        raise ValueError("values: their squares do not vary, which says nothing of how sure their mean is")
    return state_rms(math.sqrt(float(squares.mean())), squares, confidence)


def state_by_moments(stated: Statement, rms: Statement, kurtosis: float, probability: float) -> Statement:
    """The bound of a quantile from that of the RMS, for want of order statistics.

    A share 1 - P of all values can be above q only if they have (1 - P) q^4 of the mean fourth power (Markov's
    inequality), which is RMS^4 times the kurtosis of the values, or 3 times if theirs is smaller.  The bound is wide:
    2.8 RMS for 95 % and 5.8 RMS for 99.73 % of a Gaussian signal, which has 2.0 and 3.0.
    """
    factor = (max(3.0, kurtosis) / (1.0 - probability)) ** 0.25
    return replace(stated, upper=factor * rms.upper, bound=factor * rms.bound, method=MARKOV)


def find_kurtosis(sizes: ArrayLike) -> float:
    """Mean fourth power over the squared mean square of magnitudes (n,); 0 where all are."""
    squares = np.square(np.asarray(sizes, dtype=float))
    mean = float(squares.mean())
    return float((squares**2).mean()) / mean**2 if mean > 0.0 else 0.0


@dataclass(frozen=True)
class Worth:
    """How sure the mean of a record is."""

    independent: float
    """Independent values whose mean is as sure."""
    slowest: float
    """Independent stretches of the slowest part on which the mean depends; ``independent`` where it is the only one."""

    def count_ranks(self, confidence: float) -> float:
        """Independent samples whose ranks bound a quantile; fewer than ``independent`` where a slow part matters.

        In a record in which the slow part is small its variance is small as well, so that the two errors add up.  The
        bound of a mean of k squares lies sqrt(k / 2) (k / chi^2_{1 - gamma}(k) - 1) standard deviations above it.
        """
        if self.slowest >= self.independent:
            return self.independent
        reach = _reach(self.independent, confidence) / _reach(self.slowest, confidence)
        return max(1.0, self.independent * min(1.0, reach) ** 2)


def _reach(squares: float, confidence: float) -> float:
    """See :meth:`Worth.count_ranks`; chi-square by E. B. Wilson and M. M. Hilferty, which needs no scipy."""
    from statistics import NormalDist

    part = 2.0 / (9.0 * squares)
    share = (1.0 - part + NormalDist().inv_cdf(1.0 - confidence) * math.sqrt(part)) ** 3
    return math.sqrt(0.5 * squares) * (1.0 / max(share, 1e-3) - 1.0)


def effective_samples(values: ArrayLike) -> float:
    """Return the number of independent samples, 1 to n, whose mean is as certain as that of a correlated record (n,).

    n over the integrated correlation time tau = 1 + 2 sum rho_m, summed up to the first lag m of at least 2.5 tau
    (A. D. Sokal, Monte Carlo methods in statistical mechanics, in: Functional Integration, Plenum 1997, 131-192: 5 of
    his tau, which is half of this).  Longer sums add more scatter than they find: their tau may run away.  The mean of
    the record in place of the true mean reduces tau by the share (2 m + 1) / n, which is corrected (U. Wolff,
    Monte Carlo errors with less errors, Comput. Phys. Comm. 156 (2004) 143-153).  For the variance of a record give its
    squares; for a quantile give ``values <= quantile``.  A record of less than some 50 tau gives a poor estimate of
    tau, and a slow part beside a fast part is not detected; :func:`weigh_record` allows for both.
    """
    series = _finite(values)
    return float(np.clip(len(series) / find_correlation(series)[0], 1.0, len(series)))


def weigh_record(values: ArrayLike, sizes: ArrayLike) -> Worth:
    """Return a cautious number of independent samples for the mean of a correlated record ``values`` (n,).

    The correlation time is that of :func:`effective_samples` plus its standard deviation.  If a fast
    part hides a slow part, sums of correlations end before the slow part counts.  So the record is averaged over 64,
    128, ... 2048 batches, too.  If the means of batches vary more than this correlation time allows, the correlation
    time of the means gives the number.

    Parameters
    ----------
    values: the averaged values: squares, or 1 where a magnitude is above a level and 0 elsewhere.
    sizes: magnitudes (n,) of the record, which show a slow part best.
    """
    series, magnitudes = _finite(values), np.asarray(sizes, dtype=float)
    n, variance = len(series), float(series.var())
    if not variance > 1e-24 * float(np.abs(series).max()) ** 2:  # constant to rounding
        return Worth(1.0, 1.0)
    tau, doubt = find_correlation(series)
    first = error = tau * (1.0 + doubt) / n  # variance of the mean over that of a value
    slowest, clipped = float(n), None
    batches = LEAST_BATCHES
    while batches <= min(n // 2, MOST_BATCHES):
        means = _average(series, batches)
        tau, doubt = find_correlation(means)
        share = float(means.var(ddof=1)) * tau / batches / variance
        if share * (1.0 - DOUBTED * doubt) > first:
            if clipped is None:  # bursts would hide what is slow
                clipped = np.minimum(magnitudes, np.quantile(magnitudes, SEEN_AT))
            own, unsure = find_correlation(_average(clipped, batches))
            if own > 1.0 + 3.0 * math.sqrt(2.0 * (2.0 * WINDOW_FACTOR + 1.0) / batches):  # white means: 3 deviations
                error = max(error, share * (1.0 + doubt))
                slowest = min(slowest, batches / (own * (1.0 + unsure)))
        batches *= 2
    if slowest < n:
        error *= 1.0 + HIDDEN / slowest
    independent = min(float(n), max(1.0, 1.0 / error))
    return Worth(independent, max(1.0, min(independent, slowest)))


def weigh_share(sizes: ArrayLike, probability: float) -> Worth:
    """What a record of magnitudes (n,) is worth for its quantile.

    It is measured at the quantile itself, up to :data:`SEEN_AT`.  Where no value is above it, as of a signal that
    saturates, the share below it counts: the other never varies.
    """
    series = _finite(sizes)
    place = find_rank(len(series), min(probability, SEEN_AT)) - 1
    level = np.partition(series, place)[place]
    inside = series <= level
    return weigh_record(series < level if inside.all() else inside, series)


def _average(series: Array, batches: int) -> Array:
    length = len(series) // batches
    return np.asarray(series[: length * batches].reshape(batches, length).mean(axis=1))


def find_correlation(values: ArrayLike) -> tuple[float, float]:
    """Integrated correlation time of a record (n,) in samples, and its standard deviation as a share of itself.

    As :func:`effective_samples` has it; the share is sqrt(2 (2 m + 1) / n) (Wolff).  n and 0 for a constant.
    """
    series = np.asarray(values, dtype=float)
    deviation = series - series.mean()
    n = len(series)
    spectrum = np.fft.rfft(deviation, 1 << (2 * n - 1).bit_length())  # a power of two: up to 200 times as fast
    covariance = np.fft.irfft(spectrum.real**2 + spectrum.imag**2)[:n]
    if not covariance[0] > 1e-24 * n * float(np.abs(series).max()) ** 2:
        return float(n), 0.0
    share = (2.0 * np.arange(n) + 1.0) / n
    tau = (2.0 * np.cumsum(covariance / covariance[0]) - 1.0) * (1.0 + share)
    enough = np.flatnonzero(np.arange(n) >= WINDOW_FACTOR * tau)
    last = int(enough[0]) if enough.size else n - 1
    return max(float(tau[last]), 1e-12), math.sqrt(2.0 * float(share[last]))


def weigh_runs(shares: ArrayLike) -> float:
    """Independent samples that runs are worth for a quantile of all their values together.

    ``shares`` (runs,): of the values of each run that are above that quantile, or above that of :data:`SEEN_AT`.
    Exceedances come in clusters, a run each: one stands for sum s^2 / sum s runs, and for 1 + 2 / sqrt(runs) times as
    many, since few runs seldom have one of the worst among them.
    """
    share = _finite(shares)
    total = float(share.sum())
    if not total > 0.0:
        return float(len(share))
    cluster = float((share**2).sum()) / total * (1.0 + 2.0 / math.sqrt(len(share)))
    return len(share) / cluster


def state_rms_of_runs(squares: ArrayLike, confidence: float) -> Statement:
    """RMS over independent runs from the mean square of each (runs,); without a bound for fewer than five."""
    each = _finite(squares)
    rms, runs = math.sqrt(float(each.mean())), len(each)
    if runs < LEAST_RUNS:
        return Statement(rms, confidence, -math.inf, math.inf, math.inf, float(runs), "mean square")
    error = max(float(each.std(ddof=1)), rms**2 * 1e-12) / math.sqrt(runs)
    freedom = _allow(min(runs - 1.0, 2.0 * rms**4 / max(error**2, 1e-300)))
    return _state_rms(rms, error, freedom, float(runs), confidence)


def _finite(values: ArrayLike) -> Array:
    found = np.asarray(values, dtype=float)
    if found.ndim != 1 or not len(found) or not np.isfinite(found).all():
        raise ValueError("values: expected the shape (n,), n from 1 on, and finite numbers")
    return found


def _check(value: float, name: str) -> None:
    if not 0.0 < value < 1.0:
        raise ValueError(f"{name}: expected between 0 and 1, got {value!r}")
