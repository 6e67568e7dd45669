"""Quantiles and variances with their confidence: ranks, coverage, effective numbers, interpretations."""

import math

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.special import bdtr, bdtrik
from scipy.stats import norm

from ps_fmu.pointing import (
    AbsoluteError,
    Interpretation,
    LinearProcess,
    RelativeError,
    effective_samples,
    gaussian_rms,
    quantile,
    quantile_of_runs,
    samples_needed,
    weigh_record,
    windows_rms,
)
from ps_fmu.pointing.confidence import bounding_rank, weigh_share


@pytest.mark.parametrize(
    ("probability", "confidence", "count"), [(0.95, 0.95, 59), (0.9973, 0.9, 852), (0.5, 0.5, 1), (0.9, 0.9, 22)]
)
def test_cases_whose_largest_bounds_a_quantile(probability, confidence, count):
    assert samples_needed(probability, confidence) == count
    assert 1.0 - probability**count >= confidence
    assert bounding_rank(count, probability, confidence) == count
    if count > 1:
        assert 1.0 - probability ** (count - 1) < confidence
        assert bounding_rank(count - 1, probability, confidence) is None


@pytest.mark.parametrize("probability", [1e-9, 0.0027, 0.05, 0.5, 0.6827, 0.95, 0.9973, 1.0 - 1e-9])
@pytest.mark.parametrize("confidence", [1e-6, 0.05, 0.5, 0.95, 0.975, 1.0 - 1e-9])
def test_ranks_by_the_binomial_distribution_of_scipy(probability, confidence):
    level = confidence * (1.0 - 1e-12)
    for count in (0, 1, 2, 3, 59, 100, 1000, 65_536, 10**7):
        below = int(bdtrik(level, count, probability)) if count else 0
        below = next(k for k in range(max(below - 2, 0), below + 4) if bdtr(k, count, probability) >= level)
        assert bounding_rank(count, probability, confidence) == (below + 1 if below < count else None)


def test_published_ranks_of_95_95():
    """The second largest of 93 and the third largest of 124 bound it, and of no smaller numbers (Wilks)."""
    assert [bounding_rank(count, 0.95, 0.95) for count in (92, 93, 123, 124)] == [92, 92, 122, 122]


def test_bounds_hold_as_often_as_they_say():
    """Of 2000 samples of 100; the binomial scatter of that is 0.5 % at 95 %."""
    draws = np.random.default_rng(1).normal(size=(2000, 100))
    true = norm.ppf(0.8)
    stated = [quantile(draw, 0.8, 0.95) for draw in draws]
    assert 0.94 < np.mean([one.bound >= true for one in stated]) < 0.985
    assert 0.94 < np.mean([one.lower <= true <= one.upper for one in stated]) < 0.985


def test_a_quantile_without_enough_cases_has_no_bound():
    few, enough = (quantile(np.arange(1.0, count + 1.0), 0.95, 0.95) for count in (58, 59))
    assert few.bound == math.inf and enough.bound == 59.0
    assert enough.upper == math.inf  # two-sided: 97.5 %, which takes 72
    assert enough.value == 57.0 and enough.lower == 52.0
    assert "no bound with 95 % confidence" in str(few)
    assert "57 (95 % quantile), below 59 with 95 % confidence, 59 independent samples" in str(enough)
    assert quantile(np.arange(3.0), 0.1, 0.95).lower == -math.inf


def test_correlated_values_count_less():
    values = np.arange(1000.0)
    free, bound = quantile(values, 0.9, 0.95), quantile(values, 0.9, 0.95, independent=100.0)
    assert free.value == bound.value
    assert bound.lower < free.lower < free.upper < bound.upper
    assert bound.bound == quantile(np.arange(9.0, 1000.0, 10.0), 0.9, 0.95).bound  # every tenth
    with pytest.raises(ValueError, match="independent: expected above 0 and at most 1000"):
        quantile(values, 0.9, 0.95, independent=2000.0)


@pytest.mark.parametrize("rho", [0.0, 0.9, 0.99])
def test_effective_number_of_first_order_noise(rho):
    """n (1 - rho) / (1 + rho) for the mean; rho^2 in place of rho for the variance.  The median of 15 records."""
    n = 50_000
    draws = np.random.default_rng(2).normal(size=(15, n + 2000))
    records = lfilter([1.0], [1.0, -rho], draws, axis=1)[:, 2000:]
    of_mean = np.median([effective_samples(record) for record in records])
    of_variance = np.median([effective_samples(record**2) for record in records])
    assert of_mean == pytest.approx(n * (1.0 - rho) / (1.0 + rho), rel=0.1)
    assert of_variance == pytest.approx(n * (1.0 - rho**2) / (1.0 + rho**2), rel=0.1)


def test_effective_number_of_what_does_not_vary():
    assert effective_samples(np.full(100, 3.0)) == 1.0
    assert effective_samples([1.0]) == 1.0
    assert 1.0 <= effective_samples(np.arange(100.0)) < 10.0


