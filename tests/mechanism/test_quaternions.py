"""Quaternions against rotation matrices."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ps_fmu.mechanism.initial_motion import InitialMotion
from ps_fmu.mechanism.quantities import ParameterError
from ps_fmu.mechanism.quaternions import (
    conjugate,
    from_rotation_matrix,
    from_rotation_vector,
    multiply,
    small_turns,
    to_rotation_matrix,
)

RANDOM = np.random.default_rng(4)
TURNS = RANDOM.uniform(-4.0, 4.0, (40, 3))  # rad
SPECIAL = np.array([[0.0, 0.0, 0.0], [1e-9, 0.0, 0.0], [np.pi, 0.0, 0.0], [0.0, np.pi, 0.0], [0.0, 0.0, np.pi]])  # rad


def test_rotation_matrices_of_rotation_vectors() -> None:
    turns = np.concatenate([TURNS, SPECIAL])
    q = from_rotation_vector(turns)
    np.testing.assert_allclose(np.linalg.norm(q, axis=1), 1.0, rtol=1e-14)
    np.testing.assert_allclose(to_rotation_matrix(q), Rotation.from_rotvec(turns).as_matrix(), rtol=0.0, atol=1e-14)


def test_back_from_rotation_matrices() -> None:
    """All four ways of the extraction, with a scalar that is not negative."""
    for q in from_rotation_vector(np.concatenate([TURNS, SPECIAL])):
        found = from_rotation_matrix(to_rotation_matrix(q))
        assert found[0] >= 0.0
        np.testing.assert_allclose(found * np.sign(found @ q), q, rtol=0.0, atol=1e-14)


def test_products_turn_one_after_the_other() -> None:
    p, q = from_rotation_vector(TURNS[:20]), from_rotation_vector(TURNS[20:])
    together = to_rotation_matrix(multiply(p, q))
    np.testing.assert_allclose(together, to_rotation_matrix(p) @ to_rotation_matrix(q), rtol=0.0, atol=1e-14)
    back = multiply(conjugate(p), p)
    np.testing.assert_allclose(back, np.tile([1.0, 0.0, 0.0, 0.0], (20, 1)), rtol=0.0, atol=1e-15)


def test_one_product_has_the_bits_of_many() -> None:
    p, q = from_rotation_vector(TURNS[:20]), from_rotation_vector(TURNS[20:])
    np.testing.assert_array_equal([multiply(a, b) for a, b in zip(p, q, strict=True)], multiply(p, q))


def test_small_turns_in_the_axes_of_the_body() -> None:
    q, small = from_rotation_vector(TURNS[0]), np.array([1e-6, -2e-6, 3e-6])  # rad
    exact = multiply(q, from_rotation_vector(small))
    np.testing.assert_allclose(q + small_turns(q) @ small, exact, rtol=0.0, atol=1e-11)


def test_many_at_once_are_those_one_by_one() -> None:
    many = np.concatenate([TURNS, SPECIAL])
    q = from_rotation_vector(many)
    np.testing.assert_allclose([from_rotation_vector(turn) for turn in many], q, rtol=0.0, atol=1e-15)
    R = to_rotation_matrix(q)
    np.testing.assert_array_equal(from_rotation_matrix(R), [from_rotation_matrix(each) for each in R])
    np.testing.assert_array_equal(small_turns(q), [small_turns(each) for each in q])


def test_initial_attitude_is_made_a_unit_quaternion() -> None:
    given = np.array([0.707, 0.0, 0.707, 0.0])
    np.testing.assert_allclose(InitialMotion(given, np.zeros(3)).unit_attitude, given / np.sqrt(2 * 0.707**2))
    with pytest.raises(ParameterError, match="initial_attitude: expected a unit quaternion"):
        InitialMotion(np.array([1.0, 1.0, 0.0, 0.0]), np.zeros(3))
