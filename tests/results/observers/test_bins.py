"""Extremes and means in time bins."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.claims import verify_claim

from ps_fmu.results.observers.bins import EnvelopeObserver, MeanObserver

NAMES = ["a.x", "b.v"]


@given(
    cuts=st.lists(st.integers(1, 999), max_size=10),
    rows=st.integers(1, 1000),
    bins=st.integers(1, 40),
    seed=st.integers(0, 2**32 - 1),
)
def test_bins_equal_the_direct_computation_for_any_cut(columns, feed, cuts, rows, bins, seed):
    values = np.random.default_rng(seed).normal(0.0, 1.0, (rows, 4))
    envelope = feed(EnvelopeObserver(columns, NAMES, bins=bins), values, 0.1, cuts).result()
    means = feed(MeanObserver(columns, NAMES, bins=bins), values, 0.1, cuts).result()
    width = 1
    while rows > 2 * bins * width:
        width *= 2
    starts = np.arange(0, rows, width)
    for time in (envelope.time, means.time):
        assert len(time) <= 2 * bins
        np.testing.assert_allclose(time, starts * 0.1, rtol=1e-12)
    ends = [one.reduceat(values[:, [0, 3]], starts).T for one in (np.minimum, np.maximum)]
    verify_claim(
        "spectrum.envelope",
        claim="Curves over time: least and largest value of each stretch, no peak lost",
        where="report of `ps-fmu run`: charts over time, PNG files",
        reference="least and largest of the rows, for runs and stretches of any length",
        error=np.abs(np.array([envelope.low, envelope.high]) - ends),
        bound=0.0,
        unit="of the signal",
    )
    expected = [values[start : start + width, [0, 3]].mean(axis=0) for start in starts]
    np.testing.assert_allclose(means.values.T, expected, rtol=1e-12, atol=1e-14)
    np.testing.assert_array_equal(means.of(["b.v", "a.x"]), means.values[::-1].T)


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


def test_what_is_faster_than_a_bin_is_averaged_away(columns, feed):
    """Taking single rows instead would fold it down to a slow motion."""
    values = np.zeros((80_000, 4))
    values[:, 0] = np.sin(2.0 * np.pi * np.arange(80_000) / 15.9)
    result = feed(MeanObserver(columns, NAMES, bins=500), values, 1e-4).result()
    assert np.abs(result.values[0]).max() < 0.12


@pytest.mark.parametrize("observer", [EnvelopeObserver, MeanObserver])
def test_nothing_seen_and_no_bins_are_errors(columns, observer):
    with pytest.raises(ValueError, match="no rows"):
        observer(columns, NAMES).result()
    with pytest.raises(ValueError, match="bins: expected 1 or more, got 0"):
        observer(columns, NAMES, bins=0)
