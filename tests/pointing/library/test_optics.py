"""Transfer functions and encircled energy under jitter, against closed forms and drawn images."""

import math

import numpy as np
import pytest
from scipy.special import erf, j0, j1, jn_zeros
from support.claims import verify_claim

from ps_fmu.pointing import ResidualJitter
from ps_fmu.pointing.library.optics import (
    aperture_mtf,
    encircled_energy,
    jitter_encircled_energy,
    jitter_mtf,
    jitter_otf,
)

WAVELENGTH, DIAMETER = 1.064e-6, 0.1  # m
SIGMA = 3e-6  # rad
COVARIANCE = np.array([[9.0, 3.0], [3.0, 4.0]]) * 1e-12  # rad2
AIRY = jn_zeros(1, 1)[0] / math.pi * WAVELENGTH / DIAMETER  # rad, the first dark ring


def test_the_transfer_function_is_that_of_the_motion():
    """The mean of exp(2 pi i (u x + v y)) over 4e5 places of the line of sight."""
    places = np.random.default_rng(1).multivariate_normal([0.0, 0.0], COVARIANCE, 400_000)
    frequencies = ((5e4, 0.0), (0.0, 8e4), (4e4, 4e4), (4e4, -4e4))
    found = [np.exp(2j * np.pi * places @ at).mean().real for at in frequencies]
    verify_claim(
        "index.transfer_function",
        claim="Optical transfer function of jitter",
        where="`ps_fmu.pointing`: jitter_otf, jitter_mtf",
        reference="mean of exp(2 pi i (u x + v y)) over 400,000 drawn places",
        error=np.abs([jitter_otf(u, v, COVARIANCE) for u, v in frequencies] - np.array(found)),
        bound=5e-3,
        unit="absolute",
    )
    assert jitter_otf(4e4, 4e4, COVARIANCE) < 0.8 * jitter_otf(4e4, -4e4, COVARIANCE)  # the correlation


def test_pi_is_squared():
    assert jitter_otf(1e5, 0.0, np.eye(2) * SIGMA**2) == pytest.approx(math.exp(-2.0 * (math.pi * 1e5 * SIGMA) ** 2))
    assert jitter_otf(0.0, 0.0, COVARIANCE) == 1.0


def test_the_modulation_along_a_direction():
    frequency = np.linspace(0.0, 1e5, 5)
    assert jitter_mtf(frequency, COVARIANCE) == pytest.approx(jitter_otf(frequency, 0.0, COVARIANCE))
    diagonal = jitter_otf(frequency * math.sqrt(0.5), frequency * math.sqrt(0.5), COVARIANCE)
    assert jitter_mtf(frequency, COVARIANCE, math.pi / 4.0) == pytest.approx(diagonal)


def test_a_spectrum_becomes_a_transfer_function():
    """From the density of the line of sight over an exposure of 0.1 s: 0.5 urad2/Hz about one axis, up to 200 Hz."""
    matrix = np.tile(np.diag([0.5e-12, 0.0]), (2, 1, 1))
    covariance = ResidualJitter(0.1).variance([0.0, 200.0], matrix)
    # White noise: all of it but what mean and trend take, (1 - 2/(2 F T)) for F T >> 1.
    assert covariance[0, 0] == pytest.approx(0.5e-12 * (200.0 - 10.0), rel=0.005)
    assert jitter_mtf(3e4, covariance) == pytest.approx(math.exp(-2.0 * math.pi**2 * 9e8 * covariance[0, 0]))
    assert jitter_mtf(3e4, covariance, math.pi / 2.0) == pytest.approx(1.0)


def test_energy_of_equal_axes():
    radius = np.linspace(0.0, 4.0, 9) * SIGMA
    expected = 1.0 - np.exp(-0.5 * (radius / SIGMA) ** 2)
    assert jitter_encircled_energy(radius, np.eye(2) * SIGMA**2) == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("ratio", [1.0, 0.5, 0.1, 0.01])
