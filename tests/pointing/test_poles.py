"""Poles from a free motion."""

import math

import numpy as np
import pytest

from ps_fmu.pointing.poles import free_poles, rightmost, slowest_mode

STEP_S = 0.01
POLES = np.array([-0.4 + 33.0j, 0.3 + 36.0j, -19.0 + 26.0j, -0.01 + 3.0j])  # rad/s


def motion(poles=POLES):
    """Three signals in which each mode has a shape of its own."""
    time = np.arange(400) * STEP_S
    shapes = np.random.default_rng(3).normal(size=(len(poles), 3))
    return (np.exp(np.outer(time, poles)) @ shapes).real


def test_poles_are_found():
    found = free_poles(motion(), STEP_S, order=8)
    expected = np.concatenate([POLES, POLES.conj()])
    assert np.sort_complex(found) == pytest.approx(np.sort_complex(expected), abs=1e-4)


@pytest.mark.parametrize("order", [8, 24])
def test_the_rightmost_in_the_band_whatever_the_order(order):
    """With 24, rounding makes spurious poles, some of them unstable; they have no share in the motion."""
    assert slowest_mode(motion(), STEP_S, order, (2.0, 20.0)) == pytest.approx(POLES[1], abs=1e-4)
    assert slowest_mode(motion(POLES[2:]), STEP_S, order, (2.0, 20.0)) == pytest.approx(POLES[2], abs=1e-2)


def test_no_pole_in_the_band():
    assert math.isnan(rightmost(POLES, (20.0, 30.0)).real)
