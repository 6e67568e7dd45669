"""Values are counted in the bins that their edges say."""

import numpy as np
import pytest

from ps_fmu.reduction.histogram import LogarithmicBins, Totals

BINS = LogarithmicBins(-3, 2, 2000)


def add(values, unit=1.0):
    counts, totals = np.zeros(len(BINS.edges), dtype=np.int64), Totals()
    BINS.add(values, unit, counts, totals)
    return counts, totals


def test_edges_and_numbers_beside_them():
    edges = BINS.edges[:-1]
    beside = [np.nextafter(edges, 0.0), edges, np.nextafter(edges, np.inf)]
    rest = 10.0 ** np.random.default_rng(2).uniform(-9.0, 5.0, 20_000)
    values = np.concatenate([*beside, -rest, [0.0, 5e-324, -1e100]])
    counts, totals = add(values)
    places = np.searchsorted(BINS.edges, np.abs(values))
    np.testing.assert_array_equal(counts, np.bincount(places, minlength=len(counts)))
    assert totals.peak == 1e100
    assert totals.sum == pytest.approx(values.sum(), rel=1e-13)
    assert totals.squares == pytest.approx(values @ values, rel=1e-13)


@pytest.mark.parametrize("count", [0, 1, 7, 8, 511, 513, 1500])
def test_totals_are_those_of_all_values(count):
    values = np.random.default_rng(count).standard_normal(count)
    counts, totals = add(values, 0.5)
    assert counts.sum() == count
    assert totals.sum == pytest.approx(values.sum(), abs=1e-12)
    assert totals.squares == pytest.approx(4.0 * values @ values)
    assert totals.peak == np.abs(values).max(initial=0.0)


def test_a_magnitude_lies_below_the_edge_of_its_bin_or_on_it():
    for value in (0.0, 1e-3, 0.5, 1.0, 99.9, 100.0, 101.0):
        counts, _ = add(np.array([-3.0 * value]), 3.0)
        (place,) = np.flatnonzero(counts)
        assert value <= BINS.edges[place] and (place == 0 or value > BINS.edges[place - 1])


def test_counts_of_another_shape_are_refused():
    with pytest.raises(ValueError, match="counts: expected 10002 contiguous int64"):
        BINS.add(np.ones(3), 1.0, np.zeros(7, dtype=np.int64), Totals())
