"""The pointing error indices that every run computes while it goes."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ps_fmu.pointing import quantile
from ps_fmu.pointing.confidence import weigh_share
from ps_fmu.pointing.indices import AbsoluteError, DriftError, MeanError, RelativeError
from ps_fmu.requirements.distribution import BINS_PER_DECADE
from ps_fmu.runs import index_record
from ps_fmu.runs.index_record import CONFIDENCE, PROBABILITIES, SIGNALS, IndexLog, IndexRecord

ROUNDING = 10.0 ** (1.0 / BINS_PER_DECADE) - 1.0  # of the histogram


@dataclass(frozen=True)
class Column:
    name: str
    unit: str


COLUMNS = [Column("a.x", "rad"), Column("b.y", "m"), Column("b.v", "m/s")]
NAMES = ["a.x", "b.v"]


def observe(observer, values, step, cuts=()):
    first = 0
    for block in np.split(values, sorted(cuts)):
        if len(block):
            observer.block(first, (first + np.arange(len(block))) * step, block)
        first += len(block)
    return {one.index.symbol: one for one in observer.result()}


def direct(values, rows):
    """The definitions, written out window by window."""
    windows = [values[k : k + rows] for k in range(0, len(values) - rows + 1, rows)]
    means = np.array([window.mean(axis=0) for window in windows])
    relative = np.concatenate([window - window.mean(axis=0) for window in windows])
    drift = np.array([later - earlier for earlier, later in pairwise(means)])
    return {"APE": values, "MPE": means, "RPE": relative, "PDE": drift}


@pytest.mark.parametrize("batch", [1, 70, 10_000])
@given(cuts=st.lists(st.integers(1, 299), max_size=8), rows=st.integers(2, 60), seed=st.integers(0, 2**32 - 1))
def test_indices_equal_their_definition_for_any_cut(batch, cuts, rows, seed):
    values = np.random.default_rng(seed).normal(0.5, 1.0, (300, 3)).cumsum(axis=0) * 1e-6
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(index_record, "BATCH_ROWS", batch)
        found = observe(IndexRecord(COLUMNS, NAMES, step_s=0.1, rows=300, window_s=rows * 0.1), values, 0.1, cuts)
    for symbol, error in direct(values[:, [0, 2]], rows).items():
        seen = found[symbol]
        assert seen.count == len(error)
        np.testing.assert_allclose(seen.bias, error.mean(axis=0), rtol=1e-9, atol=1e-18, err_msg=symbol)
        np.testing.assert_allclose(seen.rms, np.sqrt((error**2).mean(axis=0)), rtol=1e-11, err_msg=symbol)
        np.testing.assert_allclose(seen.peak, np.abs(error).max(axis=0), rtol=1e-11, err_msg=symbol)
        for place, statements in enumerate(seen.quantiles):
            for stated, probability in zip(statements, PROBABILITIES, strict=True):
                exact = np.quantile(np.abs(error[:, place]), probability, method="inverted_cdf")
                assert exact * (1.0 - 1e-12) <= stated.value <= exact * (1.0 + ROUNDING) + 1e-12


def test_quantiles_are_stated_as_the_library_does(monkeypatch):
    """While all values are kept, value, bounds and independent samples are those of order statistics."""
    monkeypatch.setattr(index_record, "KEPT", 10_000)
    values = np.convolve(np.random.default_rng(2).normal(0.0, 1e-6, 10_029), np.ones(30), "valid")[:, None]
    record = IndexRecord(COLUMNS[:1], ["a.x"], step_s=0.01, rows=10_000)
    stated = observe(record, values, 0.01)["APE"].quantiles[0]
    magnitude = np.abs(values[:, 0])
    for one, probability in zip(stated, PROBABILITIES, strict=True):
        independent = weigh_share(magnitude, probability).count_ranks(CONFIDENCE)
        expected = quantile(magnitude, probability, CONFIDENCE, independent=independent)
        assert one.independent == pytest.approx(independent, rel=1e-9, abs=0.0)
        assert one.value == pytest.approx(expected.value, rel=ROUNDING, abs=0.0)
        if np.isfinite(expected.bound):
            assert one.bound == pytest.approx(expected.bound, rel=ROUNDING, abs=0.0)
    assert np.isfinite(stated[0].bound)
    assert 200.0 < stated[0].independent < 2000.0  # 10 000 samples with a correlation over 30


def test_the_library_has_the_same_from_the_record():
    values = np.random.default_rng(9).normal(0.3, 1.0, (2000, 3))
    found = observe(IndexRecord(COLUMNS, NAMES, step_s=0.01, rows=2000), values, 0.01, [7, 500])
    for index in (AbsoluteError(), MeanError(1.0), RelativeError(1.0, "uniform"), DriftError(1.0, 1.0)):
        expected = index.of_record(values[:, [0, 2]], 0.01, stride=index.symbol == "APE" or 100)
        seen = found[index.symbol]
        assert seen.index == index
        np.testing.assert_allclose(seen.rms, expected.rms, rtol=1e-12)
        np.testing.assert_allclose(seen.bias, expected.bias, rtol=1e-9, atol=1e-15)
        np.testing.assert_allclose(seen.peak, expected.peak, rtol=1e-12)


def test_a_ramp_drifts_and_a_fast_sine_does_not():
    """A ramp of 2 per second: means of 1 s windows drift by 2; a sine of whole periods has mean zero."""
    time = np.arange(1000) * 0.01
    values = np.column_stack([2.0 * time, time, np.sin(2.0 * np.pi * 10.0 * time)])
    found = observe(IndexRecord(COLUMNS, NAMES, step_s=0.01, rows=1000), values, 0.01)
    np.testing.assert_allclose(found["PDE"].peak, [2.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(found["MPE"].peak[1], 0.0, atol=1e-13)
    np.testing.assert_allclose(found["RPE"].rms[1], np.sqrt(0.5), rtol=1e-12)


@pytest.mark.parametrize(
    ("rows", "symbols"), [(9, ["APE"]), (15, ["APE", "MPE", "RPE"]), (20, ["APE", "MPE", "RPE", "PDE"])]
)
def test_a_short_run_has_fewer_indices(rows, symbols):
    found = observe(IndexRecord(COLUMNS, NAMES, step_s=0.1, rows=rows), np.ones((rows, 3)), 0.1)
    assert list(found) == symbols
    assert found["APE"].count == rows


def test_a_window_of_one_step_and_a_run_without_rows():
    found = observe(IndexRecord(COLUMNS, NAMES, step_s=1.0, rows=5), np.ones((5, 3)), 1.0)
    assert list(found) == ["APE"]
    assert IndexRecord(COLUMNS, NAMES, step_s=1.0, rows=5).result() == ()


def test_the_indices_of_all_runs_of_a_scenario():
    """By run, signal and index; rows of a lead-in are left out, row 0 with them."""
    columns = [Column("other", "1"), *(Column(name, "rad") for name in SIGNALS)]
    values = np.random.default_rng(3).normal(0.0, 1e-6, (501, len(columns)))
    log = IndexLog()
    for case, lead in (("passive", 0), ("active", 200)):
        (observer,) = log.observe(case, columns, 1e-2, 500, lead)
        observer.block(0, np.arange(501) * 1e-2, values)
    found = log.as_dict()
    assert list(found) == ["passive", "active"]
    assert list(found["passive"]) == list(SIGNALS)
    whole, later = (found[case][SIGNALS[1]] for case in found)
    assert whole["unit"] == "rad"
    assert (whole["APE"]["values"], later["APE"]["values"]) == (501, 300)
    assert later["APE"]["rms"] == pytest.approx(np.sqrt((values[201:, 2] ** 2).mean()), rel=1e-12, abs=0.0)
    assert (later["MPE"]["values"], later["RPE"]["at"], later["PDE"]["separation"]) == (3, "uniform", 1.0)
    assert [one["probability"] for one in later["RPE"]["quantiles"]] == list(PROBABILITIES)
    assert log.of("active").of("MPE").count == 3
    assert log.of("active").of("jitter") is None
    with pytest.raises(KeyError):
        log.of("idle")


def test_a_system_without_the_signals_has_no_indices():
    log = IndexLog()
    assert log.observe("run", COLUMNS, 0.1, 10) == []
    assert log.as_dict() == {}
