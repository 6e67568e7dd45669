"""Shares of the variance of outputs that factors explain, from any sample: estimates, intervals, a noise floor, shapes.

The **share of a factor** x is the index of first order, Var(E[y | x]) / Var(y): how much of the variance of an output
y it explains by itself.  It is estimated from the cases as they are: E[y | x] is a least-squares curve, a natural
cubic spline over the draws or a mean for each level, of some n^0.4 degrees of freedom, and the share is the adjusted
coefficient of determination (E. Plischke, E. Borgonovo, C. L. Smith, Global sensitivity measures from given data,
Eur. J. Oper. Res. 226 (2013) 536-550).  Its **interval** is the jackknife's, of log(1 - share): leaving out a case
has a closed form.  What a factor without influence reaches by chance is below the **noise floor**: F tests and
Wald's, with the rate of false discoveries of Benjamini and Hochberg over all outputs and factors.

RBD-FAST of SALib estimates the same index without a floor.  Of 60 studies of 200 cases its 90 % intervals held the true
share in each, and 72 % of those of a share of 0.13 reached down to 0.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from functools import cached_property
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .factors import Factor

Array = NDArray[np.float64]

CONFIDENCE = 0.9
"""Of each interval."""
FALSE_SHARE = 0.01
"""Of all shares that are stated, so many are expected to be chance at most; with this probability a study states any in
which nothing has influence (Y. Benjamini, Y. Hochberg, J. R. Stat. Soc. B 57 (1995) 289-300)."""
MOST_DEGREES = 8  # of a curve
ROUNDING = 1e-14  # of a variance


class Estimate(NamedTuple):
    """A number with the ends of its interval."""

    value: float
    lower: float
    upper: float


class Sample:
    """Cases with their draws (n, factors), and the outputs (n, m) that all of them have; ``outputs``: their places."""

    def __init__(self, factors: Sequence[Factor], draws: Array, values: Array, outputs: NDArray[np.intp]) -> None:
        self.draws, self.outputs = draws, outputs
        self.centred = values - values.mean(axis=0)
        pairs = list(zip(factors, draws.T, strict=True))
        degrees = int(np.clip(len(draws) ** 0.4, 1, MOST_DEGREES))
        self.bases = [make_basis(factor, own, degrees) for factor, own in pairs]
        few = min(degrees, len(draws) // (3 * len(factors)))
        self.joint = np.empty((len(draws), 0))
        """Columns of all factors together; none where the cases are too few for them."""
        if few:
            joint = _orthonormalise(np.hstack([make_basis(factor, own, few) for factor, own in pairs]))
            self.joint = joint if joint.shape[1] <= len(draws) // 2 else self.joint
        self._low = [make_basis(factor, own, 2)[:, :2] for factor, own in pairs]

    @cached_property
    def chances(self) -> Array:
        """(m, factors): probability that a factor without influence explains as much; NaN: too few cases."""
        none = np.empty((len(self.draws), 0))
        return np.column_stack([_find_chances(own, self.centred, none) for own in self.bases])

    @cached_property
    def rests(self) -> Array:
        """(n, m), what no sum of curves explains; NaN where that is rounding."""
        rests = self.centred - self.joint @ (self.joint.T @ self.centred)
        rests[:, (rests**2).sum(axis=0) <= ROUNDING * (self.centred**2).sum(axis=0)] = np.nan
        return rests

    def list_pairs(self) -> Iterator[tuple[int, int]]:
        """Places of two factors each, where the cases say something of what these do together."""
        return combinations(range(len(self.bases)), 2) if self.joint.shape[1] else iter(())

    def multiply(self, i: int, j: int) -> Array:
        """Orthonormal columns of what two factors do together, beyond sums: products of two columns of each."""
        one, other = self._low[i], self._low[j]
        products = (one[:, :, None] * other[:, None, :]).reshape(len(one), -1)
        products -= products.mean(axis=0)
        scale = float(np.abs(products).max(initial=0.0))
        return _orthonormalise(products - self.joint @ (self.joint.T @ products), scale)

    @cached_property
    def pair_chances(self) -> Array:
        """(m, pairs), as :attr:`chances`."""
        found = [_find_chances(self.multiply(i, j), self.rests, self.joint) for i, j in self.list_pairs()]
        return np.column_stack(found) if found else np.empty((len(self.outputs), 0))

    def estimate(self, place: int, column: int, level: float) -> Estimate | None:
        """Share of the variance of an output that a factor explains; None: not shown to be above chance.

        It is if its test says so at a ``level``, and the jackknife, which allows for a variance that depends on the
        factor, with a probability of a false share of its own.
        """
        own, y = self.bases[place], self.centred[:, column]
        if not self.chances[column, place] <= level or estimate_share(own, y, 1.0 - 2.0 * FALSE_SHARE).lower == 0.0:
            return None
        return estimate_share(own, y)

    def estimate_pair(self, i: int, j: int, column: int) -> Estimate:
        """Share of the variance of an output that two factors explain together, beyond sums."""
        return _estimate_pair(self.joint, self.multiply(i, j), self.centred[:, column])

    def find_floor(self, level: float) -> float:
        """Share that a factor without influence reaches with the chance ``level``: the largest of all factors."""
        floors = [_find_floor(len(self.draws), own.shape[1], level) for own in self.bases]
        return max((floor for floor in floors if math.isfinite(floor)), default=1.0)


def find_level(chances: Sequence[Array]) -> float:
    """The level at which all chances (n, m) are tested together; NaN: no test."""
    from scipy.stats import false_discovery_control

    all_of_them = np.concatenate([one[np.isfinite(one)] for one in chances]) if chances else np.empty(0)
    if not len(all_of_them):
        return 0.0
    shown = int((false_discovery_control(all_of_them) <= FALSE_SHARE).sum())
    return FALSE_SHARE * max(shown, 1) / len(all_of_them)


def make_basis(factor: Factor, draws: Array, degrees: int) -> Array:
    """Orthonormal columns (n, k) of mean 0 that span a natural cubic spline with its knots at quantiles of the draws;
    of a factor of texts, or of few levels, any means of the levels.
    """
    from scipy.interpolate import CubicSpline

    levels, which = np.unique(draws, return_inverse=True)
    knots = np.unique(np.quantile(draws, np.linspace(0.0, 1.0, degrees + 1)))
    if factor.has_texts or len(levels) <= degrees + 1 or len(knots) < 3:
        columns = np.eye(len(levels))[which]
    else:
        columns = CubicSpline(knots, np.eye(len(knots)), bc_type="natural")(draws)
    return _orthonormalise(columns - columns.mean(axis=0))


def _orthonormalise(columns: Array, scale: float = 0.0) -> Array:
    """Columns of the same span; what is rounding of ``scale``, or of the largest, is left out."""
    left, sizes, _ = np.linalg.svd(columns, full_matrices=False)
    return np.asarray(left[:, sizes > 1e-9 * max(sizes.max(initial=0.0), scale * math.sqrt(len(columns)))])


def estimate_share(own: Array, values: Array, confidence: float = CONFIDENCE) -> Estimate:
    """Share of the variance of values (n,), of mean 0, that orthonormal columns (n, k) explain, with its interval."""
    from scipy.stats import t

    unexplained, without = _leave_out(own, values)
    margin = _find_deviation(np.log(without)) * float(t.ppf(0.5 + 0.5 * confidence, len(own) - own.shape[1] - 1))
    low, high = unexplained * math.exp(-margin), unexplained * math.exp(margin)
    return Estimate(1.0 - unexplained, max(0.0, 1.0 - high), 1.0 - low)


def _estimate_pair(given: Array, own: Array, values: Array) -> Estimate:
    """Share that columns (n, k) explain beyond those that are ``given`` (n, g)."""
    from scipy.stats import t

    before, each_before = _leave_out(given, values)
    after, each_after = _leave_out(np.hstack([given, own]), values)
    degrees = len(own) - own.shape[1] - given.shape[1] - 1
    margin = _find_deviation(each_before - each_after) * float(t.ppf(0.5 + 0.5 * CONFIDENCE, degrees))
    return Estimate(before - after, max(0.0, before - after - margin), before - after + margin)


def _leave_out(own: Array, values: Array) -> tuple[float, Array]:
    """Share that columns do not explain: variance of the residuals over that of the values; the same without each case.

    A case with the residual e and the leverage h takes e^2 / (1 - h) from the sum of squares.
    """
    n, k = own.shape
    rest = values - own @ (own.T @ values)
    leverage = _find_leverage(own)
    total, left = float(values @ values), float(rest @ rest)
    without = (left - rest**2 / (1.0 - leverage)) / (n - k - 2)
    all_without = (total - values**2 * n / (n - 1)) / (n - 2)
    least = ROUNDING * total / n
    share = max(left / (n - k - 1), least) / (total / (n - 1))
    return share, np.maximum(without, least) / np.maximum(all_without, least)


def _find_deviation(without: Array) -> float:
    """Standard deviation of a statistic by the jackknife, from its values without each case."""
    return math.sqrt((len(without) - 1) * float(without.var()))


def _find_chances(own: Array, rests: Array, given: Array) -> Array:
    """(m,): probability that columns (n, k) explain as much of rests (n, m) that have nothing to do with them.

    The larger of two: of the F test, and of Wald's with the covariance HC3, which outliers and a variance that depends
    on the factor mislead less (J. G. MacKinnon, H. White, J. Econom. 29 (1985) 305-325).  NaN: no test.
    ``given``: columns (n, g) that the rests are free of.
    """
    from scipy.stats import f

    (n, k), outputs = own.shape, rests.shape[1]
    degrees = n - given.shape[1] - k - 1
    if k == 0 or degrees < 2:
        return np.full(outputs, np.nan)
    total, moments = (rests**2).sum(axis=0), own.T @ rests
    total[total == 0.0] = np.nan  # constant: no test
    explained = (moments**2).sum(axis=0)
    ratio = explained / np.maximum(total - explained, ROUNDING * total) * degrees / k
    left = (rests - own @ moments) / (1.0 - _find_leverage(own, given))[:, None]
    products = (own[:, :, None] * own[:, None, :]).reshape(n, -1)
    covariance = (products.T @ left**2).T.reshape(outputs, k, k) + ROUNDING * total[:, None, None] * np.eye(k)
    wald = (moments.T * np.linalg.solve(covariance, moments.T[:, :, None])[:, :, 0]).sum(axis=1)
    return np.asarray(f.sf(np.minimum(ratio, wald / k), k, degrees))


def _find_leverage(*columns: Array) -> Array:
    """(n,), of each case on a fit of a mean and orthonormal columns."""
    return np.minimum(1.0 / len(columns[0]) + sum((own**2).sum(axis=1) for own in columns), 1.0 - 1e-9)


def _find_floor(cases: int, degrees: int, level: float) -> float:
    """The share whose F test has the chance ``level``; NaN: no test."""
    from scipy.stats import f

    rest = cases - degrees - 1
    if degrees == 0 or rest < 2:
        return math.nan
    ratio = float(f.isf(level, degrees, rest)) * degrees / rest
    return 1.0 - (cases - 1) / rest / (1.0 + ratio)


def describe_shape(factor: Factor, draws: Array, values: Array, share: float) -> str:
    """How values (n,) depend on the draws (n,) of a factor that explains a ``share`` of their variance.

    By a cubic between the 5 % and 95 % points of the draws: a turn counts if the curve comes back from it by a tenth of
    its range and by three standard deviations at both ends.  Where the cubic does not show half of the share, the curve
    turns more than twice.  Of texts, and of numbers in a list between which it turns, by the means of the levels.
    """
    levels, which = np.unique(draws, return_inverse=True)
    turns, (unit, scale) = "up and down", factor.shown
    unit = "" if unit == "1" else f" {unit}"
    if factor.levels:
        means = np.bincount(which, values) / np.bincount(which)
        ends = [levels[place] for place in (means.argmin(), means.argmax())]
        if factor.has_texts:
            least, largest = (factor.levels[int(end)] for end in ends)
            return f"least at {least}, largest at {largest}"
        least, largest = (f"{scale * end:.10g}{unit}" for end in ends)
        turns = f"least at {least}, largest at {largest}"
    centre, width = float(draws.mean()), float(draws.std())
    x, degree = (draws - centre) / width, min(4, len(levels))
    low, high = (float(np.quantile(x, level)) for level in (0.05, 0.95))
    columns, at = np.vander(x, degree), np.linspace(low, high, 41)
    found, *_ = np.linalg.lstsq(columns, values, rcond=None)
    rest, shown = values - columns @ found, np.vander(at, degree)
    curve = shown @ found
    spread = np.linalg.inv(columns.T @ columns) * float(rest @ rest) / max(1, len(x) - degree)
    if 1.0 - float(rest.var() / values.var()) < 0.5 * share:
        return turns

    def rises(start: int, end: int) -> bool:
        """Whether the curve is higher at the end than at the start, surely."""
        way = shown[end] - shown[start]
        return float(way @ found) > max(3.0 * math.sqrt(float(way @ spread @ way)), 0.1 * float(np.ptp(curve)))

    least, largest = int(curve.argmin()), int(curve.argmax())
    valley, peak = rises(least, 0) and rises(least, -1), rises(0, largest) and rises(-1, largest)
    if valley == peak:
        return turns if valley else "rising" if curve[-1] > curve[0] else "falling"
    digits = 1 - math.floor(math.log10(scale * width))
    where = f"{round(scale * (centre + float(at[least if valley else largest]) * width), digits):.10g}"
    return f"{'least' if valley else 'largest'} near {where}{unit}"
