"""Verdicts on synthetic records whose distribution is known."""

import json
import re

import numpy as np
import pytest
from scipy.stats import norm
from support.required import COLUMNS

from ps_fmu.pointing import confidence
from ps_fmu.pointing.interpretation import quantile_of_runs
from ps_fmu.requirements.distribution import BINS_PER_DECADE
from ps_fmu.requirements.record import RequirementRecord
from ps_fmu.requirements.verdict import Answer, format_verdicts, judge, make_table, no_run, summarise
from ps_fmu.results.summary import plain

STEP = 0.01
APE = {"index": "APE", "at": None, "window": None}
RMS = {"statistic": "rms", "probability": None, "interpretation": None}


@pytest.fixture
def record(require):
    """The record of a requirement on the first column; further arguments change its entries."""

    def record(values, rows=None, **changes):
        values = np.asarray(values, dtype=float)
        found = RequirementRecord(require(**changes), COLUMNS, STEP, rows or len(values))
        block = np.zeros((len(values), len(COLUMNS)))
        block[:, 0] = values
        found.block(0, np.arange(len(values)) * STEP, block)
        return found

    return record


def decide(*records):
    (verdict,) = judge(records[0].requirement, "active", records, "every step")
    return verdict


def test_met_with_its_margin(record):
    """The largest of 59 independent values is the bound at 95/95; 200 are worth no fewer."""
    values = np.random.default_rng(2).permutation(np.linspace(0.002, 0.40, 200) * 1e-6)
    verdict = decide(record(values, **APE, confidence=0.95))
    assert 100 < verdict.statement.independent <= 200
    assert verdict.answer is Answer.MET and verdict.met
    assert 0.38e-6 < verdict.statement.bound <= 0.40e-6
    assert verdict.margin_percent == pytest.approx(100.0 * (1.0 - verdict.statement.bound / 0.5e-6))


@pytest.mark.parametrize(("level", "answer"), [(1.0, Answer.NOT_MET), (0.2, Answer.MET)])
def test_the_quantile_of_white_noise(record, white, level, answer):
    """95 % of the magnitudes of a Gaussian lie below 1.96 sigma; the limit is 0.5 urad."""
    verdict = decide(record(level * 1e-6 * white(20_001)[:, 0], **APE))
    true = norm.ppf(0.975) * level * 1e-6
    assert verdict.answer is answer
    assert true * 0.98 < verdict.statement.value < verdict.statement.bound < true * 1.06
    assert verdict.margin_percent == pytest.approx(100.0 * (1.0 - verdict.statement.bound / 0.5e-6))


def test_a_bound_at_the_limit_is_met_and_above_it_is_not(record):
    alternating = np.tile([0.1e-6, 0.5e-6], 500)
    assert decide(record(alternating, **APE)).answer is Answer.MET
    assert decide(record(alternating * (1.0 + 1e-9), **APE)).answer is Answer.NOT_MET


def test_too_few_independent_samples_say_how_long_to_run(record, white):
    """10 windows of MPE; 45 are needed for 95 % at 90 % confidence.  The advice comes true."""
    needed = confidence.samples_needed(0.95, 0.9)
    verdict = decide(record(1e-6 * white(1001)[:, 0], index="MPE", at=None, settling="0.5 s"))
    assert verdict.answer is Answer.NOT_SHOWN and not verdict.met
    assert re.search(rf"Run about \S+ s: the 9.5 s judged have \S+ independent samples, and {needed} are needed\.",
                     verdict.remark)  # fmt: skip
    length = float(verdict.remark.split("Run about ")[1].split()[0])
    enough = decide(record(1e-6 * white(round(length / STEP) + 1)[:, 0], index="MPE", at=None, settling="0.5 s"))
    assert enough.answer is Answer.MET and enough.statement.method == "order statistics over time"


def test_a_large_margin_is_a_verdict(record, white):
    """2.8 RMS bound the 95 % quantile; the RMS of ten windows is known to a factor."""
    verdict = decide(record(1e-8 * white(1001)[:, 0], index="MPE", at=None))
    assert verdict.answer is Answer.MET and verdict.statement.method == "Markov's inequality"
    assert verdict.remark.startswith("the bound is wide, by Markov's inequality. ")
    drifting = 1e-9 * np.linspace(1.0, 2.0, 1001)  # one independent sample, 250 times the margin
    assert decide(record(drifting, **APE)).answer is Answer.MET


