"""What a study says its outputs depend on, against functions whose indices are known, and against noise alone.

Each test of a rate counts over many studies of its own, ten times as many in ``make soak``; bounds allow for three
standard deviations of that count.
"""

import math
import os
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import norm
from support.claims import verify_claim

from ps_fmu.requirements.quantity import Names
from ps_fmu.studies.factors import Factor, Spread
from ps_fmu.studies.plan import Plan, make_shares
from ps_fmu.studies.sensitivity import find_influences
from ps_fmu.studies.study import Vary
from ps_fmu.studies.variance import CONFIDENCE, FALSE_SHARE, estimate_share, make_basis

UNIFORM, NORMAL = Spread(-math.sqrt(3.0), math.sqrt(3.0)), Spread(-math.inf, math.inf, 0.0, 1.0)  # of variance 1
CUBE = Spread(0.0, 1.0)
STUDIES = 1000 if os.environ.get("PS_FMU_SOAK") else 100  # that a rate is counted over


def make_factor(name, spread=None, levels=()):
    return Factor(Vary(parameter=Names([name]), values=[0]), "m", (name,), (1.0,), tuple(levels), spread)


@pytest.fixture
def make_plan(read):
    """A plan of a study of the toy; ``kinds``: a spread, or the levels of each factor; ``noisy``: seeds of its own."""
    studies = {}

    def make(plan, cases, kinds, seed=7, noisy=True, draws=None):
        if plan not in studies:
            counted = "" if plan in ("grid", "list") else "\ncases = 6"
            levels = {'distribution = "uniform"\nlow = "1"\nhigh = "2"': "values = [1, 2]"} if not counted else {}
            studies[plan] = read(changes={'plan = "random"\ncases = 6': f'plan = "{plan}"{counted}', **levels})
        study = replace(studies[plan], cases=cases, seed=seed, seeds="independent" if noisy else "common")
        factors = tuple(
            make_factor(f"x{place}", *((kind,) if isinstance(kind, Spread) else (None, kind)))
            for place, kind in enumerate(kinds)
        )
        if draws is None:
            shares = make_shares(study, len(kinds), np.random.default_rng(seed)).T
            draws = np.column_stack([factor.draw(column) for factor, column in zip(factors, shares, strict=True)])
        return Plan(study, factors, draws, ("toy.seed",))

    return make


def linear(x, rng):
    return x @ np.array([2.0, 1.0, 0.0]) + 1.5 * rng.standard_normal(len(x))


def ishigami(x, rng):
    """T. Ishigami, T. Homma (1990)."""
    x = (2.0 * x - 1.0) * math.pi
    return np.sin(x[:, 0]) + 7.0 * np.sin(x[:, 1]) ** 2 + 0.1 * x[:, 2] ** 4 * np.sin(x[:, 0])


def sobol_g(x, rng):
    """The function g of I. M. Sobol'."""
    a = np.array([0.0, 1.0, 4.5])
    return ((np.abs(4.0 * x - 2.0) + a) / (1.0 + a)).prod(axis=1)


def bowl(x, rng):
    """Best in the middle, as a mistuned isolator is."""
    return (x[:, 0] - 0.4) ** 2 + 0.5 * rng.standard_normal(len(x))


G = np.array([1.0, 0.25, 1.0 / 5.5**2]) / 3.0
KNOWN = {
    "linear": (linear, [NORMAL, UNIFORM, NORMAL], np.array([4.0, 1.0, 0.0]) / 7.25),
    "ishigami": (ishigami, [CUBE] * 3, np.array([0.3139, 0.4424, 0.0])),
    "g": (sobol_g, [CUBE] * 3, G / (np.prod(1.0 + G) - 1.0)),
    "bowl": (bowl, [UNIFORM, NORMAL], np.array([0.8 + 0.64, 0.0]) / (0.8 + 0.64 + 0.25)),
}


