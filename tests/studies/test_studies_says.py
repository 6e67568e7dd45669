"""What a study says: percentiles, probabilities and sensitivities against what is known."""

import math
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from scipy.stats import norm
from support.claims import verify_claim

from ps_fmu.pointing.confidence import quantile
from ps_fmu.pointing.interpretation import Interpretation
from ps_fmu.requirements.quantity import Names, Quantity
from ps_fmu.results.tables import format_tables
from ps_fmu.studies.conclusion import list_notes, make_tables
from ps_fmu.studies.factors import Factor, Spread
from ps_fmu.studies.outcome import (
    PROBABILITIES,
    Outcome,
    Output,
    Share,
    find_compliance,
    find_percentiles,
    find_worst,
)
from ps_fmu.studies.plan import Plan, make_shares
from ps_fmu.studies.study import Vary

OUTPUT = Output("active.toy.error.x.APE.rms", "rad")


@pytest.fixture
def make_outcome(read):
    """An outcome of a plan over the unit cube, whose one output is a function of the draws."""
    known = read()

    def make(plan, cases, factors, function, outputs=(OUTPUT,), seed=7, shared=()):
        study = replace(known, plan=plan, cases=cases, seed=seed)
        spread = Spread(0.0, 1.0)
        names = [f"x{i}" for i in range(factors)]
        made = tuple(Factor(Vary(parameter=Names([n]), values=[0]), "1", (n,), (1.0,), (), spread) for n in names)
        draws = make_shares(study, factors, np.random.default_rng(seed))
        table = pd.DataFrame({"case": range(cases), "status": "done", "error": None, outputs[0].name: function(draws)})
        return Outcome(Plan(study, made, draws, ("toy.seed",), shared), table, outputs)

    return make


def test_intervals_of_percentiles_hold_the_true_ones_as_often_as_they_say(make_outcome):
    held = np.zeros(len(PROBABILITIES))
    studies = 200
    for seed in range(studies):
        (found,) = find_percentiles(make_outcome("random", 120, 1, lambda s: norm.ppf(s[:, 0]), seed=seed))
        held += [stated.lower <= norm.ppf(stated.probability) <= stated.upper for stated in found.stated]
    # 90 % at least, less three standard deviations of 200 trials; the intervals of order statistics are conservative.
    # 120 cases say nothing of an upper bound of the 99th percentile: it is infinite, and the interval holds always.
    assert (held / studies >= 0.9 - 3.0 * math.sqrt(0.09 / studies)).all()


@pytest.mark.parametrize(
    ("true", "cases", "low", "high"),
    [(10, 10, 0.05 ** (1 / 10), 1.0), (0, 10, 0.0, 1.0 - 0.05 ** (1 / 10)), (9, 10, 0.6058, 0.9949)],
)
def test_the_interval_of_a_share_is_that_of_clopper_and_pearson(true, cases, low, high):
    assert Share(true, cases).interval(0.9) == pytest.approx((low, high), abs=1e-4)


@pytest.fixture
def required(make_outcome, tmp_path):
    """An outcome with a requirement: values 0 to 9 urad, limit 6.5, the last case without a result."""
    from ps_fmu.requirements.requirement import read_requirements

    path = tmp_path / "r.toml"
    path.write_text(
        '[[requirement]]\nname = "r"\nsignal = "toy.error.x"\nindex = "APE"\nprobability = 0.5\nconfidence = 0.9\n'
        'interpretation = "ensemble"\nlimit = "6.5 urad"\n'
    )
    (requirement,) = read_requirements(path)
    name = "verdict/r/active/toy.error.x"
    output = Output(f"{name}/value", "urad", 6.5, requirement, "active", "toy.error.x")
    outcome = make_outcome("random", 10, 1, lambda shares: shares[:, 0], (output, OUTPUT))
    outcome.table[output.name] = np.arange(10.0)
    outcome.table[f"{name}/answer"] = ["met"] * 5 + ["cannot be said"] * 5
    return outcome


def test_a_case_without_a_result_does_not_meet_a_requirement(required):
    required.table.loc[2, required.outputs[0].name] = np.nan
    (found,) = find_compliance(required)
    assert (found.below.true, found.below.cases, found.sure.true) == (6, 10, 5)
    assert found.pooled is None  # what the failed case would have had is not known


def test_a_requirement_on_the_ensemble_is_judged_by_all_cases(required):
    (found,) = find_compliance(required)
    assert found.pooled.value == 4.0
    assert found.pooled.bound == 7.0  # the 8th of 10 is the first with 90 %: P(binomial(10, 0.5) < 8) = 0.945
    assert find_worst(required, 2) == [(9, 9.0, required.outputs[0]), (8, 8.0, required.outputs[0])]


@pytest.mark.parametrize("plan", ["random", "latin-hypercube", "sobol"])
@pytest.mark.parametrize("probability", [0.5, 0.9, 0.98])
def test_intervals_of_the_probability_hold_the_true_one_as_often_as_they_say(make_outcome, required, plan, probability):
    """500 studies of 64 cases: 10 plans with 50 outputs, each the sum of two normal parameters of its own."""
    (requirement,) = {output.requirement for output in required.outputs if output.requirement}
    limit = math.sqrt(2.0) * norm.ppf(probability)
    outputs = tuple(Output(f"verdict/{k}/value", "urad", limit, requirement, "active", str(k)) for k in range(50))
    held = 0
    for seed in range(10):
        outcome = make_outcome(plan, 64, 100, lambda shares: norm.ppf(shares[:, 0]), outputs[:1], seed)
        values = norm.ppf(outcome.plan.draws).reshape(64, 50, 2).sum(axis=2)
        outcome.table[[output.name for output in outputs]] = values
        for one in find_compliance(replace(outcome, outputs=outputs)):
            low, high = one.below.interval()
            held += low <= probability <= high
    verify_claim(
        "study.probability",
        claim="Probability of meeting a requirement, with its 90 % interval",
        where="`ps-fmu sweep`: table, summary.json, study page",
        reference="500 studies of 64 cases, each of three plans, whose probabilities are 0.5, 0.9 and 0.98",
        error=0.9 - held / 500,
        bound=0.04,
        unit="of the studies; three standard deviations of the count",
    )


