"""The density that Gaussian noise has, against its lines and against records of it."""

import numpy as np
import pytest
from scipy.signal import welch

from ps_fmu.disturbance.density import gaussian_density
from ps_fmu.disturbance.gaussian import GaussianNoise

BAND = np.array([0.1, 50.0])


def test_a_free_body_moves_as_much_as_by_the_lines():
    """Motion is the double integral w g: its mean square is that of the lines, since the squares of w add up to one."""
    frequency = np.arange(1, 4001) * 1e-4 + 1e-5  # to 0.4 Hz: the next lines have less than a percent of it
    band = np.array([0.1, 0.3])
    moved = np.sum(gaussian_density(band, 100.0, frequency) / frequency**4) * 1e-4
    lines = np.arange(10, 30) / 100.0
    assert moved == pytest.approx(np.sum(lines**-4.0) / 100.0, rel=1e-6)


def test_it_is_flat_within_the_band():
    frequency = np.geomspace(1.0, 49.0, 500)
    assert gaussian_density(BAND, 100.0, frequency) == pytest.approx(np.ones(500), abs=1e-2)
    inside = frequency > 25.0
    assert gaussian_density(BAND, 100.0, frequency[inside]) == pytest.approx(np.ones(inside.sum()), abs=1e-3)
    assert gaussian_density(BAND, 100.0, np.array([0.02, 55.0])) == pytest.approx(np.zeros(2), abs=1e-6)


def test_records_have_it():
    """Welch spectra of 3200 s; bands with some hundred independent values, at the edges as well."""
    noise = GaussianNoise(np.diag([1.0, 0.0, 0.0, 0.0, 0.0, 0.0]), BAND, seed=3)
    step, blocks = 5e-3, 32
    record = np.concatenate([noise(100.0 * (k + 1) + np.arange(20_000) * step)[:, 0] for k in range(blocks)])
    frequency, density = welch(record, 1.0 / step, nperseg=20_000)
    expected = np.zeros(len(density))
    expected[1:] = gaussian_density(BAND, 100.0, frequency[1:])
    for low, high in ((0.08, 0.2), (1.0, 5.0), (14.0, 21.0), (49.5, 49.8), (49.8, 50.2)):
        within = (frequency >= low) & (frequency < high)
        scatter = expected[within].mean() / np.sqrt(blocks * (high - low) * 100.0 * 0.5)
        assert density[within].mean() == pytest.approx(expected[within].mean(), abs=4.0 * scatter), low
