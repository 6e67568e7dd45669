"""The small-gain condition for the nominal loop, with and without damping of the bus modes."""

from dataclasses import replace

import numpy as np
import pytest
from support.claims import verify_claim
from support.mechanics import PAPER, dynamics_at, pose_at, rigid

from ps_fmu.control.feedforward import gains
from ps_fmu.theory.small_gain import (
    delay_uncertainty,
    largest_singular_value,
    nominal_complement,
    nominal_complement_bound,
    nominal_loop_poles,
)
from ps_fmu.theory.transfer_matrices import Nominal, Practical, place_frequencies

DELAY = 0.02  # s
S = 2j * np.pi * np.geomspace(0.05, 300.0, 60)  # rad/s
POSE = pose_at((0.0, 0.0, 0.0))
SYSTEM = dynamics_at(POSE, replace(rigid(), bus=PAPER.bus))
PLANTS = pytest.mark.parametrize("plant", [Nominal(SYSTEM), Practical(SYSTEM)], ids=["undamped", "damped"])


def complement(plant, s):
    """T = E - (E - C K_wop)^-1, without (63)."""
    loop = plant.C(s) @ gains(PAPER.manipulator, PAPER.payload, POSE).optimal(s)
    return np.eye(6) - np.linalg.inv(np.eye(6) - loop)


@PLANTS
def test_complement_is_that_of_the_optimal_controller(plant):
    assert np.abs(nominal_complement(plant, S) - complement(plant, S)).max() < 1e-10


@PLANTS
def test_bound_64(plant):
    largest = largest_singular_value(nominal_complement(plant, S))
    verify_claim(
        "stability.small_gain",
        claim="Bound (64) of the complementary sensitivity, which the small-gain condition (62) takes",
        where="`ps-fmu analyse stability`: table, report, stability.json",
        reference="largest singular value of T = E - (E - C K)^-1 at 40 frequencies",
        error=largest / nominal_complement_bound(plant, S) - 1.0,
        bound=1e-12,
    )


def test_poles_are_those_of_the_complement():
    """Three pairs of the suspension, six of the arrays; T grows without bound towards each."""
    poles = nominal_loop_poles(SYSTEM)
    poles = poles[poles.imag > 0.0]
    assert len(poles) == 9 and poles.real.max() < 0.0
    near, far = (largest_singular_value(complement(Practical(SYSTEM), poles * (1.0 + d))) for d in (1e-7, 1e-5))
    assert np.all(near > 20.0 * far)


def test_a_grid_crowded_at_the_poles_finds_the_peaks():
    """As a dense grid does; one without them misses the narrow ones."""
    plant, band = Practical(SYSTEM), (1.0, 1.2)  # Hz, around the highest mode of the arrays

    def peak(f):
        return largest_singular_value(nominal_complement(plant, 2j * np.pi * f)).max()

    dense = peak(np.linspace(*band, 10_001))
    assert peak(place_frequencies(nominal_loop_poles(SYSTEM), *band, 20)) == pytest.approx(dense, rel=0.01)
    assert peak(np.geomspace(*band, 20)) < 0.9 * dense


def test_uncertainty_of_a_delay():
    frequency = np.array([0.0, 1.0, 25.0])
    expected = np.abs(np.exp(-2j * np.pi * frequency * DELAY) - 1.0)
    assert delay_uncertainty(frequency, DELAY) == pytest.approx(expected, abs=1e-15)
