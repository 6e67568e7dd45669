"""Frequency response of a known system from periodic records, and poles from a free motion."""

import math

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import cont2discrete, dfreqresp, dlsim

from ps_fmu.pointing.response import free_poles, periodic_response, rightmost, slowest_mode

STEP, ROWS = 0.01, 1000  # s, rows of a period
LINES = np.arange(5, 300, 2) / (STEP * ROWS)  # Hz, odd bins
RANDOM = np.random.default_rng(3)


@pytest.fixture(scope="module")
def system():
    """Two inputs, three outputs, resonances at 4 Hz (2 % damping) and 11 Hz."""
    A = np.zeros((4, 4))
    for place, (frequency, damping) in ((0, (4.0, 0.02)), (2, (11.0, 0.05))):
        omega = 2.0 * np.pi * frequency
        A[place : place + 2, place : place + 2] = [[0.0, omega], [-omega, -2.0 * damping * omega]]
    B, C, D = (RANDOM.normal(size=shape) for shape in ((4, 2), (3, 4), (3, 2)))
    return cont2discrete((A, B, C, D), STEP)


def simulated(system, records: int, noise: float = 0.0) -> tuple[NDArray, NDArray]:
    """One period and two rows after five periods have passed, (records, ROWS + 2, ...)."""
    time = np.arange(6 * ROWS + 2) * STEP
    inputs, outputs = [], []
    for _ in range(records):
        phases = RANDOM.uniform(0.0, 2.0 * np.pi, (len(LINES), 2))
        u = np.cos(2.0 * np.pi * LINES[None, :, None] * time[:, None, None] + phases).sum(axis=1)
        _, y, _ = dlsim(system, u)
        inputs.append(u[-ROWS - 2 :])
        outputs.append(y[-ROWS - 2 :] + noise * RANDOM.normal(size=(ROWS + 2, 3)) + 5.0 + time[-ROWS - 2 :, None])
    return np.stack(inputs), np.stack(outputs)


def expected(system) -> NDArray:
    A, B, C, D, _ = system
    found = np.empty((len(LINES), 3, 2), dtype=complex)
    for i in range(3):
        for j in range(2):
            one = (A, B[:, [j]], C[[i]], D[[i]][:, [j]], STEP)
            found[:, i, j] = dfreqresp(one, w=2.0 * np.pi * LINES * STEP)[1]
    return found


def test_known_system_whatever_offset_and_drift(system):
    found = periodic_response(*simulated(system, 4), STEP, LINES)
    assert found.coherence.min() > 1.0 - 1e-6
    assert np.abs(20.0 * np.log10(np.abs(found.matrix / expected(system)))).max() < 0.2
    assert np.abs(np.degrees(np.angle(found.matrix / expected(system)))).max() < 2.0


def test_noise_lowers_the_coherence(system):
    found = periodic_response(*simulated(system, 4, noise=3.0), STEP, LINES)
    assert np.median(found.coherence) < 0.99


def test_what_cannot_be_estimated_is_refused(system):
    inputs, outputs = simulated(system, 3)
    with pytest.raises(ValueError, match="at least 3, got 2"):
        periodic_response(inputs[:2], outputs[:2], STEP, LINES)
    with pytest.raises(ValueError, match=r"multiples of 0\.1 Hz"):
        periodic_response(inputs, outputs, STEP, LINES + 0.01)


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