@pytest.mark.parametrize("plan", ["random", "latin-hypercube", "sobol", "sobol-indices"])
@pytest.mark.parametrize("name", KNOWN)
def test_shares_of_known_functions_are_the_known_ones(make_plan, name, plan):
    function, kinds, known = KNOWN[name]
    cases = 2048 if plan != "sobol-indices" else 1024 * (len(kinds) + 2)
    made = make_plan(plan, cases, kinds)
    (found,) = find_influences(made, function(made.draws, np.random.default_rng(3))[None])
    stated = np.array([0.0 if share is None else share.value for share in found.shares])
    assert found.order[0] == known.argmax()
    assert [share is None for share in found.shares] == (known == 0.0).tolist()
    for share in filter(None, found.shares):
        assert 0.0 <= share.lower < share.value < share.upper <= 1.0
    verify_claim(
        "study.share",
        claim="Share of the variance that each parameter explains by itself, and the order of the parameters",
        where="`ps-fmu sweep`: table, summary.json, study page",
        reference="indices in closed form: linear, Ishigami, Sobol' g, parabola; 2048 cases of four plans",
        error=np.abs(stated - known),
        bound=0.03,
        unit="of the variance",
    )


@pytest.mark.parametrize(
    ("name", "cases"), [("linear", 50), ("g", 50), ("bowl", 50), *((name, 200) for name in KNOWN)]
)
def test_intervals_of_shares_hold_the_known_ones_as_often_as_they_say(make_plan, name, cases):
    """Of each share far above the floor, so that it is stated nearly always."""
    function, kinds, known = KNOWN[name]
    studies, held, stated = STUDIES, np.zeros(len(kinds)), np.zeros(len(kinds))
    for seed in range(studies):
        made = make_plan("random", cases, kinds, seed)
        (found,) = find_influences(made, function(made.draws, np.random.default_rng(seed))[None])
        for place, (share, true) in enumerate(zip(found.shares, known, strict=True)):
            stated[place] += share is not None
            held[place] += share is not None and share.lower <= true <= share.upper
    strong = known > (0.5 if cases == 50 else 0.3)
    assert (stated[strong] > 0.85 * studies).all()
    verify_claim(
        "study.share_interval",
        claim="90 % interval of the share of a parameter",
        where="`ps-fmu sweep`: table, summary.json, study page",
        reference="share of studies of 50 and 200 cases whose interval holds the index in closed form",
        error=CONFIDENCE - held[strong] / stated[strong] - 3.0 * math.sqrt(0.09 / studies),
        bound=0.03,
        unit="of the studies, beyond three standard deviations of the count",
    )


def heavy(rng, shape):
    """Gaussian noise, log-normal noise of sigma 2, and outputs that are 0 but in a few cases: a third each."""
    found = rng.standard_normal(shape)
    found[:, ::3] = np.exp(2.0 * found[:, ::3])
    found[:, 1::3] *= rng.random(found[:, 1::3].shape) < 0.05
    return found.T


@pytest.mark.parametrize("cases", [20, 100])
def test_a_study_of_noise_alone_states_no_share(make_plan, cases):
    """Nothing at all in 99 of 100 studies with six parameters and nine outputs, however their noise is distributed."""
    kinds = [UNIFORM, NORMAL, NORMAL, ["a", "b", "c"], [0.0, 1.0], UNIFORM]
    studies, wrong, wrong_pairs = STUDIES, 0, 0
    for seed in range(studies):
        made = make_plan("random", cases, kinds, seed)
        found = find_influences(made, heavy(np.random.default_rng(seed), (cases, 9)))
        wrong += any(share is not None for one in found if one for share in one.shares)
        wrong_pairs += any(one.pairs for one in found if one)
    verify_claim(
        "study.noise_alone",
        claim="Of parameters without influence no share is stated, and of pairs of them none",
        where="`ps-fmu sweep`: table, summary.json, study page",
        reference="studies of noise alone: Gaussian, log-normal, 0 but in a few cases; one in a hundred may state one",
        error=max(wrong, wrong_pairs) / studies - 3.0 * math.sqrt(FALSE_SHARE / studies),
        bound=0.01,
        unit="of the studies, beyond three standard deviations of the count",
    )


