"""How sure a quantile or a variance is: order statistics, effective number of samples, bootstrap over runs.

Every function returns a :class:`Statement`.  Samples that follow each other in time are not independent: say how many
independent ones they are worth (:func:`effective_samples`), or resample whole runs (:func:`bootstrap`).

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

WINDOW_FACTOR = 5.0  # Sokal: lags up to 5 correlation times
LEAST_RUNS = 5  # for a bootstrap: resamples of fewer hardly differ


@dataclass(frozen=True)
class Statement:
    """A number and how sure it is, in the unit of the values."""

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
    """Least number of independent cases whose largest bounds a quantile: n >= ln(1 - gamma) / ln P.

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
    """Quantile of values (n,), with an interval and a bound from order statistics, whatever the distribution.

    Parameters
    ----------
    values: magnitudes of an index, of independent cases or of a record.
    independent: number of independent samples they are worth; None: all n.  Values of a record have fewer, see
        :func:`effective_samples`; the ranks are those of so many cases.
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
        return -math.inf if rank is None else value(max(1, (cases - rank + 1) * count // cases))

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
    """RMS of a Gaussian error without bias, worth ``independent`` samples: independent s^2 / sigma^2 is chi-square.

    The number for a record is that of its squares: ``effective_samples(values**2)``.
    """
    from scipy.stats import chi2

    _check(confidence, "confidence")
    if not independent > 0.0:
        raise ValueError(f"independent: expected above 0, got {independent!r}")

    def at(level: float) -> float:
        return rms * math.sqrt(independent / float(chi2.ppf(level, independent)))

    side = 0.5 * (1.0 - confidence)
    return Statement(
        value=rms,
        confidence=confidence,
        lower=at(1.0 - side),
        upper=at(side),
        bound=at(1.0 - confidence),
        independent=independent,
        method="chi-square",
    )


def windows_rms(values: ArrayLike, confidence: float = 0.95) -> Statement:
    """RMS of an index over the windows of one record, whatever its distribution and correlation.

    ``values`` of one signal, (windows, r, 1) as :meth:`.index.PointingIndex.values` has them, or (windows, r), or
    (windows,).  The mean squares of the windows are worth :func:`least_samples`; the interval is that of the chi-square
    distribution with the same mean and variance as their mean.  For independent Gaussian values that is
    :func:`gaussian_rms`.  Of 200 records of 60 s each, noise of a resonance at 1 Hz with 2 % of damping, 80 to 96 % of
    the intervals of 90 % held the true value (by index; with :func:`effective_samples` 63 to 90 %).
    """
    squares = np.asarray(values, dtype=float) ** 2
    if squares.ndim > 3 or squares.shape[2:] not in ((), (1,)):
        raise ValueError(f"values: expected those of one signal, got the shape {squares.shape}")
    alone = squares.size == len(squares)  # one value in each window
    squares = _finite(squares if squares.ndim == 1 else squares.reshape(len(squares), -1).mean(axis=1))
    mean, number = float(squares.mean()), least_samples(squares)
    spread = float(squares.var(ddof=1)) / number if len(squares) > 1 else 0.0
    if not spread > 0.0:
        raise ValueError("values: their squares do not vary, which says nothing of how sure their mean is")
    freedom = 2.0 * mean**2 / spread
    if alone:
        # A few squares without a large one among them vary too little: they are worth no more than Gaussian ones.
        freedom = min(freedom, number)
    return replace(gaussian_rms(math.sqrt(mean), freedom, confidence), independent=number)


def effective_samples(values: ArrayLike) -> float:
    """Number of independent samples whose mean is as sure as that of a correlated record (n,); 1 to n.

    n over the integrated correlation time tau = 1 + 2 sum rho_m, summed up to the first lag m of at least 5 tau
    (A. D. Sokal, Monte Carlo methods in statistical mechanics, in: Functional Integration, Plenum 1997, 131-192).  The
    record's own mean in place of the true one makes tau too small by a share (2 m + 1) / n, which is made up for (U.
    Wolff, Monte Carlo errors with less errors, Comput. Phys. Comm. 156 (2004) 143-153).  For the variance of a record
    give its squares, for a quantile ``values <= quantile``: these are the means in question.  A record of fewer than
    some 50 tau says little about its own tau: :func:`least_samples` allows for it.
    """
    return _effective_samples(values, 0.0)


def least_samples(values: ArrayLike) -> float:
    """As :func:`effective_samples`, but rather too few than too many; 1 to n.

    The estimate of tau has the standard deviation sqrt(2 (2 m + 1) / n) of itself (Wolff, as above); here it is added.
    It is small for long records.  Of 200 records worth 210 samples, 146 were worth as many as it says or more.
    """
    return _effective_samples(values, 1.0)


def effective_share(values: ArrayLike, level: float) -> float:
    """Number of independent samples for the share of a record (n,) up to ``level``; 1 to n.

    Where no value is above it, as of a signal that saturates, for the share below it: the other never varies.
    """
    series = _finite(values)
    inside = series <= level
    return effective_samples(series < level if inside.all() else inside)


def _effective_samples(values: ArrayLike, deviations: float) -> float:
    """With so many standard deviations of the correlation time added to its estimate."""
    series = _finite(values)
    deviation = series - series.mean()
    n = len(series)
    spectrum = np.fft.rfft(deviation, 1 << (2 * n - 1).bit_length())  # a power of two: up to 200 times as fast
    covariance = np.fft.irfft(spectrum.real**2 + spectrum.imag**2)[:n]
    if not covariance[0] > 1e-24 * n * float(np.abs(series).max()) ** 2:  # constant to rounding
        return 1.0
    share = (2.0 * np.arange(n) + 1.0) / n
    tau = (2.0 * np.cumsum(covariance / covariance[0]) - 1.0) * (1.0 + share)
    enough = np.flatnonzero(np.arange(n) >= WINDOW_FACTOR * tau)
    last = int(enough[0]) if enough.size else n - 1
    longest = float(tau[last]) * (1.0 + deviations * math.sqrt(2.0 * float(share[last])))
    return float(min(n, max(1.0, n / max(longest, 1e-12))))


def bootstrap(
    runs: ArrayLike,
    statistic: Callable[[Array], float],
    confidence: float = 0.95,
    *,
    seed: int,
    resamples: int = 2000,
    probability: float | None = None,
) -> Statement:
    """Interval of any statistic of independent runs, by resampling whole runs.

    B. Efron, Better bootstrap confidence intervals, J. Amer. Statist. Assoc. 82 (1987) 171-185: bias-corrected and
    accelerated.  Correlation within a run does no harm.  For quantiles far out use :func:`quantile`: no resample holds
    a value beyond those of the sample.

    Parameters
    ----------
    runs: (n, ...), run by run; at least five.
    statistic: of an array (m, ...) of runs.
    seed: the same seed gives the same interval.
    probability: passed on to the statement.
    """
    runs = np.asarray(runs, dtype=float)

    def of_counts(counts: NDArray[np.int64]) -> Array:
        return np.array([statistic(np.repeat(runs, count, axis=0)) for count in counts])

    return bootstrap_counts(len(runs), of_counts, confidence, seed=seed, resamples=resamples, probability=probability)


def bootstrap_counts(
    runs: int,
    statistic: Callable[[NDArray[np.int64]], Array],
    confidence: float,
    *,
    seed: int,
    resamples: int = 2000,
    probability: float | None = None,
) -> Statement:
    """As :func:`bootstrap`, for a statistic (k,) of how often each run is in a sample (k, runs)."""
    from scipy.stats import norm

    _check(confidence, "confidence")
    if runs < LEAST_RUNS:
        raise ValueError(f"runs: a bootstrap needs {LEAST_RUNS} at least, got {runs}")
    once = np.ones((1, runs), dtype=np.int64)
    value = float(statistic(once)[0])
    draws = np.random.default_rng(seed).multinomial(runs, np.full(runs, 1.0 / runs), size=resamples)
    found = np.sort(statistic(draws))
    shorter = statistic(once - np.eye(runs, dtype=np.int64))
    pull = shorter.mean() - shorter
    spread = float((pull**2).sum())
    acceleration = float((pull**3).sum()) / (6.0 * spread**1.5) if spread > 0.0 else 0.0
    share = np.mean(found < value) + 0.5 * np.mean(found == value)  # values may repeat
    shift = norm.ppf(np.clip(share, 0.5 / resamples, 1.0 - 0.5 / resamples))

    def at(level: float) -> float:
        z = shift + norm.ppf(level)
        return float(np.quantile(found, norm.cdf(shift + z / (1.0 - acceleration * z))))

    side = 0.5 * (1.0 - confidence)
    return Statement(
        value=value,
        confidence=confidence,
        lower=at(side),
        upper=at(1.0 - side),
        bound=at(confidence),
        independent=float(runs),
        method="bootstrap over runs",
        probability=probability,
    )


def _finite(values: ArrayLike) -> Array:
    found = np.asarray(values, dtype=float)
    if found.ndim != 1 or not len(found) or not np.isfinite(found).all():
        raise ValueError("values: expected the shape (n,), n from 1 on, and finite numbers")
    return found


def _check(value: float, name: str) -> None:
    if not 0.0 < value < 1.0:
        raise ValueError(f"{name}: expected between 0 and 1, got {value!r}")
