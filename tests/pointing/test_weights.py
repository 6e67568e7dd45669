"""Weights of the indices: bounds, identities and limits, with time continuous and with samples."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.polynomial import Polynomial

from ps_fmu.pointing import (
    AbsoluteError,
    DriftError,
    MeanError,
    RelativeError,
    ReproducibilityError,
    ResidualJitter,
    Smear,
)

CYCLES = st.floats(0.0, 1e4)  # of a line in the window, f T
WINDOWS = st.floats(1e-3, 1e3)  # s
SAMPLES = st.integers(1, 500)
PARTS = st.floats(0.0, 1.0)  # of half the sampling rate


def weights(frequency, window, step=None):
    """APE, MPE, RPE uniform, smear, jitter."""
    indices = (
        AbsoluteError(),
        MeanError(window),
        RelativeError(window, "uniform"),
        Smear(window),
        ResidualJitter(window),
    )
    return [index.weight(frequency, step) for index in indices]


@given(CYCLES, WINDOWS)
def test_shares_of_a_line_are_positive_and_add_up(cycles, window):
    absolute, mean, relative, smear, jitter = weights(cycles / window, window)
    assert absolute == 1.0
    assert min(mean, relative, smear, jitter) >= 0.0
    assert mean + relative == pytest.approx(absolute, abs=1e-14)
    assert relative - smear == pytest.approx(jitter, abs=1e-14)


@given(PARTS, SAMPLES, st.floats(1e-4, 10.0))
def test_shares_of_a_sampled_line_are_positive_and_add_up(part, samples, step):
    absolute, mean, relative, smear, jitter = weights(part * 0.5 / step, samples * step, step)
    assert absolute == 1.0
    assert min(mean, relative, smear, jitter) >= 0.0
    assert mean + relative == pytest.approx(absolute, abs=1e-14)
    assert relative - smear == pytest.approx(jitter, abs=1e-14)


@given(CYCLES, WINDOWS, WINDOWS)
def test_weights_of_differences_stay_below_their_bounds(cycles, window, separation):
    frequency = cycles / window
    assert 0.0 <= RelativeError(window, "end").weight(frequency) < 1.59
    assert 0.0 <= DriftError(window, separation).weight(frequency) <= 4.0 * MeanError(window).weight(frequency)


@given(PARTS, st.integers(1, 60), st.integers(1, 150), st.floats(1e-4, 10.0))
def test_the_lag_weights_are_those_of_the_spectrum(part, samples, apart, step):
    """W(f) = sum_m q_m cos(2 pi f m dt)."""
    window, frequency = samples * step, part * 0.5 / step
    for index in (
        AbsoluteError(),
        MeanError(window),
        RelativeError(window, "uniform"),
        RelativeError(window, "end"),
        DriftError(window, apart * step),
        Smear(window),
        ResidualJitter(window),
    ):
        lags = np.arange(-index.count(step), index.count(step) + 1)
        expected = index.lag_weights(lags, step) @ np.cos(2.0 * np.pi * frequency * step * lags)
        assert index.weight(frequency, step) == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize(
    ("index", "at_zero", "at_infinity"),
    [
        (AbsoluteError(), 1.0, 1.0),
        (MeanError(2.0), 1.0, 0.0),
        (RelativeError(2.0, "uniform"), 0.0, 1.0),
        (RelativeError(2.0, "end"), 0.0, 1.0),
        (Smear(2.0), 0.0, 0.0),
        (ResidualJitter(2.0), 0.0, 1.0),
    ],
)
def test_slow_and_fast_lines(index, at_zero, at_infinity):
    assert index.weight(0.0) == at_zero
    assert index.weight(1e9 / 3.0) == pytest.approx(at_infinity, abs=1e-8)


def test_slow_lines_by_their_leading_terms():
    """A parabola is what jitter sees of them: f^4, where a plain difference of shares has no digit left."""
    u = np.array([1e-6, 1e-3, 1e-2])
    frequency = u / np.pi
    assert RelativeError(1.0, "uniform").weight(frequency) == pytest.approx(u**2 / 3.0, rel=1e-4)
    assert RelativeError(1.0, "end").weight(frequency) == pytest.approx(u**2, rel=1e-4)
    assert Smear(1.0).weight(frequency) == pytest.approx(u**2 / 3.0, rel=1e-4)
    assert ResidualJitter(1.0).weight(frequency) == pytest.approx(u**4 / 45.0, rel=1e-4)


@pytest.mark.parametrize("step", [None, 0.5, 1.0 / 7.0, 0.001])
def test_series_and_formula_meet(step):
    below, above = (np.nextafter(0.5, direction) / np.pi for direction in (0.0, 1.0))
    for index in (MeanError(1.0), Smear(1.0), ResidualJitter(1.0)):
        assert index.weight(below, step) == pytest.approx(index.weight(above, step), rel=1e-10, abs=1e-15)


def test_many_samples_are_continuous():
    frequency = np.linspace(0.0, 20.0, 201)
    for index in (MeanError(1.0), RelativeError(1.0, "end"), DriftError(1.0, 2.5), Smear(1.0), ResidualJitter(1.0)):
        coarse, fine = (np.abs(index.weight(frequency, step) - index.weight(frequency)).max() for step in (1e-2, 1e-5))
        assert fine < 1e-2 * coarse


def test_drift_and_reproducibility_are_one_formula():
    """ECSS-E-ST-60-10C, 3.2.10, note 5."""
    frequency = np.linspace(0.0, 5.0, 101)
    drift, again = DriftError(1.0, 7.0), ReproducibilityError(1.0, 7.0)
    assert np.array_equal(drift.weight(frequency), again.weight(frequency))
    assert (drift.symbol, again.symbol) == ("PDE", "PRE")
    # Half a period apart, a line much slower than the window doubles.
    assert DriftError(1e-3, 5.0).weight(0.1) == pytest.approx(4.0, rel=1e-6)


def test_t_at_the_end_sees_more_of_slow_errors():
    uniform, end = RelativeError(1.0, "uniform"), RelativeError(1.0, "end")
    assert end.weight(1e-3) / uniform.weight(1e-3) == pytest.approx(3.0, rel=1e-4)
    assert end.weight(1e3) / uniform.weight(1e3) == pytest.approx(1.0, rel=1e-3)


def test_the_trend_is_that_of_a_least_squares_fit():
    """Numpy fits the line to cosine and sine at many places of the window."""
    place = np.linspace(-0.5, 0.5, 20001)
    for frequency in (0.3, 1.0, 1.7):
        found = 0.0
        for wave in (np.cos, np.sin):
            slope = Polynomial.fit(place, wave(2.0 * np.pi * frequency * place), 1, domain=[-0.5, 0.5]).coef[1]
            found += 2.0 * (2.0 * slope) ** 2 / 12.0 / 2.0  # fit's domain is -1 to 1: slope per half window
        assert Smear(1.0).weight(frequency) == pytest.approx(found, rel=1e-3)


def test_the_length_of_a_smear():
    """A ramp of 3 units over 2 s, continuous and in 20 samples."""
    record = 1.5 * 0.1 * np.arange(20)
    assert Smear(2.0).length(3.0 / math.sqrt(12.0)) == pytest.approx(3.0)
    assert Smear(2.0).length(Smear(2.0).of_record(record, 0.1).rms, 0.1) == pytest.approx([3.0])


@pytest.mark.parametrize("window", [0.0, -1.0, math.nan, math.inf])
def test_windows_that_are_none(window):
    with pytest.raises(ValueError, match="window: expected a time above 0 s"):
        MeanError(window)
    with pytest.raises(ValueError, match="separation: expected a time above 0 s"):
        DriftError(1.0, window)


def test_what_does_not_fit_is_refused():
    with pytest.raises(ValueError, match="at: expected 'uniform' or 'end'"):
        RelativeError(1.0, "middle")
    with pytest.raises(ValueError, match="0 Hz and above"):
        MeanError(1.0).weight(-1.0)
    with pytest.raises(ValueError, match=r"0\.6 Hz is above half the rate of steps of 1 s"):
        MeanError(2.0).weight(0.6, 1.0)
    with pytest.raises(ValueError, match="not a whole number of steps"):
        MeanError(2.5).weight(0.1, 1.0)
    with pytest.raises(ValueError, match=r"separation: 2\.5 s is not a whole number"):
        DriftError(2.0, 2.5).weight(0.1, 1.0)
