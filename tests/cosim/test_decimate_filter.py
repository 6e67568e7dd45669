"""The filters before thinning are the textbook's, and all stages together keep what one of them promises."""

import numpy as np
import pytest
from scipy.signal import firwin, freqz, kaiser_beta

from ps_fmu.cosim.recording.decimate import (
    EARLY_STOP_BAND_DB,
    HALF_LENGTH,
    PASS_BAND,
    STOP_BAND_DB,
    Decimator,
    _design_filter,
)


@pytest.mark.parametrize("factor", [2, 5, 10])
def test_the_last_stage_is_scipys_kaiser_window(factor):
    half = HALF_LENGTH * factor
    theirs = firwin(2 * half + 1, 0.5 * (PASS_BAND + 1.0) / factor, window=("kaiser", kaiser_beta(STOP_BAND_DB)))
    np.testing.assert_allclose(_design_filter(factor, 1).taps, theirs, rtol=1e-9, atol=1e-15)


@pytest.mark.parametrize(("factor", "later"), [(10, 1), (50, 2), (25, 4), (200, 5)])
def test_a_stage_stops_what_would_be_folded_into_the_band(factor, later):
    taps = _design_filter(factor, later).taps
    frequency, response = freqz(taps, worN=1 << 16, fs=1.0)
    nyquist = 0.5 / (factor * later)  # the final one
    folded = np.abs(frequency - np.rint(frequency * factor) / factor)  # where a frequency comes out
    stopped = (folded < nyquist) & (frequency > 0.5 / factor)
    attenuation = EARLY_STOP_BAND_DB if later > 1 else STOP_BAND_DB
    assert np.abs(response[stopped]).max() < 10.0 ** (-attenuation / 20.0) * 1.15
    ripple = 3e-5 if later > 1 else 2e-4
    assert np.abs(np.abs(response[frequency < PASS_BAND * nyquist]) - 1.0).max() < ripple


@pytest.mark.parametrize("factor", [10, 100, 1000])
def test_sines_pass_or_are_stopped(factor):
    rows = np.arange(400 * factor)
    kept, stopped = np.array([0.05, 0.2, 0.4]), np.array([0.55, 0.9, 1.3, 7.7, 12.05])  # cycles per stored row
    sines = np.sin(2.0 * np.pi * np.outer(rows, np.concatenate([kept, stopped])) / factor + 0.3)
    decimator = Decimator(factor, np.ones(sines.shape[1], dtype=bool))
    found = np.concatenate([decimator.push(sines), decimator.finish()])[60:-60]
    expected = sines[::factor][60:-60, : kept.size]
    np.testing.assert_allclose(found[:, : kept.size], expected, rtol=0.0, atol=2e-4)
    assert np.abs(found[:, kept.size :]).max() < 2e-4
