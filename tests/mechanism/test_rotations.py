"""Eq (14) against elementary rotations, rates against finite differences."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ps_fmu.mechanism.rotations import (
    GimbalLockError,
    angular_velocity_map,
    cross,
    orientation_rate_map,
    roll_pitch_yaw,
    rotation_from_vector,
    rotation_matrix,
    rotation_vector,
    skew,
    turn_vector,
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


def test_turns_whose_axis_changes_do_not_commute():
    """Coning: an angular velocity that changes evenly, against small turns one after the other."""
    before, growth, lasted, n = np.array([0.3, -0.1, 0.2]), np.array([-2.0, 3.0, 1.0]), 0.02, 2000  # rad/s, rad/s2, s
    R = np.eye(3)
    for k in range(n):
        R = R @ rotation_from_vector((before + growth * (k + 0.5) * lasted / n) * lasted / n)
    integral, after = before * lasted + 0.5 * growth * lasted**2, before + growth * lasted
    found = rotation_from_vector(turn_vector(integral, before, after, lasted))
    np.testing.assert_allclose(found, R, rtol=0.0, atol=2e-10)
    assert np.abs(rotation_from_vector(integral) - R).max() > 2e-7
    back = rotation_from_vector(turn_vector(-integral, after, before, -lasted))
    np.testing.assert_allclose(back, R.T, rtol=0.0, atol=2e-10)
