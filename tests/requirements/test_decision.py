"""Histograms of many runs as one: what is packed is what was counted, and groups of runs are as good as runs."""

import base64
import zlib

import numpy as np
import pytest

from ps_fmu.requirements import decision
from ps_fmu.requirements.decision import Pool, pack_distribution, state_of_counts
from ps_fmu.requirements.distribution import Distribution, list_edges

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
    assert exact <= stated.value <= exact * 10.0 ** (1.0 / 2000.0) * (1.0 + 1e-12)
    assert stated.lower < stated.value < stated.bound < stated.upper
    assert stated.independent == 30


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
    truth = np.quantile(make_runs(20_000, samples=200, seed=99)[1], 0.9)
    held = 0
    for seed in range(60):
        texts = [pack_distribution(run) for run in make_runs(40, samples=200, seed=seed)[0]]
        stated = pool(texts, LIMIT).state(0.9, 0.9)
        held += stated.bound >= truth
    assert 0.9 - 3.0 * np.sqrt(0.09 / 60) <= held / 60 <= 0.9 + 3.0 * np.sqrt(0.09 / 60)


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
