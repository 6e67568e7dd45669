"""Statistics of signals against numpy: sums, extremes, bins and their counts, a Hann window, a polygon."""

import numpy as np
import pytest

from ps_fmu.reduction.moments import LogarithmicBins, Totals, find_moments, weigh_hann, widen_bins

SAMPLES = 1e6 + np.random.default_rng(8).standard_normal((3, 700))


@pytest.mark.parametrize("count", [1, 2, 31, 32, 33, 699])
def test_moments_under_a_large_mean(count):
    expected = SAMPLES[:, 1 : 1 + count].astype(np.longdouble)
    mean = expected.mean(axis=1)
    squares = np.square(expected - mean[:, None]).sum(axis=1)
    for laid in (SAMPLES[:, 1 : 1 + count], np.asfortranarray(SAMPLES[:, 1 : 1 + count])):
        found = find_moments(laid)
        np.testing.assert_allclose(found[:, 0], mean.astype(float), rtol=1e-15)
        np.testing.assert_allclose(found[:, 1], squares.astype(float), rtol=1e-9, atol=1e-9)
        np.testing.assert_array_equal(found[:, 2], np.abs(laid).max(axis=1))


@pytest.mark.parametrize("width", [1, 2, 3, 8, 16, 100, 512, 1024])
@pytest.mark.parametrize("bins", [0, 1, 3, 70])
def test_bins_are_widened_to_their_extremes(bins, width):
    rng = np.random.default_rng(width)
    samples, room = rng.standard_normal((2, bins * width)), rng.standard_normal((2, 2, bins + 4)) * 3.0
    low, high = room[:, :, 2 : 2 + bins]
    parts, before = samples.reshape(2, bins, width), room.copy()
    expected = np.minimum(parts.min(axis=2), low), np.maximum(parts.max(axis=2), high)
    widen_bins(np.asfortranarray(samples), width, low, high)
    np.testing.assert_array_equal((low, high), expected)
    np.testing.assert_array_equal(room[:, :, [0, 1, -2, -1]], before[:, :, [0, 1, -2, -1]])


@pytest.mark.parametrize("shape", [(0, 4), (2, 0), (0, 0)])
def test_no_bins_are_widened(shape):
    low, high = np.empty(shape), np.empty(shape)
    widen_bins(np.empty((shape[0], 8 * shape[1])), 8, low, high)
    assert low.shape == high.shape == shape


def test_bins_that_do_not_fit_are_refused():
    low, high = np.zeros((2, 4)), np.zeros((2, 4))
    for samples, width in ((np.ones((2, 9)), 2), (np.ones((3, 8)), 2), (np.ones((2, 8)), 4)):
        with pytest.raises(ValueError, match="contiguous bins"):
            widen_bins(samples, width, low, high)
    with pytest.raises(ValueError, match="contiguous bins"):
        widen_bins(np.ones((2, 8)), 2, low, np.zeros((4, 2)).T)


def test_the_peak_is_a_magnitude():
    for place in (0, 1, 40, 44):
        samples = np.ones((1, 45))
        samples[0, place] = -3.0
        assert find_moments(samples)[0, 2] == 3.0
    with pytest.raises(ValueError, match="samples: expected one at least"):
        find_moments(np.empty((2, 0)))


@pytest.mark.parametrize("count", [0, 1, 7, 700])
def test_weights_of_a_hann_window(count):
    phases = np.random.default_rng(count).uniform(-1.0, 2.0, count)
    np.testing.assert_allclose(weigh_hann(phases), 1.0 - np.cos(2.0 * np.pi * phases), rtol=0.0, atol=2e-15)
    np.testing.assert_allclose(weigh_hann(phases[::2]), weigh_hann(phases)[::2], rtol=0.0, atol=0.0)


def test_a_hann_window_is_zero_between_the_halves():
    np.testing.assert_allclose(weigh_hann(np.array([0.0, 0.25, 0.5, 1.0, 1.5, 2.0])), [0, 1, 2, 0, 2, 0], atol=1e-15)


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
