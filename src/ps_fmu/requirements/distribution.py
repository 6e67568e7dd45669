"""The magnitudes of an index over a run, in bounded memory: a histogram of all, and a thinned series of some.

The histogram counts every value.  Its bins have a ratio of 10^(1/2000) between their ends, from a millionth to a
million times the limit, and the limit is the end of one: quantiles are rounded up by 0.12 % at most, and never across
the limit.  Peak and mean square are exact.

How many independent samples the values are worth follows from their order in time.  Of that a series of at most 65536
values is kept, one from each of as many equal parts of the run, at a random place in it, so that no line hides between
them.  More values are worth no less: the number is from below.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..pointing.confidence import SEEN_AT, Statement, Worth, find_kurtosis, find_rank, state_rms, weigh_share
from ..reduction.moments import LogarithmicBins, Totals
from ..results.observers.observer import State, check_array

Array = NDArray[np.float64]

BINS_PER_DECADE = 2000
DECADES = 6  # on either side of the limit
KEPT = 2**16

_IN_LIMITS = LogarithmicBins(-DECADES, DECADES, BINS_PER_DECADE)
BINS = len(_IN_LIMITS.edges)
"""Of the histogram; the last holds all that is beyond."""
_SEED = 20081115


class Distribution:
    """Values are added in the order of time.

    Parameters
    ----------
    limit: in the unit of the values.
    expected: how many values there will be; more are counted, but not kept in the series.
    kept: how many of them the series keeps at most, by default :data:`KEPT`.
    """

    def __init__(self, limit: float, expected: int, kept: int | None = None) -> None:
        self.limit = limit
        self.count = 0
        self.counts: NDArray[np.int64] = np.zeros(BINS, dtype=np.int64)
        """Values in each bin."""
        self._totals = Totals()
        self._chosen = _choose_places(expected, kept or KEPT)
        self._series: list[Array] = []
        self._worth: dict[tuple[int, float], Worth] = {}
        self._up_to: tuple[int, NDArray[np.int64]] = 0, self.counts
        """How many values there were, and values up to each bin."""

    def add(self, values: Array) -> None:
        """Add values (n,), finite; their magnitudes count."""
        if not len(values):
            return
        first, last = np.searchsorted(self._chosen, (self.count, self.count + len(values)))
        if last > first:  # in most blocks of a long run none is kept
            self._series.append(np.abs(values[self._chosen[first:last] - self.count]) / self.limit)
        self.count += len(values)
        _IN_LIMITS.add(values, self.limit, self.counts, self._totals)

    @property
    def mean(self) -> float:
        """Mean of all values, with their signs."""
        return self._totals.sum / self.count

    @property
    def peak(self) -> float:
        """Largest magnitude; 0 without values."""
        return self._totals.peak

    def save_state(self) -> dict[str, Any]:
        """What a checkpoint keeps: the bins that are filled, not all of them."""
        bins, totals = np.flatnonzero(self.counts != 0), self._totals  # a quarter of the time that the counts take
        return {
            "count": self.count, "sum": totals.sum, "squares": totals.squares, "peak": totals.peak,
            "bins": bins, "counts": self.counts[bins], "series": np.concatenate([np.zeros(0), *self._series]),
        }  # fmt: skip

    def load_state(self, state: State) -> None:
        """Go on from a state of :meth:`save_state`.  Raises KeyError or ValueError for one that is none."""
        bins, counts = (check_array(name, state[name], self.counts, grows=True) for name in ("bins", "counts"))
        if len(bins) != len(counts) or (len(bins) and not 0 <= bins.min() <= bins.max() < BINS):
            raise ValueError(f"bins: expected numbers from 0 to {BINS - 1}")
        series = check_array("series", state["series"], np.zeros(0), grows=True)
        self.count = int(state["count"])
        self._totals = Totals(*(float(state[name]) for name in ("sum", "squares", "peak")))
        self.counts[:] = 0
        self.counts[bins] = counts
        self._series = [series] if len(series) else []

    @property
    def rms(self) -> float:
        """Root of the mean square of all values."""
        return self.limit * math.sqrt(self._totals.squares / self.count)

    @property
    def kurtosis(self) -> float:
        """Of the series of some values, see :func:`.find_kurtosis`."""
        return find_kurtosis(np.concatenate(self._series))

    @property
    def is_constant(self) -> bool:
        """All values are one."""
        return math.isclose(self.rms, self.peak, rel_tol=1e-12)

    @property
    def identity(self) -> tuple[int, float, float]:
        """What two different runs do not have in common."""
        return self.count, self.peak, self._totals.squares

    def value(self, rank: int) -> float:
        """The value of a rank, from 1, among all in ascending order, rounded up to the edge of its bin."""
        if self._up_to[0] != self.count:
            self._up_to = self.count, np.cumsum(self.counts)
        place = np.searchsorted(self._up_to[1], rank)
        return float(_find_edges(self.limit, self.peak, np.atleast_1d(place))[0])

    def quantile(self, probability: float) -> float:
        """The value below which, or at which, a share of all values lies."""
        return self.value(find_rank(self.count, probability))

    def weigh_share(self, probability: float) -> Worth:
        """What the values are worth for their quantile, see :func:`.weigh_share`.  To find it takes 3 ms."""
        key = self.count, min(probability, SEEN_AT)
        if key not in self._worth:
            self._worth[key] = weigh_share(np.concatenate(self._series), probability)
        return self._worth[key]

    def state_rms(self, confidence: float) -> Statement:
        """RMS of all values with its bound, see :func:`.state_rms`."""
        sizes = np.concatenate(self._series)
        return state_rms(self.rms, (sizes * self.limit) ** 2, confidence, sizes)


@lru_cache(maxsize=8)
def _choose_places(expected: int, kept: int) -> NDArray[np.int64]:
    """Which of the values a series keeps.  Signals of one run ask for the same: it takes 50 us."""
    width = -(-expected // kept)
    chosen = np.arange(-(-expected // width)) * width
    if width > 1:
        chosen += np.random.default_rng(_SEED).integers(width, size=len(chosen))
    chosen.flags.writeable = False
    return chosen


def list_edges(limit: float, peak: float) -> Array:
    """Upper edges (bins,) of the histogram; none is above the largest value."""
    return _find_edges(limit, peak, np.arange(BINS))


def _find_edges(limit: float, peak: float, places: NDArray[np.intp]) -> Array:
    """Of some bins, by their places."""
    return np.asarray(np.minimum(limit * _IN_LIMITS.edges[places], peak))