@pytest.mark.parametrize("value", [0.0, 1e-7])
def test_what_does_not_vary_is_not_asked_to_run_longer(record, value):
    """No time makes samples of a constant independent; its peak can be judged."""
    verdict = decide(record(np.full(1001, value), **APE))
    assert verdict.answer is Answer.OPEN and verdict.margin_percent is None
    assert verdict.remark == "the value is the same at all times, and no run is long enough for its quantile: " + (
        "require its peak."
    )
    peak = {"statistic": "peak", "probability": None, "interpretation": None, "confidence": None}
    assert decide(record(np.full(1001, value), **APE, **peak)).answer is Answer.MET


@pytest.mark.parametrize("interpretation", ["ensemble", "mixed"])
def test_what_does_not_vary_within_a_run_may_need_more_runs(record, interpretation):
    verdict = decide(record(np.full(1001, 1e-7), **APE, interpretation=interpretation))
    assert verdict.answer is Answer.OPEN
    assert "45 runs with different seeds are needed" in verdict.remark


def test_the_bound_of_an_rms(record, white):
    """Chi-square: of 20001 independent samples the RMS is known to about 0.5 %."""
    verdict = decide(record(0.2e-6 * white(20_001)[:, 0], **APE, **RMS))
    assert verdict.answer is Answer.MET
    assert verdict.statement.value == pytest.approx(0.2e-6, rel=0.02)
    expected = confidence.gaussian_rms(verdict.statement.value, verdict.statement.independent, 0.9)
    assert verdict.statement.bound == pytest.approx(expected.bound, rel=2e-3)
    assert 1.003 < verdict.statement.bound / verdict.statement.value < 1.02


def test_the_peak_of_a_run(record):
    """Known without any independent samples."""
    peak = {"statistic": "peak", "probability": None, "confidence": None, "interpretation": None, **APE}
    decay = 2e-6 * np.exp(-np.arange(1001) * STEP)
    assert decide(record(decay, **peak)).answer is Answer.NOT_MET
    verdict = decide(record(decay, **peak, settling="2 s"))
    assert verdict.answer is Answer.MET
    assert verdict.statement.value == verdict.statement.bound == pytest.approx(2e-6 * np.exp(-2.0))
    assert verdict.as_dict()["confidence"] is None


def test_few_samples_are_enough_to_see_that_a_limit_is_far_exceeded(record, white):
    """All but a few of 20 windows are above the limit: the quantile of 95 % is, too."""
    verdict = decide(record(1e-4 * white(2001)[:, 0], index="MPE", at=None))
    assert verdict.statement.lower > 0.5e-6
    assert (verdict.answer, verdict.remark) == (Answer.NOT_MET, "")


@pytest.mark.parametrize(("level", "side"), [(0.25e-6, "below"), (0.27e-6, "above")])
def test_a_limit_within_the_interval_is_not_shown(record, white, level, side):
    verdict = decide(record(level * white(301)[:, 0], **APE))
    assert verdict.statement.lower <= 0.5e-6 < verdict.statement.bound
    assert verdict.answer is Answer.NOT_SHOWN and not verdict.met
    where = f"the value is {side} the limit, and the limit is within its interval."
    assert verdict.remark == f"{where} As a rule, a longer run narrows the interval."


def test_a_run_that_ends_before_a_window_is_full(record, white):
    verdict = decide(record(white(50)[:, 0], rows=1001))
    assert (verdict.answer, verdict.statement) == (Answer.OPEN, None)
    assert verdict.remark == "a run ends before one window of RPE is full: run longer."


@pytest.mark.parametrize("interpretation", ["temporal", "ensemble", "mixed"])
def test_several_runs_as_the_library_states_them(record, white, interpretation):
    """Of values in the middle of their bins the histogram rounds up by half a bin, and nothing else differs."""
    values = [1e-7 * np.abs(white(401, seed)[:, 0]) for seed in range(60)]
    half = 0.5 / BINS_PER_DECADE
    values = [10.0 ** (np.floor(np.log10(run / 0.5e-6) / (2.0 * half)) * 2.0 * half + half) * 0.5e-6 for run in values]
    runs = [record(run, **APE, interpretation=interpretation) for run in values]
    stated, expected = decide(*runs).statement, quantile_of_runs(np.array(values), 0.95, 0.9, interpretation)
    for name in ("value", "upper", "bound"):
        assert getattr(stated, name) == pytest.approx(getattr(expected, name) * 10.0**half, rel=half * 2.4)
    assert stated.independent == pytest.approx(expected.independent)
    assert stated.ensemble_share == expected.ensemble_share


