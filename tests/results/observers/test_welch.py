import numpy as np
import pytest
import scipy.signal
from hypothesis import given
from hypothesis import strategies as st

from ps_fmu.pointing.spectra import cumulative_rms, log_bands
from ps_fmu.results.observers.welch import Welch

NAMES = ["a.x", "b.v"]


@given(
    cuts=st.lists(st.integers(1, 999), max_size=8),
    rows=st.integers(4, 300),
    seed=st.integers(0, 2**32 - 1),
)
def test_welch_equals_scipy_for_any_cut(columns, feed, cuts, rows, seed):
    values = np.random.default_rng(seed).normal(3.0, 1.0, (1000, 4))
    observer = Welch(columns, NAMES, segment_s=rows * 0.01, step_s=0.01)
    feed(observer, values, 0.01, cuts)
    frequency, psd = scipy.signal.welch(
        values[:, [0, 3]].T, fs=100.0, nperseg=rows, detrend="constant"
    )
    np.testing.assert_allclose(observer.frequency, frequency, rtol=1e-12)
    np.testing.assert_allclose(observer.psd(), psd, rtol=1e-10, atol=1e-10 * psd.max())


def test_sine_in_white_noise(columns, feed):
    """A sine of amplitude A has mean square A^2/2 around its line; noise of variance v is flat at 2 v dt."""
    step, amplitude, variance = 1e-3, 0.5, 0.04
    time = np.arange(400_000) * step
    noise = np.random.default_rng(2).normal(0.0, np.sqrt(variance), len(time))
    values = np.zeros((len(time), 4))
    values[:, 0] = amplitude * np.sin(2.0 * np.pi * 50.0 * time)
    values[:, 3] = noise
    observer = feed(Welch(columns, NAMES, segment_s=1.0, step_s=step), values, step, range(0, 400_000, 999))
    sine, flat = observer.psd()
    line = slice(48, 53)  # the main lobe of the Hann window, bins of 1 Hz
    assert observer.frequency[sine.argmax()] == pytest.approx(50.0)
    assert sine[line].sum() * 1.0 == pytest.approx(amplitude**2 / 2.0, rel=1e-6)
    assert flat[5:-5].mean() == pytest.approx(2.0 * variance * step, rel=0.01)
    assert flat[5:-5].std() < 0.06 * flat[5:-5].mean()


def test_cumulative_rms_ends_at_the_rms(columns, feed):
    values = np.random.default_rng(3).normal(0.0, 2.0, (200_000, 4))
    observer = feed(Welch(columns, NAMES, segment_s=0.5, step_s=1e-3), values, 1e-3)
    upward = cumulative_rms(observer.frequency, observer.psd())
    np.testing.assert_allclose(upward[:, -1], values[:, [0, 3]].std(axis=0), rtol=5e-3)
    assert (np.diff(upward, axis=1) >= 0.0).all()


def test_cumulative_rms_wants_equal_spacing():
    with pytest.raises(ValueError, match="equally spaced"):
        cumulative_rms(np.array([0.0, 1.0, 3.0]), np.ones(3))
    with pytest.raises(ValueError, match="does not fit"):
        cumulative_rms(np.arange(4.0), np.ones(3))


def test_a_run_shorter_than_a_segment_is_an_error(columns, feed):
    observer = feed(Welch(columns, NAMES, segment_s=1.0, step_s=0.01), np.ones((99, 4)), 0.01)
    with pytest.raises(ValueError, match="run longer or shorten"):
        observer.psd()


def test_a_segment_of_two_steps_is_refused(columns):
    with pytest.raises(ValueError, match="four at least"):
        Welch(columns, NAMES, segment_s=0.02, step_s=0.01)


def test_bands_of_a_logarithmic_axis():
    """Few bins stay as they are, many become their mean; lines of a multisine become a density."""
    frequency = np.arange(100_001) * 0.01  # Hz
    lines = np.where((np.arange(100_001) % 20) == 10, 20.0, 0.0)  # 0.2 Hz apart: a density of 1 on average
    middle, mean = log_bands(frequency, np.array([np.ones(100_001), lines]))
    assert (middle[0], mean.shape) == (0.01, (2, len(middle)))
    np.testing.assert_allclose(mean[0], 1.0, rtol=1e-12)
    np.testing.assert_array_equal(middle[:10], frequency[1:11])
    assert (np.diff(middle) > 0.0).all()
    # 2 or 3 lines in the bands at 20 Hz, 116 in those at 1 kHz
    np.testing.assert_allclose(mean[1, (middle > 20.0) & (middle < 999.0)], 1.0, atol=0.5)
    np.testing.assert_allclose(mean[1, (middle > 500.0) & (middle < 950.0)], 1.0, atol=0.05)
