"""The cases of a plan: where they lie, how they are correlated, that they are the same again."""

from itertools import product

import numpy as np
import pytest
from scipy.stats import norm, spearmanr
from support.claims import verify_claim

from ps_fmu.studies.factors import Spread
from ps_fmu.studies.plan import correlate, make_shares
from ps_fmu.studies.study import StudyError

from .test_studies_read import PAIR, SECOND

MORE = SECOND + PAIR + "\n[[observe]]"


def shares(read, plan, cases, factors):
    study = read(changes={'plan = "random"\ncases = 6': f'plan = "{plan}"\ncases = {cases}'})
    return make_shares(study, factors, np.random.default_rng(0))


def test_a_latin_hypercube_has_a_point_in_each_stratum(read):
    found = shares(read, "latin-hypercube", 50, 3)
    assert (np.sort(np.floor(50 * found), axis=0) == np.arange(50)[:, None]).all()


def test_sobol_points_fill_the_square_evenly(read):
    found = shares(read, "sobol", 64, 2)
    counts, _, _ = np.histogram2d(*found.T, bins=8, range=[[0, 1], [0, 1]])
    assert (counts == 1).all()


def test_the_points_of_sobol_indices_are_a_b_and_a_with_columns_of_b(read):
    found = shares(read, "sobol-indices", 8 * 5, 3)
    A, B, mixed = found[:8], found[8:16], found[16:].reshape(3, 8, 3)
    for i, own in enumerate(mixed):
        assert (own[:, i] == B[:, i]).all()
        assert (np.delete(own, i, axis=1) == np.delete(A, i, axis=1)).all()


def test_a_trajectory_of_morris_changes_one_factor_at_a_time(read):
    found = shares(read, "morris", 4 * 5, 3)
    steps = np.diff(found.reshape(5, 4, 3), axis=1)
    assert ((steps != 0.0).sum(axis=2) == 1).all() and ((steps != 0.0).sum(axis=1) == 1).all()
    assert (np.abs(steps[steps != 0.0]) == 0.5).all()


def test_trajectories_of_morris_visit_all_levels_alike(read):
    """In all orders, up and down: each of four levels in a quarter of the cases, within three standard deviations."""
    found = shares(read, "morris", 4 * 1000, 3).reshape(1000, 4, 3)
    assert np.unique(found).tolist() == [0.125, 0.375, 0.625, 0.875]
    for level in np.unique(found):
        assert np.abs((found == level).mean(axis=(0, 1)) - 0.25).max() < 3.0 * np.sqrt(0.25 * 0.75 / 1000)
    steps = np.diff(found, axis=1)
    assert np.abs((steps > 0.0).sum(axis=(0, 1)) / 1000 - 0.5).max() < 3.0 * np.sqrt(0.25 / 1000)
    assert np.abs((steps != 0.0).mean(axis=0) - 1.0 / 3.0).max() < 3.0 * np.sqrt(2.0 / 9.0 / 1000)


@pytest.mark.parametrize("rank", [-0.9, -0.3, 0.5, 0.8])
@pytest.mark.parametrize("plan", ["random", "latin-hypercube", "sobol"])
def test_correlated_shares_have_the_rank_correlation_and_keep_their_values(read, plan, rank):
    found = shares(read, plan, 4096, 2)
    turned = correlate(found, np.array([[1.0, rank], [rank, 1.0]]))
    assert spearmanr(*turned.T).statistic == pytest.approx(rank, abs=1e-3)  # by chance 0.016
    assert (np.sort(turned, axis=0) == np.sort(found, axis=0)).all()


@pytest.mark.parametrize("rank", [-0.6, 0.3, 0.7])
def test_the_own_correlation_of_a_small_sample_is_taken_out(rank):
    """A copula alone leaves what chance gives: a standard deviation of 0.10 at 20 cases and a rank of 0.7."""
    wanted = np.array([[1.0, rank, 0.0], [rank, 1.0, 0.0], [0.0, 0.0, 1.0]])
    found = []
    for seed in range(200):
        shares = np.random.default_rng(seed).random((20, 3))
        turned = correlate(shares, wanted)
        assert (turned[:, 2] == shares[:, 2]).all()  # no correlation is asked for
        found.append(spearmanr(*turned[:, :2].T).statistic)
    verify_claim(
        "study.rank_correlation",
        claim="Rank correlation that a study asks for",
        where="`ps-fmu sweep`, [[correlate]]: plan.parquet, study.parquet",
        reference="Spearman's coefficient of 200 samples of 20 cases: mean and standard deviation",
        error=[abs(np.mean(found) - rank), np.std(found)],
        bound=0.02,
        unit="of the coefficient",
    )


@pytest.mark.parametrize("cases", [1, 2, 3, 4, 6])
def test_a_few_cases_can_be_correlated(cases):
    wanted = np.full((3, 3), 0.5) + 0.5 * np.eye(3)
    for seed in range(50):
        shares = np.random.default_rng(seed).random((cases, 3))
        assert (np.sort(correlate(shares, wanted), axis=0) == np.sort(shares, axis=0)).all()


