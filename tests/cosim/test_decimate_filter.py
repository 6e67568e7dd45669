"""The filter before thinning is the textbook's."""

import numpy as np
import pytest
from scipy.signal import firwin, freqz, kaiser_beta

from ps_fmu.cosim.decimate import HALF_LENGTH, PASS_BAND, STOP_BAND_DB, _design_filter


@pytest.mark.parametrize("factor", [2, 5, 10])
def test_it_is_scipys_kaiser_window(factor):
    half = HALF_LENGTH * factor
    theirs = firwin(2 * half + 1, 0.5 * (PASS_BAND + 1.0) / factor, window=("kaiser", kaiser_beta(STOP_BAND_DB)))
    np.testing.assert_allclose(_design_filter(factor, half), theirs, rtol=1e-9, atol=1e-15)


def test_it_stops_what_would_fold_and_passes_the_rest():
    factor = 10
    frequency, response = freqz(_design_filter(factor, HALF_LENGTH * factor), worN=4096, fs=1.0)
    new_rate = 1.0 / factor
    assert np.abs(response[frequency > 0.5 * new_rate]).max() < 10.0 ** (-STOP_BAND_DB / 20.0) * 1.1
    assert np.abs(np.abs(response[frequency < 0.5 * PASS_BAND * new_rate]) - 1.0).max() < 2e-4
