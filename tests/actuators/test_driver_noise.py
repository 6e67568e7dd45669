"""The driver's noise: a function of sample number and seed, white, with the stated density."""

import numpy as np
import pytest

from ps_fmu.actuators.driver_noise import WhiteNoise, sample_deviation
from ps_fmu.numerics.normal import Stream, make_key


def test_samples_do_not_depend_on_the_order_they_are_asked_for_in():
    whole = WhiteNoise(3, 3)(0, 2000)
    noise = WhiteNoise(3, 3)
    parts = [noise(first, 700) for first in (1400, 700, 0)]
    np.testing.assert_array_equal(np.concatenate(parts[::-1])[:2000], whole)
    np.testing.assert_array_equal(noise(511, 2), whole[511:513])
    assert np.abs(WhiteNoise(4, 3)(0, 2000) - whole).max() > 1.0


def test_white_and_of_unit_variance():
    """Variance, neighbours and channels within four deviations of what n independent samples give."""
    n = 40_000
    x = WhiteNoise(1, 3)(0, n)
    bound = 4.0 / np.sqrt(n)
    assert np.abs(x.mean(axis=0)).max() < bound
    assert np.abs((x**2).mean(axis=0) - 1.0).max() < np.sqrt(2.0) * bound
    assert np.abs((x[1:] * x[:-1]).mean(axis=0)).max() < bound
    assert np.abs((x * np.roll(x, 1, axis=1)).mean(axis=0)).max() < bound
    assert np.abs((x**4).mean(axis=0) - 3.0).max() < np.sqrt(96.0) * bound


def test_the_transform_is_that_of_box_and_muller():
    """The first half of a block has the cosines, the other one the sines."""
    sequence = np.random.SeedSequence(make_key(Stream.DRIVER, 5, 2))
    u, v = np.random.Generator(np.random.Philox(sequence)).random((2, 256, 3))
    radius = np.sqrt(-2.0 * np.log1p(-u))
    expected = np.concatenate([radius * np.cos(2.0 * np.pi * v), radius * np.sin(2.0 * np.pi * v)])
    np.testing.assert_allclose(WhiteNoise(5, 3)(1024, 512), expected, rtol=0.0, atol=1e-13)


def test_density():
    """White up to half the rate: density squared times band is the variance."""
    assert sample_deviation(2.0, 1e-4) ** 2 == pytest.approx(2.0**2 * 5000.0)
