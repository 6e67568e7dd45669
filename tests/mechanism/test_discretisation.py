"""Steps with held inputs against the exponential of scipy and closed forms."""

import ctypes

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm, matrix_balance

from ps_fmu.mechanism.discretisation import first_order_hold, zero_order_hold
from ps_fmu.mechanism.linear_model import Plant
from ps_fmu.mechanism.parameters import load
from ps_fmu.numerics.library import Discretisation, find_library
from ps_fmu.slavekit.author.blocks import store_by_columns
from ps_fmu.slavekit.author.buffer import allocate_aligned


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


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_what_is_not_finite_leads_to_nothing_finite(bad):
    A, B = np.array([[0.0, 1.0], [-4.0, -0.1]]), np.ones((2, 1))
    for place in ((0, 0), (1, 0)):
        wrong = A.copy()
        wrong[place] = bad
        for result in (*zero_order_hold(wrong, B, 0.1), *zero_order_hold(A, B * bad, 0.1)):
            assert np.isnan(result).all()


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


def test_units_of_powers_of_two_change_no_bit():
    """Balancing ends when the series is good enough, wherever that is."""
    random = np.random.default_rng(11)
    A, B = oscillators([0.5, 20.0, 300.0])
    A = A + random.standard_normal(A.shape)
    units = 2.0 ** random.integers(-20, 20, len(A))
    Ad, Bd = zero_order_hold(A, B, 1e-4)
    in_units = zero_order_hold(A * units / units[:, None], B / units[:, None], 1e-4)
    assert in_units[0].tobytes() == (Ad * units / units[:, None]).tobytes()
    assert in_units[1].tobytes() == (Bd / units[:, None]).tobytes()


@st.composite
def systems(draw: st.DrawFn) -> tuple[np.ndarray, np.ndarray, float]:
    """Small ones of all kinds: dense, chains of integrators, stiff, zero; and a step, s."""
    n, m, random = draw(st.integers(1, 20)), draw(st.integers(0, 4)), np.random.default_rng(draw(st.integers(0, 2**32)))
    kind = draw(st.sampled_from(["dense", "integrators", "stiff", "zero"]))
    A = {
        "dense": random.standard_normal((n, n)),
        "integrators": np.diag(np.ones(n - 1), 1),
        "stiff": -np.diag(10.0 ** random.uniform(-3, 3, n)) + 0.1 * random.standard_normal((n, n)),
        "zero": np.zeros((n, n)),
    }[kind]
    return A, random.standard_normal((n, m)), draw(st.sampled_from([1e-6, 1e-4, 1e-2, 0.5]))


@settings(max_examples=150, deadline=None)
@given(systems())
def test_held_and_growing_inputs_against_scipy(system):
    """By an exponential of state, input and its rate; in norm 1e-14, more where scipy doubles often itself."""
    A, B, h = system
    n, m = B.shape
    augmented = np.zeros((n + 2 * m, n + 2 * m))
    augmented[:n, :n], augmented[:n, n : n + m] = A * h, B * h
    augmented[n : n + m, n + m :] = np.eye(m)
    expected = expm(augmented)[:n]
    size = max(1.0, np.abs(A * h).sum(axis=0).max())
    found = first_order_hold(A, B, h)
    for ours, theirs in zip(found, np.split(expected, [n, n + m], axis=1), strict=True):
        assert np.abs(ours - theirs).max(initial=0.0) <= 1e-14 * size * max(np.abs(theirs).max(initial=0.0), 1e-300)
    for ours, again in zip(found, zero_order_hold(A, B, h), strict=False):
        np.testing.assert_allclose(ours, again, rtol=1e-13, atol=1e-13 * np.abs(ours).max(initial=0.0))


@pytest.mark.parametrize("budget", [1, 3000])
@pytest.mark.parametrize("ramp", [False, True])
def test_parts_make_the_same_bits_as_the_whole(budget, ramp):
    """A part takes no more than a column beyond its budget."""
    A, B = oscillators([0.5, 20.0, 300.0, 900.0])
    library, (n, m) = find_library(), B.shape
    found, parts = [], 0
    for each in (2**62, budget):
        matrices = [store_by_columns(matrix) for matrix in (A, B)]
        results = [allocate_aligned(*matrix.shape) for matrix in (*matrices, *matrices[1:] * ramp)]
        arrays = [*matrices, *results, *[None] * (not ramp), allocate_aligned(library.discretise_room(n))]
        addresses = [None if array is None else array.ctypes.data for array in arrays]
        work = Discretisation(n, m, matrices[0].shape[1], 0.01, *addresses)
        library.discretise_begin(ctypes.byref(work))
        while (answer := library.discretise(ctypes.byref(work), each)) == 0:
            parts += 1
        assert answer == 1 and work.halvings > 2
        found.append([result.tobytes() for result in results])
    assert found[0] == found[1]
    assert parts > 12_000 / max(budget, n * n)


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


@pytest.mark.parametrize("size", [1e30, 1e150, 1e300])
@pytest.mark.parametrize("turned", [False, True])
def test_a_huge_coupling_in_one_direction(size, turned):
    """States that do not act back are scaled at will: what they add is right however large it is."""
    A = np.array([[-1.0, size], [0.0, -2.0]])
    h = 0.1
    expected = np.diag(np.exp([-h, -2.0 * h]))
    expected[0, 1] = size * (np.exp(-h) - np.exp(-2.0 * h))
    Ad, Bd = zero_order_hold(A.T if turned else A, np.eye(2), h)
    np.testing.assert_allclose(Ad.T if turned else Ad, expected, rtol=1e-14)
    assert np.isfinite(Bd).all()


@pytest.mark.parametrize("size", [1e30, 1e150, 1e300])
def test_huge_units(size):
    """The same oscillator, its velocity in units that are too small by ``size``."""
    Ad, Bd = zero_order_hold(np.array([[0.0, size], [-1.0 / size, 0.0]]), np.array([[0.0], [1.0 / size]]), 0.1)
    np.testing.assert_allclose(Ad, [[np.cos(0.1), size * np.sin(0.1)], [-np.sin(0.1) / size, np.cos(0.1)]], rtol=1e-14)
    np.testing.assert_allclose(Bd[:, 0], [1.0 - np.cos(0.1), np.sin(0.1) / size], rtol=1e-13)


def test_the_plant():
    """States from 1e-7 m to 1e3 rad/s**2 apart: against the exponential of the system in balanced units."""
    plant = Plant.from_parameters(load())
    A, B, _, _ = plant.linearise(np.array([4e-3, -4e-3, 1e-4])).matrices()
    balanced, (scale, _) = matrix_balance(A, permute=False, separate=True)
    for ours, theirs in zip(
        zero_order_hold(A, B, 1e-4), by_scipy(balanced, B / scale[:, None], 1e-4), strict=True
    ):
        left = scale if ours.shape == A.shape else np.ones(B.shape[1])
        assert np.abs(ours / scale[:, None] * left - theirs).max() < 1e-14