def state_all(outcome):
    """What the terminal says of an outcome: all tables and notes."""
    return " ".join(format_tables(make_tables(outcome), list_notes(outcome), 1000).split())


def test_a_sample_has_probabilities_and_a_verdict_over_all_cases(required):
    said = state_all(required)
    pooled = "not shown: 4 (50 % quantile), below 7 with 90 % confidence"
    for text in ("Clopper-Pearson", "0.7", "90 % interval", pooled):
        assert text in said


@pytest.mark.parametrize("plan", ["grid", "list", "morris", "sobol-indices"])
def test_a_plan_that_is_no_sample_has_no_statement_on_all_possible_cases(required, plan):
    outcome = replace(required, plan=replace(required.plan, study=replace(required.plan.study, plan=plan)))
    (found,) = find_compliance(outcome)
    assert found.pooled is None and found.answer is None
    said = state_all(outcome)
    for text in ("probability  ", "Clopper", "confidence,", "possible cases", "independent", "90 % intervals"):
        assert text not in said, text
    assert "7 of 10" in said
    verify_claim(
        "study.no_sample",
        claim="... a plan that is no sample has no probability, interval or statement over all cases, and says so",
        where="`ps-fmu sweep`, plans grid, list, morris, sobol-indices: tables and notes",
        reference="the texts that only a sample has",
        error=float(f"The plan '{plan}' is no sample of the dispersed system" not in said),
        bound=0.0,
        unit="texts that are wrong",
    )


@pytest.mark.parametrize("interpretation", ["ensemble", "mixed", "temporal"])
def test_cases_with_one_record_of_noise_are_no_independent_samples(required, interpretation):
    (output, other), name = required.outputs, "verdict/r/active/toy.error.x"
    output = replace(output, requirement=replace(output.requirement, interpretation=Interpretation(interpretation)))
    required.table[f"{name}/bound"] = np.arange(10.0) + 1.0
    pooled = {output.name: quantile(np.arange(10.0), 0.5, 0.9)}  # mixed: as ensemble
    outcome = replace(required, outputs=(output, other), pooled=pooled,
                      plan=replace(required.plan, shared_seeds=("toy.seed",)))  # fmt: skip
    (found,) = find_compliance(outcome)
    said = state_all(outcome)
    assert "All cases have the same random numbers (toy.seed)" in said
    assert "independent samples (" not in said
    if interpretation == "temporal":  # each case is judged by its own record
        assert found.answer is not None
        return
    assert found.answer is None
    assert "no verdict: 4 (50 % quantile), below 7 with 90 % confidence, for the one record of noise" in said


def test_a_bound_from_one_record_of_noise_does_not_hold_for_others():
    """Why: the cases differ by little, and the bound of 45 of them is below a tenth of the values of most records."""
    rng = np.random.default_rng(0)
    above = []
    for _ in range(400):
        cases = 1.0 + 0.001 * rng.standard_normal(45)  # of a parameter
        bound = quantile(cases * (1.0 + 0.1 * rng.standard_normal()), 0.95, 0.9).bound
        above.append(norm.sf(bound, 1.0, 0.1))
    verify_claim(
        "study.shared_noise",
        claim="... no verdict over all cases where all cases have one record of noise",
        where="`ps-fmu sweep`, seeds = common, ensemble and mixed requirements: table, summary.json",
        reference="400 studies of 45 cases: so many would have a bound of the 95 % quantile that holds, with 90 % said",
        error=np.mean(np.array(above) <= 0.05),
        bound=0.5,
        unit="of the studies",
    )


def test_seeds_that_all_cases_have_are_found(make_prepared):
    assert make_prepared().plan.shared_seeds == ()
    assert make_prepared(changes={"cases = 6": 'cases = 6\nseeds = "common"'}).plan.shared_seeds == ("toy.seed",)
    own = '[runs.active]\n"toy.seed" = 3\n[[vary]]\nparameter = "gain"'
    assert make_prepared(changes={'[[vary]]\nparameter = "gain"': own}).plan.shared_seeds == ("toy.seed",)
    varied = '[[vary]]\nparameter = "toy.seed"\nvalues = [1, 2]\n[[observe]]'
    assert make_prepared(changes={"[[observe]]": varied}).plan.shared_seeds == ()


@pytest.mark.parametrize(
    ("given", "unit", "shown", "factor"),
    [
        ({"distribution": "uniform", "low": Quantity(0.0, "rpm"), "high": Quantity(3000.0, "rpm")}, "rad/s", "rpm",
         30.0 / math.pi),
        ({"values": ["0 ms", "1 ms"]}, "s", "ms", 1e3),
        ({"distribution": "normal", "relative": Quantity(2.0, "%")}, "kg", "kg", 1.0),
        ({"values": [True, False]}, "1", "1", 1.0),
    ],
)  # fmt: skip
def test_parameters_are_shown_in_the_unit_that_the_study_states(given, unit, shown, factor):
    vary = Vary(parameter=Names(("a.b",)), **given)
    assert Factor(vary, unit, ("a.b",), (1.0,), (), None).shown == (shown, pytest.approx(factor))