def test_rms_of_a_correlated_record_within_its_interval():
    rho, hits = 0.9, 0
    for seed in range(100):
        record = lfilter([math.sqrt(1.0 - rho**2)], [1.0, -rho], np.random.default_rng(seed).normal(size=6000))[1000:]
        stated = gaussian_rms(float(np.sqrt(np.mean(record**2))), effective_samples(record**2), 0.9)
        assert stated.lower < stated.value < stated.bound < stated.upper
        hits += stated.lower <= 1.0 <= stated.upper
    assert 80 <= hits <= 98  # 90 expected, 3 standard deviations


@pytest.mark.parametrize(
    "index",
    [AbsoluteError(), RelativeError(0.1, "uniform"), RelativeError(1.0, "uniform")],
    ids=["APE", "RPE 0.1 s", "RPE 1 s"],
)
def test_rms_of_a_resonance_within_its_interval(index):
    """Noise of a resonance at 1 Hz, damping 2 %: its squares are correlated over 4 s, and a record has 60 s."""
    step, turn = 0.01, 2.0 * np.pi * 0.01
    radius = math.exp(-0.02 * turn)
    a = [1.0, -2.0 * radius * math.cos(turn), radius**2]
    process = LinearProcess(np.array([[-a[1], -a[2]], [1.0, 0.0]]), np.eye(1, 2), np.diag([1.0, 0.0]), step)
    draws = np.random.default_rng(4).normal(size=(100, 9000))
    records = lfilter([1.0], a, draws, axis=1)[:, 3000:]
    stated = [windows_rms(index.values(record, step), 0.9) for record in records]
    expected = math.sqrt(process.variance(index)[0])
    assert sum(one.lower <= expected <= one.upper for one in stated) >= 87
    assert sum(expected <= one.bound for one in stated) >= 87


def test_rms_of_five_windows_within_its_interval():
    """Five independent values: their squares vary too little where no large one is among them."""
    draws = np.random.default_rng(5).normal(size=(300, 5))
    stated = [windows_rms(values, 0.9) for values in draws]
    assert sum(one.lower <= 1.0 <= one.upper for one in stated) >= 261


def test_a_record_is_worth_at_least_so_much():
    """Mostly no more than n (1 - rho^2) / (1 + rho^2), which is 210 here; and hardly less where it is long."""
    rho, n = 0.9, 2000
    truth = (1.0 - rho**2) / (1.0 + rho**2)
    records = lfilter([1.0], [1.0, -rho], np.random.default_rng(6).normal(size=(200, n + 500)), axis=1)[:, 500:]
    worth = [weigh_record(record**2, np.abs(record)).independent for record in records]
    assert 130 <= sum(one <= n * truth for one in worth) <= 198
    assert np.median(worth) > 0.6 * n * truth
    long = lfilter([1.0], [1.0, -rho], np.random.default_rng(7).normal(size=400_000))
    assert 0.85 < weigh_record(long**2, np.abs(long)).independent / effective_samples(long**2) < 1.0


def test_a_slow_part_beside_a_fast_one_is_seen():
    """White noise with a tenth of its variance at a correlation of 1000 samples: squares are correlated over half."""
    rng, rho, n, share = np.random.default_rng(8), math.exp(-1e-3), 50_000, 0.1
    slow = lfilter([math.sqrt(1.0 - rho**2)], [1.0, -rho], rng.normal(size=n + 5000))[5000:]
    record = math.sqrt(1.0 - share) * rng.normal(size=n) + math.sqrt(share) * slow
    worth = weigh_record(record**2, np.abs(record))
    truth = n / (1.0 + share**2 * 1000.0)  # tau of the squares: 1 + 2 sum share^2 rho^(2 m)
    assert effective_samples(record**2) > 2.0 * truth
    assert 0.2 * truth < worth.independent < 1.2 * truth
    assert 10.0 < worth.slowest < 100.0  # 50 stretches of 1000


def test_rms_of_windows_of_independent_gaussian_values():
    values = np.random.default_rng(1).normal(size=20_000)
    found, expected = windows_rms(values), gaussian_rms(float(np.sqrt(np.mean(values**2))), 20_000.0)
    assert found.value == expected.value
    assert found.upper - found.value == pytest.approx(expected.upper - expected.value, rel=0.1)
    with pytest.raises(ValueError, match=r"one signal, got the shape \(3, 4, 2\)"):
        windows_rms(np.ones((3, 4, 2)))
    with pytest.raises(ValueError, match="do not vary"):
        windows_rms(np.ones(10))


def test_chi_square_of_few_samples():
    """Tables: 18.31 and 3.94 are the 95 % and 5 % points with 10 degrees of freedom."""
    stated = gaussian_rms(2.0, 10.0, 0.9)
    assert stated.lower == pytest.approx(2.0 * math.sqrt(10.0 / 18.307), rel=1e-4)
    assert stated.upper == pytest.approx(2.0 * math.sqrt(10.0 / 3.9403), rel=1e-4)