@pytest.mark.parametrize(
    ("kind", "function"),
    [(UNIFORM, lambda x, z: x[:, :1] * x[:, 1:2] + 0.5 * z), (UNIFORM, lambda x, z: x[:, :1] ** 2 * z),
     (NORMAL, lambda x, z: x[:, :1] ** 2 * z)],
)  # fmt: skip
def test_a_parameter_that_acts_with_others_alone_has_no_share_by_itself(make_plan, kind, function):
    """With another parameter, or as a scale of the noise: the mean of the output does not depend on it."""
    wrong = 0
    for seed in range(STUDIES):
        made = make_plan("random", 100, [kind] * 3, seed)
        values = function(made.draws, np.random.default_rng(seed).standard_normal((100, 20)))
        wrong += any(share is not None for one in find_influences(made, values.T) for share in one.shares)
    verify_claim(
        "study.acts_together_alone",
        claim="Of a parameter that only scales the noise, or acts only with another, no share by itself is stated",
        where="`ps-fmu sweep`: table, summary.json, study page",
        reference="studies of 100 cases and 20 outputs; the worst: noise as the square of a normal parameter",
        error=wrong / STUDIES,
        bound=0.1,
        unit="of the studies",
    )


@pytest.mark.parametrize("kind", [NORMAL, UNIFORM])
def test_the_noise_floor_is_what_noise_reaches_in_one_study_of_a_hundred(make_plan, kind):
    """Of one parameter and one output: 5000 outputs of noise, each alone, against the floor that the study states."""
    made = make_plan("random", 60, [kind])
    noise = np.random.default_rng(1).standard_normal((5000, 60))
    (found,) = find_influences(made, noise[:1])
    basis = make_basis(made.factors[0], made.draws[:, 0], 5)  # as many degrees of freedom as 60 cases have
    above = np.mean([estimate_share(basis, one - one.mean()).value > found.floor for one in noise])
    verify_claim(
        "study.noise_floor",
        claim="Noise floor: the share that a parameter without influence reaches by chance in one study of a hundred",
        where="`ps-fmu sweep`: table, summary.json, study page",
        reference="5000 outputs of Gaussian noise",
        error=abs(above - FALSE_SHARE),
        bound=0.0043,
        unit="of the outputs; three standard deviations of the count",
    )


def test_of_the_shares_that_are_stated_few_are_chance(make_plan):
    """Beside a parameter that rules all outputs, five that have no influence: one stated share in a hundred at most."""
    stated, wrong = 0, 0
    for seed in range(40):
        made = make_plan("random", 80, [UNIFORM] * 6, seed)
        noise = np.random.default_rng(seed).standard_normal((30, 80))
        for one in find_influences(made, 2.0 * made.draws[:, 0] + noise):
            shown = [share is not None for share in one.shares]
            stated, wrong = stated + sum(shown), wrong + sum(shown[1:])
    assert stated > 1190
    assert wrong / stated < FALSE_SHARE + 3.0 * math.sqrt(FALSE_SHARE / 40.0)  # outputs of one study go together


def test_what_is_left_is_that_of_the_noise_and_of_what_acts_together(make_plan):
    made = make_plan("random", 2000, [UNIFORM] * 3)
    x, noise = made.draws.T, np.random.default_rng(6).standard_normal(2000)
    (alone,) = find_influences(made, (2.0 * x[0] + x[1] + noise)[None])
    (joint,) = find_influences(made, (2.0 * x[0] + x[1] * x[2] + noise)[None])
    assert not alone.pairs
    assert list(joint.pairs) == [(1, 2)]
    assert joint.pairs[1, 2].lower < 1.0 / 6.0 < joint.pairs[1, 2].upper
    verify_claim(
        "study.left",
        claim="What is left by the seed and by what acts together, and the share of two parameters together",
        where="`ps-fmu sweep`: table, summary.json, study page",
        reference="a sum, and a product of two parameters, with noise: shares in closed form",
        error=[abs(alone.left.value - 1 / 6), abs(joint.left.value - 2 / 6), abs(joint.pairs[1, 2].value - 1 / 6)],
        bound=0.03,
        unit="of the variance",
    )


def test_intervals_of_pairs_hold_the_known_share_as_often_as_they_say(make_plan):
    studies, held = STUDIES, 0
    for seed in range(studies):
        made = make_plan("random", 200, [UNIFORM] * 3, seed)
        x, noise = made.draws.T, np.random.default_rng(seed).standard_normal(200)
        (found,) = find_influences(made, (2.0 * x[0] + 1.5 * x[1] * x[2] + noise)[None])
        held += found.pairs[1, 2].lower <= 2.25 / 7.25 <= found.pairs[1, 2].upper
    verify_claim(
        "study.pair_interval",
        claim="90 % interval of the share of two parameters together",
        where="`ps-fmu sweep`: table, summary.json, study page",
        reference="share of studies of 200 cases whose interval holds the share in closed form",
        error=CONFIDENCE - held / studies - 3.0 * math.sqrt(0.09 / studies),
        bound=0.03,
        unit="of the studies, beyond three standard deviations of the count",
    )