@pytest.mark.parametrize(
    ("interpretation", "runs", "problem"),
    [
        ("ensemble", 1, "45 runs with different seeds are needed, and there is one."),
        ("ensemble", 4, "45 runs with different seeds are needed, and there are 4."),
        ("mixed", 1, "45 runs with different seeds are needed, and there is one."),
        ("mixed", 4, "45 runs with different seeds are needed, and there are 4."),
    ],
)
def test_too_few_runs(record, white, interpretation, runs, problem):
    values = (1e-7 * white(21, seed)[:, 0] for seed in range(runs))
    verdict = decide(*(record(value, **APE, interpretation=interpretation) for value in values))
    assert (verdict.answer, verdict.remark) == (Answer.OPEN, f"there is no bound. {problem}")


def test_five_runs_bound_by_their_mean_square(record, white):
    runs = [record(1e-8 * white(21, seed)[:, 0], **APE, interpretation="ensemble") for seed in range(5)]
    verdict = decide(*runs)
    assert (verdict.answer, verdict.statement.method) == (Answer.MET, "Markov's inequality")
    assert verdict.remark.endswith("45 runs with different seeds are needed, and there are 5.")


def test_all_runs_together_need_more_of_each(record, white):
    """A bound that holds for each of several runs needs a higher confidence in each."""
    assert confidence.share_out(0.9, 1) == 0.9
    one = decide(record(1e-7 * white(2001)[:, 0], **APE))
    two = decide(*(record(1e-7 * white(2001, seed)[:, 0], **APE) for seed in (1, 2)))
    assert two.statement.bound > one.statement.bound
    assert two.statement.ensemble_share == pytest.approx(0.1**0.5)


def test_what_is_written(record, white):
    verdict = decide(record(1e-7 * white(2001)[:, 0], settling="1 s"))
    entry = json.loads(json.dumps(plain(verdict.as_dict(), "verdict"), allow_nan=False))
    assert {"requirement": "blur", "case": "active", "signal": "plant.rotation.x"}.items() <= entry.items()
    assert {"index": "RPE", "window": 1.0, "at": "uniform", "settling": 1.0}.items() <= entry.items()
    assert (entry["limit"], entry["unit"]) == (0.5, "urad")
    assert entry["value"] == pytest.approx(0.196, rel=0.1)  # in urad
    assert entry["margin"] == pytest.approx(100.0 * (1.0 - entry["bound"] / 0.5))
    assert (entry["verdict"], entry["met"], entry["rows"]) == ("met", True, "every step")
    name, word, signal, case, value, bound, limit, margin = verdict.as_row()
    assert (name, signal, case, limit, word) == ("blur", "plant.rotation.x", "active", "0.5 urad", "met")
    assert value == f"{entry['value']:.4g}" and bound == f"{entry['bound']:.4g}"  # in the unit of the limit
    assert margin == f"{entry['margin']:.1f} %"


def test_an_open_verdict_has_no_numbers_that_json_lacks(record, white):
    entry = decide(record(1e-7 * white(301)[:, 0], **APE, interpretation="mixed")).as_dict()
    assert entry["margin"] is None and entry["met"] is False and entry["verdict"] == "cannot be said"
    assert json.loads(json.dumps(plain(entry, "verdict"), allow_nan=False))["bound"] is None


def test_the_table_counts_and_explains(require, record, white):
    verdicts = [
        decide(record(1e-7 * white(2001)[:, 0])),
        decide(record(1e-5 * white(2001)[:, 0])),
        no_run(require(case="on"), ["passive", "active"]),
    ]
    assert summarise(verdicts) == "1 of 3 are met, 1 not met, 1 cannot be said"
    assert [row[1] for row in make_table(verdicts).rows] == ["met", "NOT MET", "CANNOT BE SAID"]
    text = format_verdicts(verdicts)
    assert text.count("blur: RPE over 1 s, t uniform; 95 % quantile, temporal, 90 % confidence.") == 1
    assert "    There is no run on; there are: passive, active\n" in text  # below its verdict
    assert max(map(len, text.splitlines())) <= 100
    assert text.count("active: judged from every step.") == 1