@pytest.fixture(scope="module")
def amplitudes():
    """A sin(w t), A evenly from 0 to 10: the example of ECSS-E-ST-60-10C, Figure A-5.  400 runs."""
    A = np.random.default_rng(4).permutation((np.arange(400) + 0.5) / 40.0)
    return A[:, None] * np.sin(2.0 * np.pi * (np.arange(500) + 0.5) / 50.0 + 0.01)


def test_ensemble_interpretation(amplitudes):
    """At all times, in 90 % of the runs: amplitudes up to 9."""
    stated = quantile_of_runs(amplitudes, 0.9, 0.95, "ensemble")
    assert stated.lower < 9.0 < stated.bound < 9.5
    assert stated.value == pytest.approx(9.0, abs=0.05)
    assert stated.independent == 400.0


def test_temporal_interpretation(amplitudes):
    """90 % of the time, in any run: 10 sin(0.9 pi / 2) for the largest amplitude."""
    stated = quantile_of_runs(amplitudes, 0.9, 0.95, Interpretation.TEMPORAL)
    assert stated.value == pytest.approx(10.0 * math.sin(0.45 * math.pi), rel=0.02)
    assert stated.bound >= stated.value
    assert stated.ensemble_share == pytest.approx(0.05 ** (1.0 / 400.0))  # 99.25 % of all runs


def test_a_signal_that_saturates_has_a_bound():
    """The share up to the largest value never varies; the share below it does."""
    runs = np.minimum(np.abs(np.random.default_rng(7).normal(size=(1, 20_000))), 1.5)
    stated = quantile_of_runs(runs, 0.95, 0.9, "temporal")
    assert stated.bound == 1.5
    assert stated.independent > 10_000


def test_bounds_of_all_runs_hold_together():
    """Temporal: each run of twenty is bounded with a twentieth of the risk."""
    runs = np.abs(np.random.default_rng(7).normal(size=(20, 2000)))
    together = quantile_of_runs(runs, 0.9, 0.95, "temporal").bound

    def find_bound(level):
        worth = [weigh_share(run, 0.9).count_ranks(level) for run in runs]
        return max(quantile(run, 0.9, level, independent=n).bound for run, n in zip(runs, worth, strict=True))

    assert together == find_bound(0.9975) > find_bound(0.95)


def test_mixed_interpretation(amplitudes):
    """A random time of a random run: below x with the probability x/10 + mean of (2/pi) asin(x/A) beyond."""
    stated = quantile_of_runs(amplitudes, 0.9, 0.95, "mixed")
    A = (np.arange(20_000) + 0.5) / 2000.0

    def below(x):
        return np.mean(2.0 / np.pi * np.arcsin(np.minimum(x / A, 1.0)))

    assert stated.lower < stated.value < stated.upper
    assert below(stated.value) == pytest.approx(0.9, abs=1e-3)
    assert below(stated.lower) < 0.9 < below(stated.upper)
    assert stated.upper - stated.lower < 1.0


def test_a_bound_for_want_of_order_statistics():
    """Markov: a share 1 - P of all values is above the fourth root of the mean fourth power over 1 - P at most."""
    four, five = (np.tile([1.0, 3.0], (runs, 20)) for runs in (4, 5))
    assert {quantile_of_runs(four, 0.95, 0.9, one).bound for one in ("mixed", "ensemble")} == {math.inf}
    for interpretation, mean_square in (("mixed", 5.0), ("ensemble", 9.0)):
        stated = quantile_of_runs(five, 0.9973, 0.9, interpretation)
        assert stated.method == "Markov's inequality" and stated.value == 3.0
        assert stated.bound == pytest.approx(math.sqrt(mean_square) * (3.0 / 0.0027) ** 0.25, rel=1e-3)


@pytest.mark.parametrize("bad", [0.0, 1.0, 1.5, math.nan])
def test_what_is_no_probability(bad):
    for call in (
        lambda: samples_needed(bad, 0.9),
        lambda: quantile([1.0], bad),
        lambda: quantile_of_runs([[1.0]], bad, 0.9, "ensemble"),
    ):
        with pytest.raises(ValueError, match="probability: expected between 0 and 1"):
            call()
    with pytest.raises(ValueError, match="confidence: expected between 0 and 1"):
        samples_needed(0.9, bad)


def test_values_that_are_none():
    with pytest.raises(ValueError, match="values: expected"):
        quantile([], 0.9)
    with pytest.raises(ValueError, match="finite"):
        quantile([1.0, math.nan], 0.9)
    with pytest.raises(ValueError, match=r"shape \(runs, times\)"):
        quantile_of_runs([1.0, 2.0], 0.9, 0.9, "mixed")
    with pytest.raises(ValueError, match="'sometimes' is not a valid Interpretation"):
        quantile_of_runs([[1.0, 2.0]], 0.9, 0.9, "sometimes")
    with pytest.raises(ValueError, match="independent: expected above 0"):
        gaussian_rms(1.0, 0.0)