def test_a_truncated_normal_has_the_share_of_the_normal_between_its_ends():
    spread = Spread(-1.0, 0.5, 0.0, 1.0)
    values = spread.quantile(np.linspace(0.0, 1.0, 1001))
    assert values.min() >= -1.0 and values.max() <= 0.5
    inside = (norm.cdf(values) - norm.cdf(-1.0)) / (norm.cdf(0.5) - norm.cdf(-1.0))
    assert np.allclose(inside, np.linspace(0.0, 1.0, 1001), rtol=0.0, atol=1e-9)


@pytest.mark.parametrize(("low", "high", "first", "last"), [(0.0, 3e-3, 0, 30), (4e-5, 2.96e-3, 1, 29)])
def test_draws_are_multiples_within_their_ends(low, high, first, last):
    spread = Spread(low, high, multiple_of=1e-4)
    shares = np.linspace(0.0, 1.0, 2001)
    found, exact = spread.quantile(shares), low + shares * (high - low)
    steps = np.round(found / 1e-4)
    np.testing.assert_allclose(found, steps * 1e-4, rtol=1e-12)
    assert (steps.min(), steps.max()) == (first, last)
    inner = (exact > first * 1e-4) & (exact < last * 1e-4)
    assert np.abs(found - exact)[inner].max() <= 0.5e-4 + 1e-12


def test_a_grid_has_every_combination_once(make_prepared):
    steps = 'distribution = "steps"\nlow = "1"\nhigh = "100"\ncount = 3\nspacing = "log"'
    changes = {
        'plan = "random"\ncases = 6': 'plan = "grid"',
        'distribution = "uniform"\nlow = "1"\nhigh = "2"': steps,
        "[[observe]]": '[[vary]]\nparameter = "mode"\nvalues = ["none", "raise"]\n[[observe]]',
    }
    plan = make_prepared(changes=changes).plan
    pairs = [(plan.values(i)["toy.gain"], plan.values(i)["toy.mode"]) for i in range(len(plan))]
    assert [(round(gain, 12), mode) for gain, mode in pairs] == list(product((1.0, 10.0, 100.0), ("none", "raise")))


def test_a_list_takes_the_values_side_by_side(make_prepared):
    changes = {
        'plan = "random"\ncases = 6': 'plan = "list"',
        'distribution = "uniform"\nlow = "1"\nhigh = "2"': "values = [1, 2, 3]",
        "[[observe]]": '[[vary]]\nparameter = "offset"\nvalues = [4, 5, 6]\n[[observe]]',
    }
    plan = make_prepared(changes=changes).plan
    assert plan.draws.tolist() == [[1.0, 4.0], [2.0, 5.0], [3.0, 6.0]]
    changes["[[observe]]"] = changes["[[observe]]"].replace(", 6", "")
    with pytest.raises(StudyError, match="as many values of each, got gain: 3, offset: 2"):
        make_prepared(changes=changes)


def test_the_same_file_gives_the_same_plan_and_another_seed_another(make_prepared):
    one, same = (make_prepared(changes={"[[observe]]": MORE}) for _ in range(2))
    other = make_prepared(changes={"[[observe]]": MORE, "seed = 7": "seed = 8"})
    assert (one.plan.draws == same.plan.draws).all()
    assert one.identity == same.identity
    assert not (one.plan.draws == other.plan.draws).any()
    assert one.identity.plan_sha256 != other.identity.plan_sha256


@pytest.mark.parametrize(
    ("old", "new"),
    [('high = "2"', 'high = "2.001"'), ('duration = "0.1 s"', 'duration = "0.2 s"'),
     ('index = ["APE", "RPE"]', 'index = "RPE"'),
     ("[[vary]]", '[runs.active]\n"toy.offset" = 1.0\n[[vary]]'), ("seed = 7", 'seed = 7\nseeds = "common"')],
)  # fmt: skip
def test_whatever_decides_a_row_changes_the_hash(make_prepared, old, new):
    identities = make_prepared().identity, make_prepared(changes={old: new}).identity
    assert identities[0].plan_sha256 != identities[1].plan_sha256


def test_the_name_of_a_study_does_not_change_the_hash(make_prepared):
    identities = make_prepared().identity, make_prepared(changes={'name = "toy"': 'name = "other"'}).identity
    assert identities[0].plan_sha256 == identities[1].plan_sha256


def test_each_case_has_seeds_of_its_own_unless_they_are_common(make_prepared):
    plan = make_prepared(changes={"cases = 6": "cases = 500"}).plan
    seeds = [plan.seeds(index)["toy.seed"] for index in range(500)]
    assert len(set(seeds)) == 500
    assert min(seeds) >= 0 and max(seeds) < 2**31
    plan = make_prepared(changes={"cases = 6": 'cases = 500\nseeds = "common"'}).plan
    assert len({plan.seeds(index)["toy.seed"] for index in range(500)}) == 1
