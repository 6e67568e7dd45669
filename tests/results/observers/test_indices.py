import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ps_fmu.results.observers.indices import PerformanceIndices

NAMES = ["a.x", "b.v"]


def direct(values, rows, lag):
    """The definitions, written out window by window."""
    windows = [values[k : k + rows] for k in range(0, len(values) - rows + 1, rows)]
    means = np.array([window.mean(axis=0) for window in windows])
    relative = np.concatenate([window - window.mean(axis=0) for window in windows])
    drift = np.array([later - earlier for earlier, later in zip(means, means[lag:], strict=False)])
    found = {}
    for name, error in (("ape", values), ("mpe", means), ("rpe", relative), ("pde", drift)):
        found[f"{name}_peak"] = np.abs(error).max(axis=0)
        found[f"{name}_rms"] = np.sqrt((error**2).mean(axis=0))
    return found


@given(
    cuts=st.lists(st.integers(1, 299), max_size=8),
    rows=st.integers(2, 60),
    lag=st.integers(1, 3),
    seed=st.integers(0, 2**32 - 1),
)
def test_indices_equal_their_definition_for_any_cut(columns, feed, cuts, rows, lag, seed):
    values = np.random.default_rng(seed).normal(0.5, 1.0, (300, 4)).cumsum(axis=0)
    observer = PerformanceIndices(columns, NAMES, window_s=rows * 0.1, step_s=0.1, drift_windows=lag)
    result = feed(observer, values, 0.1, cuts).result()
    assert result.windows == 300 // rows
    assert result.drift_s == pytest.approx(lag * rows * 0.1)
    for name, expected in direct(values[:, [0, 3]], rows, lag).items():
        np.testing.assert_allclose(getattr(result, name), expected, rtol=1e-11, err_msg=name)


def test_a_ramp_drifts_and_a_fast_sine_does_not(columns, feed):
    """A ramp of 2 per second: means of 1 s windows drift by 2; a sine of whole periods has mean zero."""
    time = np.arange(1000) * 0.01
    values = np.zeros((1000, 4))
    values[:, 0] = 2.0 * time
    values[:, 3] = np.sin(2.0 * np.pi * 10.0 * time)
    result = feed(PerformanceIndices(columns, NAMES, window_s=1.0, step_s=0.01), values, 0.01).result()
    np.testing.assert_allclose(result.pde_peak, [2.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(result.mpe_peak[1], 0.0, atol=1e-13)
    np.testing.assert_allclose(result.rpe_rms[1], np.sqrt(0.5), rtol=1e-12)


def test_one_window_has_no_drift(columns, feed):
    observer = PerformanceIndices(columns, NAMES, window_s=1.0, step_s=0.1)
    result = feed(observer, np.ones((15, 4)), 0.1).result()
    assert result.windows == 1
    assert np.isnan(result.pde_peak).all()


def test_a_run_shorter_than_a_window_is_an_error(columns, feed):
    observer = PerformanceIndices(columns, NAMES, window_s=1.0, step_s=0.1)
    with pytest.raises(ValueError, match="shorter than one window"):
        feed(observer, np.ones((9, 4)), 0.1).result()


@pytest.mark.parametrize(("window", "lag"), [(0.1, 1), (0.25, 1), (-1.0, 1), (1.0, 0)])
def test_impossible_windows_are_refused(columns, window, lag):
    with pytest.raises(ValueError, match="window"):
        PerformanceIndices(columns, NAMES, window_s=window, step_s=0.1, drift_windows=lag)
