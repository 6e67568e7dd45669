"""What a study says: percentiles, probabilities and sensitivities against what is known."""

import math

import numpy as np
import pandas as pd
import pytest
from scipy.stats import norm

from ps_fmu.requirements.quantity import Names
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
from ps_fmu.studies.plan import Plan, study_shares
from ps_fmu.studies.study import Vary

OUTPUT = Output("active.toy.error.x.APE.rms", "rad")


@pytest.fixture
def make_outcome(read):
    """An outcome of a plan over the unit cube, whose one output is a function of the draws."""

    def make(plan, cases, factors, function, outputs=(OUTPUT,), seed=7):
        changes = {'plan = "random"\ncases = 6': f'plan = "{plan}"\ncases = {cases}', "seed = 7": f"seed = {seed}"}
        study = read(changes=changes)
        spread = Spread(0.0, 1.0)
        names = [f"x{i}" for i in range(factors)]
        made = tuple(Factor(Vary(parameter=Names([n]), values=[0]), "1", (n,), (1.0,), (), spread) for n in names)
        draws = study_shares(study, factors)
        table = pd.DataFrame({"case": range(cases), "status": "done", "error": None, outputs[0].name: function(draws)})
        return Outcome(Plan(study, made, draws, ()), table, outputs)

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