def test_energy_of_unequal_axes(ratio):
    """An integral over one axis of the error function of the other."""
    place = np.linspace(-np.pi / 2.0, np.pi / 2.0, 200_001)
    for radius in (0.3, 1.0, 2.5):
        across = erf(radius * np.cos(place) / (math.sqrt(2.0) * ratio))
        along = np.exp(-0.5 * (radius * np.sin(place)) ** 2) / math.sqrt(2.0 * np.pi) * radius * np.cos(place)
        expected = np.trapezoid(across * along, place)
        turned = np.array([[0.8, -0.6], [0.6, 0.8]])
        covariance = turned @ np.diag([1.0, ratio**2]) @ turned.T
        assert jitter_encircled_energy(radius, covariance) == pytest.approx(expected, abs=1e-8)


def test_energy_of_motion_along_a_line():
    radius = np.array([0.5, 1.0, 2.0])
    assert jitter_encircled_energy(radius, np.diag([1.0, 0.0])) == pytest.approx(erf(radius / math.sqrt(2.0)), abs=1e-4)
    assert jitter_encircled_energy(radius, np.zeros((2, 2))) == pytest.approx(1.0)


def test_the_airy_pattern():
    """Lord Rayleigh: 1 - J0^2 - J1^2; 83.8 % within the first dark ring."""
    radius = np.linspace(0.0, 30.0, 61) * AIRY
    x = np.pi * radius * DIAMETER / WAVELENGTH
    found = encircled_energy(radius, np.zeros((2, 2)), WAVELENGTH, DIAMETER)
    assert found == pytest.approx(1.0 - j0(x) ** 2 - j1(x) ** 2, abs=1e-10)
    assert encircled_energy(AIRY, np.zeros((2, 2)), WAVELENGTH, DIAMETER) == pytest.approx(0.838, abs=5e-4)


def test_jitter_much_wider_than_the_aperture_blurs():
    """A telescope of 100 m adds next to nothing to 3 urad and 2 urad."""
    radius = np.array([1e-6, 3e-6, 6e-6])
    found = encircled_energy(radius, COVARIANCE, WAVELENGTH, 100.0)
    assert found == pytest.approx(jitter_encircled_energy(radius, COVARIANCE), abs=5e-3)


def test_energy_of_aperture_and_jitter_together():
    """Airy's pattern, moved to drawn places, and averaged."""
    places = np.random.default_rng(2).multivariate_normal([0.0, 0.0], COVARIANCE, 2000)
    edge = np.linspace(-60e-6, 60e-6, 601)
    x, y = np.meshgrid(edge, edge)
    inside = np.hypot(x, y) < AIRY
    distance = np.hypot(x[inside], y[inside])
    total = 0.0
    for dx, dy in places:
        argument = np.pi * DIAMETER / WAVELENGTH * np.hypot(x[inside] - dx, y[inside] - dy) + 1e-12
        total += float(((2.0 * j1(argument) / argument) ** 2).sum())
    per_area = (np.pi * (DIAMETER / WAVELENGTH) ** 2 / 4.0) * (edge[1] - edge[0]) ** 2
    assert distance.max() < AIRY
    found = encircled_energy(AIRY, COVARIANCE, WAVELENGTH, DIAMETER)
    verify_claim(
        "index.encircled_energy",
        claim="Encircled energy of aperture and jitter together",
        where="`ps_fmu.pointing`: encircled_energy",
        reference="Airy's pattern moved to 2000 drawn places, summed over 280,000 pixels",
        error=abs(found - total / len(places) * per_area),
        bound=0.01,
        unit="absolute",
    )
    assert found < 0.83


def test_the_aperture_ends_at_its_cutoff():
    cutoff = DIAMETER / WAVELENGTH
    assert aperture_mtf([0.0, cutoff, 2.0 * cutoff], WAVELENGTH, DIAMETER) == pytest.approx([1.0, 0.0, 0.0])
    assert aperture_mtf(0.5 * cutoff, WAVELENGTH, DIAMETER) == pytest.approx(0.391, abs=5e-4)


@pytest.mark.parametrize("bad", [np.eye(3), [[1.0, 0.5], [0.4, 1.0]], [[1.0, 2.0], [2.0, 1.0]]])
def test_what_is_no_covariance(bad):
    with pytest.raises(ValueError, match="covariance: expected"):
        jitter_otf(1.0, 1.0, bad)
