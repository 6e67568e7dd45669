"""Eq (14) against elementary rotations, rates against finite differences, quaternions against matrices."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from support.mechanics import to_rotation_matrix

from ps_fmu.mechanism.initial_motion import InitialMotion
from ps_fmu.mechanism.quantities import ParameterError
from ps_fmu.mechanism.rotations import (
    GimbalLockError,
    angular_velocity_map,
    cross,
    from_rotation_matrix,
    from_rotation_vector,
    multiply,
    orientation_rate_map,
    roll_pitch_yaw,
    rotation_from_vector,
    rotation_matrix,
    rotation_vector,
    skew,
)

angle = st.floats(-3.1, 3.1)
orientations = st.tuples(angle, st.floats(-1.5, 1.5), angle).map(np.array)


def elementary(axis: int, a: float) -> np.ndarray:
    """Rotation by a about one coordinate axis."""
    i, j = (axis + 1) % 3, (axis + 2) % 3
    R = np.eye(3)
    R[i, i] = R[j, j] = np.cos(a)
    R[i, j], R[j, i] = -np.sin(a), np.sin(a)
    return R


@given(orientations)
def test_rotation_matrix_is_yaw_after_pitch_after_roll(o):
    roll, pitch, yaw = o
    np.testing.assert_allclose(
        rotation_matrix(o), elementary(2, yaw) @ elementary(1, pitch) @ elementary(0, roll), atol=1e-15
    )


def test_rotation_matrix_maps_platform_to_base():
    # A yaw of +90 deg turns the x axis of P onto the y axis of B.
    quarter_turn = rotation_matrix(np.array([0.0, 0.0, np.pi / 2]))
    np.testing.assert_allclose(quarter_turn @ [1, 0, 0], [0, 1, 0], atol=1e-16)


@given(orientations)
def test_roll_pitch_yaw_inverts_rotation_matrix(o):
    # Roll and yaw lose digits in proportion to 1/cos(pitch).
    np.testing.assert_allclose(roll_pitch_yaw(rotation_matrix(o)), o, atol=2e-15 / np.cos(o[1]))


@pytest.mark.parametrize("pitch_deg", [90.0, -90.0, 89.99999])
def test_gimbal_lock_is_refused(pitch_deg):
    o = np.radians([10.0, pitch_deg, 20.0])
    with pytest.raises(GimbalLockError, match="too close to 90 deg"):
        roll_pitch_yaw(rotation_matrix(o))
    with pytest.raises(GimbalLockError):
        orientation_rate_map(o)


def test_one_locked_orientation_in_a_batch_is_refused_and_89_deg_is_not():
    roll_pitch_yaw(rotation_matrix(np.radians([10.0, 89.0, 20.0])))
    with pytest.raises(GimbalLockError):
        roll_pitch_yaw(rotation_matrix(np.radians([[0.0, 0.0, 0.0], [0.0, 90.0, 0.0]])))


@given(orientations, st.tuples(angle, angle, angle).map(np.array))
def test_angular_velocity_is_the_derivative_of_the_matrix(o, rate):
    """d/dt R R^T = skew(omega), central difference."""
    h = 1e-6
    R_dot = (rotation_matrix(o + h * rate) - rotation_matrix(o - h * rate)) / (2 * h)
    omega_B = angular_velocity_map(o) @ rate
    np.testing.assert_allclose(R_dot @ rotation_matrix(o).T, skew(omega_B), atol=1e-7)


@given(orientations)
def test_rate_maps_are_inverse_to_each_other(o):
    product = orientation_rate_map(o) @ angular_velocity_map(o)
    np.testing.assert_allclose(product, np.eye(3), atol=1e-15 / np.cos(o[1]) ** 2)


def test_skew_is_the_cross_product():
    a, b = np.random.default_rng(1).normal(size=(2, 5, 3))
    np.testing.assert_allclose((skew(a) @ b[..., None])[..., 0], np.cross(a, b), atol=1e-15)


@pytest.mark.parametrize("size", [0.0, 1e-12, 1e-3, 1.0, 3.0])
def test_rotation_from_vector_is_a_rotation_about_the_vector(size):
    v = size * np.array([2.0, -1.0, 2.0]) / 3.0
    R = rotation_from_vector(v)
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-15)
    np.testing.assert_allclose(R @ v, v, atol=1e-15)
    np.testing.assert_allclose(np.trace(R), 1.0 + 2.0 * np.cos(size), atol=1e-15)
    np.testing.assert_allclose(R - R.T, 2.0 * np.sinc(size / np.pi) * skew(v), atol=1e-15)


def test_one_cross_product_has_the_bits_of_many():
    a, b = np.random.default_rng(3).normal(size=(2, 20, 3))
    np.testing.assert_array_equal([cross(x, y) for x, y in zip(a, b, strict=True)], cross(a, b))
    np.testing.assert_array_equal(cross(a, b), np.cross(a, b))


def test_leading_dimensions_are_kept():
    o = np.random.default_rng(2).uniform(-1, 1, (4, 5, 3))
    for function in (rotation_matrix, angular_velocity_map, orientation_rate_map, skew, rotation_from_vector):
        batch = function(o)
        assert batch.shape == (4, 5, 3, 3)
        np.testing.assert_array_equal(batch[2, 3], function(o[2, 3]))
    assert roll_pitch_yaw(rotation_matrix(o)).shape == (4, 5, 3)
    R = rotation_from_vector(o * [[[1e-9], [1e-4], [0.1], [0.5], [0.9]]])
    np.testing.assert_array_equal(rotation_vector(R)[2, 3], rotation_vector(R[2, 3]))


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
    back = multiply(p * [1.0, -1.0, -1.0, -1.0], p)
    np.testing.assert_allclose(back, np.tile([1.0, 0.0, 0.0, 0.0], (20, 1)), rtol=0.0, atol=1e-15)


def test_many_at_once_are_those_one_by_one() -> None:
    many = np.concatenate([TURNS, SPECIAL])
    q = from_rotation_vector(many)
    np.testing.assert_allclose([from_rotation_vector(turn) for turn in many], q, rtol=0.0, atol=1e-15)
    R = to_rotation_matrix(q)
    np.testing.assert_array_equal(from_rotation_matrix(R), [from_rotation_matrix(each) for each in R])


def test_initial_attitude_is_made_a_unit_quaternion() -> None:
    given = np.array([0.707, 0.0, 0.707, 0.0])
    np.testing.assert_allclose(InitialMotion(given, np.zeros(3)).unit_attitude, given / np.sqrt(2 * 0.707**2))
    with pytest.raises(ParameterError, match="initial_attitude: expected a unit quaternion"):
        InitialMotion(np.array([1.0, 1.0, 0.0, 0.0]), np.zeros(3))
