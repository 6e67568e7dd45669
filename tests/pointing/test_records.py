"""Indices of records: exact for sines over whole periods, within the scatter of samples for noise."""

import math

import numpy as np
import pytest
from scipy.signal import lfilter
from support.claims import verify_claim

from ps_fmu.pointing import (
    AbsoluteError,
    DriftError,
    LinearProcess,
    MeanError,
    RelativeError,
    ResidualJitter,
    Smear,
    effective_samples,
)

STEP = 0.01  # s
WINDOW = 0.5  # s
INDICES = (
    AbsoluteError(),
    MeanError(WINDOW),
    RelativeError(WINDOW, "uniform"),
    RelativeError(WINDOW, "end"),
    DriftError(WINDOW, 1.3),
    Smear(WINDOW),
    ResidualJitter(WINDOW),
)
BIAS = np.array([3.0, -20.0])


def identity(index):
    return f"{index.symbol} {getattr(index, 'at', '')}"


@pytest.mark.parametrize("index", INDICES, ids=identity)
def test_sines(index):
    """Windows that start at every sample of whole periods: the weight of the line, to rounding, and the bias apart."""
    period = 77  # samples
    phase = 2.0 * np.pi * np.arange(5 * period + index.count(STEP) - 1) / period
    record = BIAS + np.stack([2.0 * np.sin(phase), 0.5 * np.cos(phase)], axis=1)
    found = index.of_record(record, STEP, stride=1)
    expected = index.variance_of_lines([1.0 / (period * STEP)], [[2.0, 0.5]], step=STEP)
    assert found.windows == 5 * period
    verify_claim(
        "index.of_sines",
        claim="RMS of APE, MPE, RPE (t uniform and at the end), PDE, smear and jitter of a record",
        where="`ps-fmu judge`, `run`, `sweep`, `ps_fmu.pointing`",
        reference="closed form of the weight of a sine in each index, over whole periods",
        error=np.abs(found.variance / expected - 1.0),
        bound=1e-9,
    )
    assert found.covariance[0, 1] == pytest.approx(0.0, abs=1e-12)  # sine and cosine
    kept = BIAS if index.keeps_bias else 0.0 * BIAS
    assert found.bias == pytest.approx(kept, abs=1e-12)
    assert found.rms == pytest.approx(np.sqrt(kept**2 + expected), rel=1e-9)
    assert (found.peak <= np.abs(kept) + 2.0 * np.sqrt(2.0 * index.weight(1.0 / (period * STEP), STEP)) * 2.0).all()


@pytest.fixture(scope="module")
def coloured():
    """2e5 samples of noise through a resonance, and the process that it is."""
    a, b = [1.0, -1.8, 0.85], 1.0
    record = lfilter([b], a, np.random.default_rng(7).normal(size=201_000))[1000:]
    A = np.array([[1.8, -0.85], [1.0, 0.0]])
    return record, LinearProcess(A, np.array([[1.0, 0.0]]), np.diag([b**2, 0.0]), STEP)


@pytest.mark.parametrize("index", INDICES, ids=identity)
@pytest.mark.parametrize("stride", [None, 10])
def test_coloured_noise_within_the_scatter_of_samples(coloured, index, stride):
    record, process = coloured
    found = index.of_record(record, STEP, stride=stride)
    squares = (index.values(record, STEP, stride=stride) ** 2).mean(axis=(1, 2))
    scatter = math.sqrt(squares.var() / effective_samples(squares))
    expected = process.variance(index)[0]
    verify_claim(
        "index.of_coloured_noise",
        claim="RMS of the seven indices of a record of noise",
        where="`ps-fmu judge`, `run`, `sweep`, `ps_fmu.pointing`",
        reference="closed form of the covariance of a resonance driven by white noise",
        error=abs(found.variance[0] - expected) / scatter,
        bound=3.0,
        unit="standard deviations of the record",
    )
    assert scatter < 0.1 * expected


def test_values_are_those_of_the_definitions():
    record = np.random.default_rng(5).normal(size=(130, 2)) + BIAS
    first = record[:50]
    time = np.arange(50) * STEP
    slope, offset = np.polyfit(time, first, 1)
    line = np.outer(time, slope) + offset
    mean = first.mean(axis=0)

    truths = [
        (AbsoluteError(), record[:1]),
        (MeanError(WINDOW), mean[None]),
        (RelativeError(WINDOW, "uniform"), first - mean),
        (RelativeError(WINDOW, "end"), first[-1:] - mean),
        (DriftError(WINDOW, 0.8), (record[80:].mean(axis=0) - mean)[None]),
        (DriftError(WINDOW, 0.2), (record[20:70].mean(axis=0) - mean)[None]),
        (Smear(WINDOW), (slope * time.std())[None]),
        (ResidualJitter(WINDOW), first - line),
    ]
    errors = []
    for index, truth in truths:
        found = index.values(record, STEP)[0]
        assert found.shape == truth.shape
        errors.append(np.abs(found - truth).max() / np.abs(truth).max())
    verify_claim(
        "index.definitions",
        claim="The values of APE, MPE, RPE, PDE, smear and jitter",
        where="`ps-fmu judge`, `run`, `sweep`, `ps_fmu.pointing`",
        reference="formulas of ECSS-E-ST-60-10C and a straight line by numpy's polyfit, written out for one window",
        error=max(errors),
        bound=1e-10,
    )


def test_windows_side_by_side_and_sliding():
    record = np.arange(25.0)
    mean = MeanError(4.0)
    assert mean.values(record, 1.0)[:, 0, 0] == pytest.approx([1.5, 5.5, 9.5, 13.5, 17.5, 21.5])
    assert mean.values(record, 1.0, stride=1)[:, 0, 0] == pytest.approx(np.arange(22) + 1.5)
    assert DriftError(4.0, 10.0).values(record, 1.0, stride=1)[:, 0, 0] == pytest.approx(np.full(12, 10.0))


def test_a_small_jitter_beside_a_large_bias():
    noise = np.random.default_rng(6).normal(size=10_000)
    index = AbsoluteError()
    with_bias, without = index.of_record(1e6 + 1e-3 * noise, STEP), index.of_record(1e-3 * noise, STEP)
    assert with_bias.std == pytest.approx(without.std, rel=1e-6)
    assert with_bias.bias == pytest.approx(1e6 + without.bias, rel=1e-12)


def test_long_records_are_taken_in_blocks():
    """More windows than a block holds."""
    record = np.random.default_rng(8).normal(size=50_000)
    index = RelativeError(1.0, "uniform")
    windows = np.lib.stride_tricks.sliding_window_view(record, 100)
    expected = windows.var(axis=1).mean()
    assert index.of_record(record, STEP, stride=1).variance[0] == pytest.approx(expected, rel=1e-9)
    rising = MeanError(1.0).of_record(record + np.arange(50_000.0), STEP, stride=1)
    means = (windows.mean(axis=1) + np.arange(len(windows))) + 49.5
    assert rising.variance[0] == pytest.approx(means.var(), rel=1e-9)
    assert rising.bias[0] == pytest.approx(means.mean(), rel=1e-9)


def test_records_that_do_not_fit():
    index = MeanError(WINDOW)
    with pytest.raises(ValueError, match="49 samples, and a window needs 50"):
        index.of_record(np.zeros(49), STEP)
    with pytest.raises(ValueError, match="stride"):
        index.of_record(np.zeros(60), STEP, stride=0)
    with pytest.raises(ValueError, match="shape"):
        index.of_record(np.zeros((60, 2, 2)), STEP)
    with pytest.raises(ValueError, match="not finite"):
        index.of_record(np.full(60, np.nan), STEP)
