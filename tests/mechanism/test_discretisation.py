"""Steps with held inputs against the exponential of scipy and closed forms."""

import numpy as np
import pytest
from scipy.linalg import expm

from ps_fmu.mechanism.discretisation import zero_order_hold


def by_scipy(A, B, h):
    """C. Van Loan, IEEE Trans. Autom. Control 23(3), 1978."""
    n, m = B.shape
    augmented = np.zeros((n + m, n + m))
    augmented[:n, :n], augmented[:n, n:] = A * h, B * h
    exponential = expm(augmented)
    return exponential[:n, :n], exponential[:n, n:]


def oscillators(frequencies_hz, damping=0.01):
    """Independent oscillators with positions in m and velocities in m/s: rows and columns of unlike size."""
    omega = 2.0 * np.pi * np.asarray(frequencies_hz)
    n = len(omega)
    A = np.block([[np.zeros((n, n)), np.eye(n)], [-np.diag(omega**2), -2.0 * damping * np.diag(omega)]])
    return A, np.vstack([np.zeros((n, n)), np.eye(n)])


@pytest.mark.parametrize("h", [1e-6, 1e-4, 1e-2, 0.1])
def test_oscillators_of_all_speeds(h):
    A, B = oscillators([0.01, 1.0, 30.0, 900.0])
    for ours, theirs in zip(zero_order_hold(A, B, h), by_scipy(A, B, h), strict=True):
        sizes = np.maximum(np.abs(theirs).max(axis=1, keepdims=True), 1e-300)
        assert np.abs((ours - theirs) / sizes).max() < 1e-10


@pytest.mark.parametrize("h", [1e-3, 0.1, 3.0])
def test_an_undamped_oscillator_turns(h):
    omega = 2.0 * np.pi
    Ad, Bd = zero_order_hold(np.array([[0.0, 1.0], [-(omega**2), 0.0]]), np.array([[0.0], [1.0]]), h)
    c, s = np.cos(omega * h), np.sin(omega * h)
    np.testing.assert_allclose(Ad, [[c, s / omega], [-omega * s, c]], atol=1e-12)
    np.testing.assert_allclose(Bd[:, 0], [(1.0 - c) / omega**2, s / omega], atol=1e-13)


@pytest.mark.parametrize("h", [1e-4, 100.0])
def test_a_free_mass_needs_no_inverse(h):
    Ad, Bd = zero_order_hold(np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[0.0], [2.0]]), h)
    np.testing.assert_allclose(Ad, [[1.0, h], [0.0, 1.0]], rtol=1e-15)
    np.testing.assert_allclose(Bd, [[h * h], [2.0 * h]], rtol=1e-14)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("spread", [0.0, 3.0, 8.0])
def test_random_systems_in_units_that_do_not_fit(seed, spread):
    random = np.random.default_rng(seed)
    units = 10.0 ** random.uniform(-spread, spread, 12)
    A, B = random.normal(size=(12, 12)), random.normal(size=(12, 3))
    for h in (1e-3, 0.3):
        Ad, Bd = zero_order_hold(A * units[:, None] / units, B * units[:, None], h)
        first, second = by_scipy(A, B, h)
        np.testing.assert_allclose(Ad / units[:, None] * units, first, rtol=1e-9, atol=1e-11)
        np.testing.assert_allclose(Bd / units[:, None], second, rtol=1e-9, atol=1e-11)


def test_a_system_without_states():
    Ad, Bd = zero_order_hold(np.zeros((0, 0)), np.zeros((0, 4)), 1e-4)
    assert (Ad.shape, Bd.shape) == ((0, 0), (0, 4))


@pytest.mark.parametrize("A", [np.array([[1e6]]), np.array([[np.nan]]), np.array([[np.inf]])])
def test_what_has_no_finite_answer_has_none(A):
    Ad, _ = zero_order_hold(A, np.ones((1, 1)), 1.0)
    assert not np.isfinite(Ad).all()


def test_a_step_far_too_long_for_the_fast_part_is_not_guessed():
    """A slow part beside a fast one: with 1e20 rad/s, nothing would be left of its digits."""
    for fast, is_finite in ((-1e6, True), (-1e20, False)):
        Ad, _ = zero_order_hold(np.diag([-1.0, fast]), np.ones((2, 1)), 1e-2)
        assert np.isfinite(Ad).all() == is_finite
    Ad, _ = zero_order_hold(np.diag([-1.0, -1e6]), np.ones((2, 1)), 1e-2)
    assert abs(Ad[0, 0] - np.exp(-1e-2)) < 1e-11
