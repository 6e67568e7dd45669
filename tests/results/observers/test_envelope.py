import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ps_fmu.results.observers.envelope import EnvelopeObserver

NAMES = ["a.x", "b.v"]


@given(
    cuts=st.lists(st.integers(1, 999), max_size=10),
    rows=st.integers(1, 1000),
    bins=st.integers(1, 40),
    seed=st.integers(0, 2**32 - 1),
)
def test_envelope_equals_the_direct_computation_for_any_cut(columns, feed, cuts, rows, bins, seed):
    values = np.random.default_rng(seed).normal(0.0, 1.0, (rows, 4))
    result = feed(EnvelopeObserver(columns, NAMES, bins=bins), values, 0.1, cuts).result()
    width = 1
    while rows > 2 * bins * width:
        width *= 2
    starts = np.arange(0, rows, width)
    assert len(result.time) <= 2 * bins
    np.testing.assert_allclose(result.time, starts * 0.1, rtol=1e-12)
    np.testing.assert_array_equal(result.low, np.minimum.reduceat(values[:, [0, 3]], starts).T)
    np.testing.assert_array_equal(result.high, np.maximum.reduceat(values[:, [0, 3]], starts).T)


@given(rows=st.integers(1, 2000), most=st.integers(1, 12), seed=st.integers(0, 2**32 - 1))
def test_a_coarsened_envelope_is_that_of_fewer_bins(columns, feed, rows, most, seed):
    """Figures are drawn from the envelope that is kept for the report, and look as if it had been kept for them."""
    values = np.random.default_rng(seed).normal(0.0, 1.0, (rows, 4))
    fine = feed(EnvelopeObserver(columns, NAMES, bins=8 * most), values, 0.1).result().coarsen(2 * most)
    coarse = feed(EnvelopeObserver(columns, NAMES, bins=most), values, 0.1).result()
    for name in ("time", "low", "high"):
        np.testing.assert_array_equal(getattr(fine, name), getattr(coarse, name))
    assert (fine.names, fine.units) == (coarse.names, coarse.units)


def test_one_peak_in_a_long_run_survives(columns, feed):
    values = np.zeros((100_000, 4))
    values[77_777, 0] = -5.0
    result = feed(EnvelopeObserver(columns, NAMES), values, 1e-4, range(0, 100_000, 4096)).result()
    assert result.low[0].min() == -5.0
    assert result.magnitude[0].max() == 5.0
    assert result.middle[0].min() == -2.5


def test_nothing_seen_is_an_error(columns):
    with pytest.raises(ValueError, match="no rows"):
        EnvelopeObserver(columns, NAMES).result()
    with pytest.raises(ValueError, match="bins"):
        EnvelopeObserver(columns, NAMES, bins=0)
