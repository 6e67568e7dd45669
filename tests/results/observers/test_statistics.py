"""Mean, RMS, standard deviation, peak, drift."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ps_fmu.pointing.spectra import rejection_percent
from ps_fmu.results.observers.statistics import DriftObserver, Statistics

NAMES = ["a.y", "b.u"]
TIME = np.arange(12_001) * 0.01  # to 120 s


def test_statistics_equal_the_direct_computation(columns, feed):
    values = np.random.default_rng(1).normal(0.3, 2.0, (1000, 4))
    result = feed(Statistics(columns, NAMES), values, 0.1, (1, 10, 512)).result()
    direct = values[:, [1, 2]]
    assert result.names == tuple(NAMES)
    assert result.units == ("rad", "m")
    assert result.count == 1000
    np.testing.assert_allclose(result.mean, direct.mean(axis=0), rtol=1e-13)
    np.testing.assert_allclose(result.std, direct.std(axis=0), rtol=1e-13)
    np.testing.assert_allclose(result.rms, np.sqrt((direct**2).mean(axis=0)), rtol=1e-13)
    np.testing.assert_array_equal(result.peak, np.abs(direct).max(axis=0))


@given(cuts=st.lists(st.integers(1, 499), max_size=12), seed=st.integers(0, 2**32 - 1))
def test_the_cut_into_blocks_does_not_matter(columns, feed, cuts, seed):
    values = np.random.default_rng(seed).normal(1.0, 1.0, (500, 4))
    whole = feed(Statistics(columns, NAMES), values, 0.1).result()
    parts = feed(Statistics(columns, NAMES), values, 0.1, cuts).result()
    assert parts.count == whole.count
    for field in ("mean", "rms", "std", "peak"):
        np.testing.assert_allclose(getattr(parts, field), getattr(whole, field), rtol=1e-13)


def test_jitter_under_a_large_offset_is_not_lost(columns, feed):
    """A nanoradian on a radian: a plain sum of squares leaves nothing of it."""
    time = np.arange(100_000)
    jitter = 1e-9 * np.where(time % 2, 1.0, -1.0)
    values = np.tile(1.0 + jitter, (4, 1)).T
    result = feed(Statistics(columns, ["a.x"]), values, 1e-4, range(0, 100_000, 777)).result()
    np.testing.assert_allclose(result.std, 1e-9, rtol=1e-6)
    plain = np.sqrt(max((values[:, 0] ** 2).mean() - values[:, 0].mean() ** 2, 0.0))
    assert abs(plain - 1e-9) > 1e-10


def test_no_rows_is_an_error(columns):
    with pytest.raises(ValueError, match="no rows"):
        Statistics(columns, NAMES).result()


def test_rejection_is_the_share_of_the_rms_that_is_gone():
    percent = rejection_percent([2.0, 1.0, 1.0], [0.02, 1.0, 1.5])
    np.testing.assert_allclose(percent, [99.0, 0.0, -50.0], rtol=1e-14)


def test_rejection_of_a_quiet_axis_is_undefined():
    assert np.isnan(rejection_percent([0.0], [0.0])).all()


@pytest.mark.parametrize(("passive", "active"), [([1.0, 2.0], [1.0]), ([-1.0], [1.0]), ([1.0], [-1.0])])
def test_impossible_rms_is_refused(passive, active):
    with pytest.raises(ValueError, match=r"RMS|shape"):
        rejection_percent(passive, active)


@pytest.fixture
def drift(columns, feed):
    """The drift from 20 to 120 s of two signals, the second one first."""

    def observe(a, b, block=1000):
        values = np.column_stack(np.broadcast_arrays(a, b, TIME, TIME))
        observer = DriftObserver(columns, ["a.y", "a.x"], start_s=20.0, end_s=120.0)
        return feed(observer, values, 0.01, range(block, len(TIME), block)).result()

    return observe


def test_a_steady_change_is_found_and_an_offset_is_not(drift):
    """1e-6 per s: the middles of the halves are 50 s apart."""
    np.testing.assert_allclose(drift(1e-6 * TIME, 3.0), [0.0, 5e-5], atol=1e-12)


@pytest.mark.parametrize("frequency", [0.1, 0.105, 0.25, 5.0])
@pytest.mark.parametrize("phase", [0.0, 1.0, 2.0])
def test_lines_of_the_noise_hardly_count(drift, frequency, phase):
    """Five cycles in a half: each half keeps 1/(5 pi 24) of the amplitude at most; plain means keep 1/(5 pi)."""
    line = np.sin(2.0 * np.pi * frequency * TIME + phase)
    assert abs(drift(line, 0.0)[1]) < 2.0 / (np.pi * 5.0 * 24.0)


def test_rows_outside_the_window_and_the_cut_into_blocks_do_not_matter(drift):
    signal = np.random.default_rng(3).normal(size=len(TIME))
    disturbed = np.where(TIME <= 20.0, 1e3, signal)
    np.testing.assert_allclose(drift(disturbed, 0.0, block=77), drift(signal, 0.0), rtol=1e-9, atol=1e-15)


def test_without_rows_in_both_halves_it_is_not_known(columns):
    observer = DriftObserver(columns, ["a.x"], start_s=0.0, end_s=100.0)
    observer.block(0, TIME[:100], np.zeros((100, 4)))
    assert np.isnan(observer.result()).all()
    with pytest.raises(ValueError, match="window: expected an end after its start"):
        DriftObserver(columns, ["a.x"], start_s=1.0, end_s=1.0)
