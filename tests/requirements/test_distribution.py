"""The distribution of a run, and those of many runs as one: groups of runs are as good as runs."""

import base64
import zlib

import numpy as np
import pytest
from support.claims import verify_claim

from ps_fmu.pointing.confidence import find_rank, state_rms, weigh_share
from ps_fmu.requirements import decision
from ps_fmu.requirements import distribution as module
from ps_fmu.requirements.decision import Pool, pack_distribution, state_of_counts
from ps_fmu.requirements.distribution import BINS_PER_DECADE, KEPT, Distribution, list_edges

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
    assert whole.weigh_share(0.5) == parts.weigh_share(0.5)
    assert whole.rms == pytest.approx(parts.rms, rel=1e-14)


def test_the_number_of_independent_samples_is_that_of_the_library_while_all_are_kept():
    values = np.abs(np.convolve(np.random.default_rng(3).standard_normal(5000), np.ones(20)))
    found = fill(values, 4.0, blocks=3)
    for probability in (0.5, 0.95, 0.9973):
        assert found.weigh_share(probability) == weigh_share(values / 4.0, probability)
    stated, expected = found.state_rms(0.9), state_rms(found.rms, values**2, 0.9)
    assert stated.bound == pytest.approx(expected.bound, rel=1e-9)


def test_a_share_that_no_value_exceeds_is_judged_by_those_below():
    """As for a quantile of few windows, or of a signal at its stop."""
    below = np.append(np.linspace(0.1, 0.9, 30), np.full(10, 1.0))
    shuffled = np.random.default_rng(6).permutation(below)
    assert 10.0 < fill(shuffled, 2.0).weigh_share(0.9).independent <= 40.0
    assert fill(np.ones(30), 2.0).weigh_share(0.9).independent == 1.0


def test_a_long_record_keeps_a_bounded_series_that_is_worth_no_more():
    values = np.abs(np.random.default_rng(4).standard_normal(3 * KEPT + 5))
    found = fill(values, 1.0, blocks=50)
    assert KEPT // 2 < found.weigh_share(0.7).independent <= KEPT


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
    assert found.weigh_share(0.5).independent == 1.0


@pytest.mark.parametrize(("count", "share", "rank"), [(100, 0.95, 95), (59, 1.0, 59), (3, 0.0, 1), (20, 0.9973, 20)])
def test_ranks(count, share, rank):
    assert find_rank(count, share) == rank


LIMIT = 2e-6


def make_runs(count, spread=0.3, samples=2000, seed=0):
    """Distributions of runs, each with a level of its own, and all of their values (runs, samples)."""
    rng = np.random.default_rng(seed)
    values = 1e-6 * rng.lognormal(0.0, spread, (count, 1)) * np.abs(rng.standard_normal((count, samples)))
    found = []
    for run in values:
        found.append(Distribution(LIMIT, samples))
        found[-1].add(run)
    return found, values


def pool(texts, limit):
    found = Pool(limit, len(texts))
    for text in texts:
        found.add(text)
    return found


@pytest.mark.parametrize("probability", [0.001, 0.5, 0.95, 0.9973])
def test_the_quantile_is_that_of_all_values_rounded_up_to_a_bin(probability):
    found, values = make_runs(30)
    stated = pool([pack_distribution(run) for run in found], LIMIT).state(probability, 0.9)
    exact = np.quantile(values, probability, method="inverted_cdf")
    assert exact <= stated.value
    verify_claim(
        "study.pooled_quantile",
        claim="Quantile over all times of all cases or runs, from their histograms",
        where="`ps-fmu sweep`, `judge`: mixed requirements",
        reference="ranked values of 30 pooled records",
        error=stated.value / exact - 1.0,
        bound=0.0012,
    )
    assert stated.lower < stated.value < stated.bound <= stated.upper


def test_what_is_packed_is_what_was_counted():
    found, _ = make_runs(7)
    edges = list_edges(LIMIT, max(run.peak for run in found))
    plain = state_of_counts(np.array([run.counts for run in found]), edges, 0.95, 0.9)
    assert pool([pack_distribution(run) for run in found], LIMIT).state(0.95, 0.9) == plain


def test_the_unit_is_that_of_the_limit():
    found, _ = make_runs(6)
    texts = [pack_distribution(run) for run in found]
    in_rad, in_urad = pool(texts, LIMIT).state(0.95, 0.9), pool(texts, 2.0).state(0.95, 0.9)
    assert in_urad.value == pytest.approx(1e6 * in_rad.value, rel=1e-12)
    assert in_urad.bound == pytest.approx(1e6 * in_rad.bound, rel=1e-12)


def test_bounds_of_groups_of_runs_hold_as_often_as_those_of_runs(monkeypatch):
    """40 runs in 20 groups; the true quantile is that of many runs."""
    monkeypatch.setattr(decision, "MOST_GROUPS", 20)
    truth = np.quantile(make_runs(5_000, samples=200, seed=99)[1], 0.9)
    held = 0
    for seed in range(60):
        texts = [pack_distribution(run) for run in make_runs(40, samples=200, seed=seed)[0]]
        stated = pool(texts, LIMIT).state(0.9, 0.9)
        held += stated.bound >= truth
    assert held >= 50  # 54 expected


def test_four_runs_have_no_bound():
    found, _ = make_runs(4)
    stated = pool([pack_distribution(run) for run in found], LIMIT).state(0.95, 0.9)
    assert stated.bound == np.inf
    assert np.isfinite(stated.value)


def test_memory_does_not_grow_with_the_runs():
    assert Pool(LIMIT, 10**6)._groups.shape == Pool(LIMIT, 10**4)._groups.shape


@pytest.mark.parametrize(
    "damage",
    [
        lambda text: text[:-8],
        lambda text: "no histogram",
        lambda text: base64.b64encode(zlib.compress(b"\0" * 40)[:-3]).decode(),
        lambda text: base64.b64encode(zlib.compress(b"\0" * 8 + b"\x02\0\0\0" + b"\0" * 20)).decode(),
    ],
)
def test_a_damaged_histogram_is_refused(damage):
    (run,), _ = make_runs(1)
    with pytest.raises(ValueError, match="a histogram of a run is damaged"):
        Pool(LIMIT, 1).add(damage(pack_distribution(run)))
