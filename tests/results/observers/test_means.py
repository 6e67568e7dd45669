import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ps_fmu.results.observers.means import MeanObserver

NAMES = ["a.x", "b.v"]


@given(
    cuts=st.lists(st.integers(1, 999), max_size=10),
    rows=st.integers(1, 1000),
    bins=st.integers(1, 40),
    seed=st.integers(0, 2**32 - 1),
)
def test_means_equal_the_direct_computation_for_any_cut(columns, feed, cuts, rows, bins, seed):
    values = np.random.default_rng(seed).normal(0.0, 1.0, (rows, 4))
    result = feed(MeanObserver(columns, NAMES, bins=bins), values, 0.1, cuts).result()
    width = 1
    while rows > 2 * bins * width:
        width *= 2
    starts = np.arange(0, rows, width)
    expected = [values[start : start + width, [0, 3]].mean(axis=0) for start in starts]
    np.testing.assert_allclose(result.time, starts * 0.1, rtol=1e-12)
    np.testing.assert_allclose(result.values.T, expected, rtol=1e-12, atol=1e-14)
    np.testing.assert_array_equal(result.of(["b.v", "a.x"]), result.values[::-1].T)


def test_what_is_faster_than_a_bin_is_averaged_away(columns, feed):
    """Taking single rows instead would fold it down to a slow motion."""
    values = np.zeros((80_000, 4))
    values[:, 0] = np.sin(2.0 * np.pi * np.arange(80_000) / 15.9)
    result = feed(MeanObserver(columns, NAMES, bins=500), values, 1e-4).result()
    assert np.abs(result.values[0]).max() < 0.12


def test_nothing_seen_is_an_error(columns):
    with pytest.raises(ValueError, match="no rows"):
        MeanObserver(columns, NAMES).result()


def test_there_is_a_bin_at_least(columns):
    with pytest.raises(ValueError, match="bins: expected 1 or more, got 0"):
        MeanObserver(columns, NAMES, bins=0)
