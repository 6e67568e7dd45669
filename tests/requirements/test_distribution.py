import numpy as np
import pytest

from ps_fmu.pointing.confidence import effective_samples, find_rank, least_samples
from ps_fmu.requirements import distribution as module
from ps_fmu.requirements.distribution import BINS_PER_DECADE, KEPT, Distribution

RESOLUTION = 10.0 ** (1.0 / BINS_PER_DECADE)


def fill(values, limit, blocks=1):
    found = Distribution(limit, len(values))
    for block in np.array_split(values, blocks):
        found.add(block)
    return found


def test_quantiles_are_rounded_up_by_the_stated_resolution_at_most():
    values = np.abs(np.random.default_rng(1).standard_normal(20_000)) * 1e-7
    found = fill(values, 0.5e-6)
    for probability in (0.001, 0.05, 0.5, 0.95, 0.9973, 0.99999):
        exact = np.quantile(values, probability, method="inverted_cdf")
        assert exact <= found.quantile(probability) <= exact * RESOLUTION * (1.0 + 1e-12)
    assert found.quantile(1.0 - 1e-12) == found.peak == values.max()
    assert found.rms == pytest.approx(np.sqrt(np.mean(values**2)), rel=1e-13)


@pytest.mark.parametrize("limit", [0.5e-6, 1.0 / 3.0, 7.0e9])
def test_rounding_never_crosses_the_limit(limit):
    at, above = limit, np.nextafter(limit, np.inf)
    assert fill(np.array([at, 10.0 * limit]), limit).quantile(0.5) <= limit
    assert fill(np.array([above, 10.0 * limit]), limit).quantile(0.5) > limit


def test_values_far_from_the_limit():
    small, large = 1e-30, 1e30
    assert fill(np.array([0.0, small, large]), 1.0).quantile(0.5) == pytest.approx(1e-6)  # not above a millionth
    assert fill(np.array([0.0, small]), 1.0).quantile(0.99) == small  # the peak
    assert fill(np.array([0.0, large, 2.0 * large]), 1.0).quantile(0.5) == 2.0 * large  # beyond: the peak
    assert fill(np.zeros(5), 1.0).quantile(0.9) == 0.0


def test_blocks_make_no_difference(monkeypatch):
    monkeypatch.setattr(module, "KEPT", 100)
    values = np.abs(np.random.default_rng(2).standard_normal(1234))
    whole, parts = fill(values, 2.0), fill(values, 2.0, blocks=37)
    np.testing.assert_array_equal(whole.counts, parts.counts)
    assert whole.effective_share(1.0) == parts.effective_share(1.0)
    assert whole.rms == pytest.approx(parts.rms, rel=1e-14)


def test_the_number_of_independent_samples_is_that_of_the_library_while_all_are_kept():
    values = np.abs(np.convolve(np.random.default_rng(3).standard_normal(5000), np.ones(20)))
    found = fill(values, 4.0, blocks=3)
    assert found.effective_share(6.0) == effective_samples(values <= 6.0)
    assert found.independent_squares() == pytest.approx(least_samples(values**2), rel=1e-9)


def test_a_share_that_no_value_exceeds_is_judged_by_those_below():
    """As for a quantile of few windows, or of a signal at its stop."""
    values = np.append(np.linspace(0.1, 0.9, 30), np.full(10, 1.0))
    assert fill(values, 2.0).effective_share(1.0) == effective_samples(values < 1.0)
    assert fill(np.ones(30), 2.0).effective_share(1.0) == 1.0


def test_a_long_record_keeps_a_bounded_series_that_is_worth_no_more():
    values = np.abs(np.random.default_rng(4).standard_normal(3 * KEPT + 5))
    found = fill(values, 1.0, blocks=50)
    assert KEPT // 2 < found.effective_share(1.0) <= KEPT


def test_blocks_of_a_long_run_leave_nothing_behind(monkeypatch):
    monkeypatch.setattr(module, "KEPT", 8)
    found = fill(np.random.default_rng(5).random(4000), 1.0, blocks=1000)
    assert len(found._series) == 8


def test_no_line_hides_between_the_values_that_are_kept(monkeypatch):
    """A period of as many samples as lie between two that are kept: each would have the same phase."""
    monkeypatch.setattr(module, "KEPT", 1000)
    values = np.abs(np.sin(2.0 * np.pi * np.arange(8000) / 8.0 + 0.1))
    found = fill(values, 1.0)
    series = np.concatenate(found._series)
    assert len(series) == 1000 and len(np.unique(series.round(9))) == len(np.unique(values.round(9)))


def test_more_values_than_expected_are_counted():
    found = Distribution(1.0, 10)
    found.add(np.full(25, 0.5))
    assert (found.count, found.counts.sum()) == (25, 25)
    assert found.effective_share(0.1) == 1.0


@pytest.mark.parametrize(("count", "share", "rank"), [(100, 0.95, 95), (59, 1.0, 59), (3, 0.0, 1), (20, 0.9973, 20)])
def test_ranks(count, share, rank):
    assert find_rank(count, share) == rank