def test_shares_of_correlated_parameters_have_a_part_of_each_other(make_plan):
    """y = x1 and a correlation r: x2 explains r^2 of it by itself, and nothing beside x1."""
    rng = np.random.default_rng(5)
    x = rng.multivariate_normal([0.0, 0.0], [[1.0, 0.6], [0.6, 1.0]], 4000)
    made = make_plan("random", 4000, [NORMAL] * 2, draws=x)
    (found,) = find_influences(made, (x[:, 0] + 0.5 * rng.standard_normal(4000))[None])
    assert found.shares[1].value == pytest.approx(0.36 / 1.25, abs=0.03)
    assert found.left.value == pytest.approx(0.25 / 1.25, abs=0.02)


@pytest.mark.parametrize(
    ("function", "shape"),
    [(lambda x: 3.0 * x, "rising"), (lambda x: np.exp(-x), "falling"), (lambda x: (x - 0.5) ** 2, "least near"),
     (lambda x: -((x + 0.5) ** 2), "largest near"), (lambda x: np.cos(8.0 * x), "up and down")],
)  # fmt: skip
def test_how_an_output_depends_on_a_parameter_is_said(make_plan, function, shape):
    made = make_plan("random", 400, [UNIFORM, UNIFORM])
    noise = 0.3 * np.random.default_rng(4).standard_normal(400)
    (found,) = find_influences(made, (function(made.draws[:, 0]) + noise)[None])
    assert found.shapes[0].startswith(shape)
    assert found.shapes[1] == ""  # nothing is said of what is below the floor
    if "near" in shape:
        place, unit = found.shapes[0].removeprefix(shape).split()
        assert float(place) == pytest.approx(0.5 if shape == "least near" else -0.5, abs=0.1)
        assert unit == "m"


def test_of_texts_the_best_and_the_worst_are_named(make_plan):
    made = make_plan("random", 200, [["soft", "stiff", "broken"], UNIFORM])
    values = np.array([2.0, 1.0, 5.0])[made.draws[:, 0].astype(int)] + np.random.default_rng(0).standard_normal(200)
    (found,) = find_influences(made, values[None])
    assert found.shapes[0] == "least at stiff, largest at broken"
    assert found.shares[0].lower < (26.0 / 9.0) / (26.0 / 9.0 + 1.0) < found.shares[0].upper


def test_of_values_between_which_an_output_turns_the_best_and_the_worst_are_named(make_plan):
    """As a delay near half a period of a resonance, but not one of a whole period."""
    made = make_plan("random", 200, [[0.0, 1.0, 2.0, 4.0], UNIFORM])
    values = np.array([0.0, -0.2, 9.0, 0.0, 0.3])[made.draws[:, 0].astype(int)]
    (found,) = find_influences(made, (values + 0.1 * np.random.default_rng(0).standard_normal(200))[None])
    assert found.shapes[0] == "least at 1 m, largest at 2 m"


def test_shares_of_a_grid_without_noise_are_those_of_the_analysis_of_variance(make_plan):
    """Three by four points: row means, column means, and what is left, by hand."""
    a, b = np.meshgrid([0.0, 1.0, 2.0], [0.0, 1.0, 3.0, 4.0], indexing="ij")
    y = 3.0 * a + b + 0.5 * a * b
    made = make_plan("grid", None, [[0.0, 1.0, 2.0], [0.0, 1.0, 3.0, 4.0]], noisy=False,
                     draws=np.column_stack([a.ravel(), b.ravel()]))  # fmt: skip
    (found,) = find_influences(made, y.ravel()[None])
    known = [y.mean(axis=1).var() / y.var(), y.mean(axis=0).var() / y.var()]
    assert found.floor is None
    assert found.shapes == ("rising", "rising")
    verify_claim(
        "study.grid",
        claim="Shares of a grid without random numbers, exact, and what acts together",
        where="`ps-fmu sweep`: table, summary.json, study page",
        reference="analysis of variance by hand",
        error=np.abs([*(s.value for s in found.shares), found.left.value] - np.array([*known, 1.0 - sum(known)])),
        bound=1e-12,
        unit="of the variance",
    )


