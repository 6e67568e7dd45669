"""The line-of-sight sensor: the angle it measures, its noise, and its lock."""

from dataclasses import replace

import numpy as np
import pytest

from ps_fmu.mechanism.quantities import ParameterError
from ps_fmu.mechanism.rotations import from_rotation_matrix, rotation_from_vector
from ps_fmu.sensors.line_of_sight import (
    DEFAULT_TRACKER,
    PAIRS,
    SECOND_PAIRS,
    line_of_sight_error,
    relative_rows,
)

RANDOM = np.random.default_rng(11)
TURNS = RANDOM.normal(size=(40, 3)) * 1.5  # rad


def test_the_error_is_where_the_target_stands_in_the_image():
    """Direction cosines of the target's line in P, whatever the attitudes and the roll about the line."""
    for turn, other in zip(TURNS, TURNS[::-1], strict=True):
        R_P, R_T = rotation_from_vector(turn), rotation_from_vector(other)
        d = R_P.T @ R_T[:, 2]
        error = line_of_sight_error(from_rotation_matrix(R_P), from_rotation_matrix(R_T))
        np.testing.assert_allclose(error[:2], [-d[1], d[0]], atol=1e-14)


@pytest.mark.parametrize("axis", range(3))
def test_a_small_rotation_is_measured_about_its_axis(axis):
    for turn in TURNS[:5]:
        R, e = rotation_from_vector(turn), 1e-4 * np.eye(3)[axis]
        q = from_rotation_matrix(R)
        error = line_of_sight_error(q, from_rotation_matrix(R @ rotation_from_vector(e)))
        np.testing.assert_allclose(error, e, atol=1e-12)  # the third order is 2e-13 rad


def test_the_sign_of_a_quaternion_means_nothing():
    q, p = from_rotation_matrix(rotation_from_vector(TURNS[0])), from_rotation_matrix(rotation_from_vector(TURNS[1]))
    np.testing.assert_array_equal(line_of_sight_error(q, p), line_of_sight_error(-q, p))


def test_noise_is_a_function_of_number_and_seed_alone():
    whole = DEFAULT_TRACKER.noise(np.arange(5000))
    np.testing.assert_array_equal(DEFAULT_TRACKER.noise(np.array([127, 128, 4000])), whole[[127, 128, 4000]])
    assert not np.array_equal(replace(DEFAULT_TRACKER, seed=2).noise(np.arange(5)), whole[:5])


def test_noise_has_the_equivalent_angle_and_is_white():
    n = 20_000
    noise = DEFAULT_TRACKER.noise(np.arange(n)) / DEFAULT_TRACKER.noise_equivalent_angle_P
    four_sigma = 4.0 / np.sqrt(n)
    assert np.abs(noise.mean(axis=0)).max() < four_sigma
    assert np.abs(noise.std(axis=0) - 1.0).max() < four_sigma
    assert np.abs(np.corrcoef(noise.T) - np.eye(3)).max() < four_sigma
    assert np.abs((noise[1:] * noise[:-1]).mean(axis=0)).max() < four_sigma


def test_the_roll_is_measured_on_request_alone():
    assert not replace(DEFAULT_TRACKER, roll_measured=False).noise(np.arange(10))[:, 2].any()


def test_the_place_in_the_field():
    """At the edge of the field it is 1; a target behind is at 2; quaternions that are no units have no place."""
    q = from_rotation_matrix(rotation_from_vector(TURNS[2]))
    half = 0.5 * DEFAULT_TRACKER.field_of_view

    def look(turn, scale=1.0, turned=(0.0, 0.0, 0.0, 0.0)):
        target = scale * from_rotation_matrix(rotation_from_vector(TURNS[2]) @ rotation_from_vector(np.array(turn)))
        (i, j), (k, m) = np.array(PAIRS).T, np.array(SECOND_PAIRS).T
        relative = relative_rows() @ (q[i] * target[j])
        return DEFAULT_TRACKER.rows[3:] @ np.concatenate([relative[k] * relative[m], turned, [1.0]])

    np.testing.assert_allclose(look([half, 0.0, 0.0]), [1.0, 0.0, 0.0, 0.0], atol=1e-6)
    np.testing.assert_allclose(look([0.0, 0.0, 0.0], turned=[0.0, half, 0.0, 0.0]), [0.0, -1.0, 0.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(look([0.0, 0.0, 0.0], turned=[half, 0.0, half, 0.0]), np.zeros(4), atol=1e-12)
    assert look([np.pi, 0.0, 0.0])[2] == pytest.approx(2.0)
    assert look([0.0, 0.0, 0.0], scale=1.1)[3] == pytest.approx(21.0)


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"acquisition_field": 3e-3}, "acquisition_field: must not be wider than field_of_view"),
        ({"noise_equivalent_angle_P": [1e-7, -1e-7, 0.0]}, "noise_equivalent_angle: must not be negative"),
        ({"sample_time": 0.0}, "sample_time: must be greater than 0"),
    ],
)
def test_impossible_sensors_are_refused(change, text):
    with pytest.raises(ParameterError, match=text):
        replace(DEFAULT_TRACKER, **change)