def test_total_indices_of_ishigamis_function_are_the_known_ones(make_plan):
    made = make_plan("sobol-indices", 1024 * 5, [CUBE] * 3, noisy=False)
    (found,) = find_influences(made, ishigami(made.draws, None)[None])
    assert all(total.lower < total.value < total.upper for total in found.totals)
    assert found.shares[2] is None and found.totals[2].lower > found.floor  # it acts by the first one alone
    assert found.order == [1, 0, 2]
    verify_claim(
        "study.total_index",
        claim="Total Sobol' index: the share of a parameter with others",
        where="`ps-fmu sweep`, plan sobol-indices: table, summary.json, study page",
        reference="Ishigami's function in closed form, 1024 points",
        error=np.abs([total.value for total in found.totals] - np.array([0.5576, 0.4424, 0.2437])),
        bound=0.02,
        unit="of the variance",
    )


@pytest.mark.parametrize("plan", ["sobol-indices", "morris"])
def test_neighbours_with_other_random_numbers_are_not_compared(make_plan, plan):
    made = make_plan(plan, 64 * 4, [CUBE] * (2 if plan == "sobol-indices" else 3), noisy=True)
    (found,) = find_influences(made, made.draws[None, :, 0])
    assert found is None if plan == "morris" else found.totals == ()


def test_effects_of_a_linear_function_are_the_deviations_that_its_parameters_cause(make_plan):
    """A normal and a uniform parameter of one variance have one mu*, and no case is far out."""
    made = make_plan("morris", 20 * 4, [Spread(-math.inf, math.inf, 5.0, 0.1), UNIFORM, [0.0, 4.0]], noisy=False)
    (found,) = find_influences(made, (made.draws @ np.array([10.0, 1.0, -1.5]))[None])
    assert [spread for _, spread in found.effects] == pytest.approx([0.0] * 3, abs=1e-9)
    assert found.shapes == ("rising", "rising", "falling")
    assert found.order[0] == 2
    levels = norm.ppf([0.125, 0.375, 0.625, 0.875])
    assert np.unique(made.draws[:, 0]) == pytest.approx(5.0 + 0.1 * levels, rel=1e-9)
    verify_claim(
        "study.effect",
        claim="Mean magnitude mu* of Morris' effects: the standard deviation that a parameter causes",
        where="`ps-fmu sweep`, plan morris: table, summary.json, study page",
        reference="linear function of a normal, a uniform and a two-valued parameter",
        error=np.abs([size for size, _ in found.effects] - np.array([1.0, 1.0, 3.0])),
        bound=1e-9,
    )


def test_effects_that_depend_on_the_others_scatter(make_plan):
    made = make_plan("morris", 40 * 3, [UNIFORM, UNIFORM], noisy=False)
    (found,) = find_influences(made, (made.draws[:, 0] * made.draws[:, 1])[None])
    assert all(spread > size for size, spread in found.effects)
    assert found.shapes == ("both ways", "both ways")


def test_cases_without_a_result_are_left_out(make_plan):
    made = make_plan("random", 50, [UNIFORM, UNIFORM])
    values = np.vstack([made.draws[:, 0], made.draws[:, 1], np.full(50, np.nan), np.ones(50)])
    values[0, 3] = np.nan
    one, other, none, constant = find_influences(made, values)
    assert one.shares[0].value == pytest.approx(1.0, abs=1e-9) and one.shares[1] is None
    assert other.shares[1].value == pytest.approx(1.0, abs=1e-9)
    assert none is None and constant is None


@pytest.mark.parametrize("cases", range(4, 12))
def test_a_few_cases_say_what_they_can(make_plan, cases):
    made = make_plan("random", cases, [UNIFORM, NORMAL, ["a", "b", "c", "d", "e", "f"], [1.0]])
    (found,) = find_influences(made, np.random.default_rng(cases).standard_normal((1, cases)))
    assert found.shares == (None,) * 4
