"""Motion profiles: smoothness, limits, durations, ends, and what they leave in a flexible mode."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ps_fmu.control.commander import DEFAULT_LIMITS, from_numbers, to_numbers
from ps_fmu.control.profile import (
    PEAK_ACCELERATION,
    PEAK_JERK,
    PEAK_RATE,
    REDIRECTION_EXCESS,
    Limits,
    Profile,
    State,
    plan,
)
from ps_fmu.mechanism.parameters import ParameterError

LIMITS = DEFAULT_LIMITS
LIMIT = np.array([LIMITS.max_rate, LIMITS.max_acceleration, LIMITS.max_jerk])
SLEW = np.radians([8.5, 0.0, 0.0])

angle = st.floats(-0.15, 0.15)  # rad
orientations = st.tuples(angle, angle, angle).map(np.array)
fractions = st.floats(0.02, 0.98)


def from_rest(start, target, time=0.0):
    return plan(time, State.at_rest(start), target, LIMITS)


def peaks(profile):
    """Largest norms of rate, acceleration and jerk."""
    state = profile.at(np.linspace(profile.start_time, profile.end_time, 2001))
    return np.array([np.linalg.norm(derivative, axis=1).max() for derivative in state[1:]])


def test_from_rest_it_is_the_polynomial_of_degree_7():
    profile = from_rest(np.zeros(3), SLEW)
    tau = np.linspace(0.0, 1.0, 11)
    expected = 35 * tau**4 - 84 * tau**5 + 70 * tau**6 - 20 * tau**7
    np.testing.assert_allclose(
        profile.at(tau * profile.duration).position[:, 0], expected * SLEW[0], atol=1e-15
    )


def test_peaks_from_rest():
    profile = from_rest(np.zeros(3), SLEW)
    T, D = profile.duration, SLEW[0]
    np.testing.assert_allclose(
        peaks(profile), [PEAK_RATE * D / T, PEAK_ACCELERATION * D / T**2, PEAK_JERK * D / T**3], rtol=1e-6
    )


@given(orientations, orientations, fractions)
def test_derivatives_are_derivatives(start, target, fraction):
    profile = from_rest(start, target)
    t, h = fraction * profile.duration, 1e-4
    before, after, state = profile.at(t - h), profile.at(t + h), profile.at(t)
    for k in range(3):
        np.testing.assert_allclose((after[k] - before[k]) / (2 * h), state[k + 1], atol=1e-8)


@given(orientations, orientations)
def test_limits_and_shortest_duration_from_rest(start, target):
    profile = from_rest(start, target)
    assert np.all(peaks(profile) <= LIMIT * (1 + 1e-12))
    binding = np.max(peaks(profile) / LIMIT) > 0.999
    assert binding or profile.duration in (0.0, LIMITS.min_duration)


@given(orientations, orientations, orientations, fractions)
def test_a_new_target_midway_continues_position_rate_acceleration_and_jerk(start, target, other, fraction):
    first = from_rest(start, target)
    t = fraction * first.duration
    second = plan(t, first.at(t), other, LIMITS)
    for before, after in zip(first.at(t), second.at(t), strict=True):
        np.testing.assert_allclose(after, before, rtol=0, atol=1e-15)
    end = second.at(second.end_time)
    np.testing.assert_array_equal(end.position, other)
    np.testing.assert_array_equal(np.stack(end[1:]), np.zeros((3, 3)))


@given(orientations, orientations, orientations, orientations, fractions, fractions)
def test_limits_hold_within_their_excess_however_often_the_target_changes(a, b, c, d, first, second):
    profile = from_rest(a, b)
    for target, fraction in ((c, first), (d, second)):
        time = profile.start_time + fraction * profile.duration
        profile = plan(time, profile.at(time), target, LIMITS)
        assert np.all(peaks(profile) <= LIMIT * (1 + REDIRECTION_EXCESS) * 1.01)


@given(orientations, orientations, orientations, fractions)
def test_a_new_target_does_not_send_the_motion_astray(start, target, other, fraction):
    """It leaves the box of its old end points and the new target by a stopping distance, 6.5 deg at most."""
    first = from_rest(start, target)
    t = fraction * first.duration
    state = first.at(t)
    second = plan(t, state, other, LIMITS)
    path = second.at(np.linspace(t, second.end_time, 501)).position
    low, high = np.minimum(state.position, other), np.maximum(state.position, other)
    assert np.degrees(np.maximum(path - high, low - path).max()) < 6.5
    assert second.duration < 2.1 * max(from_rest(state.position, other).duration, 30.0)  # s


def test_the_same_target_at_rest_is_no_motion():
    profile = from_rest(SLEW, SLEW, time=7.0)
    assert profile.duration == 0.0
    np.testing.assert_array_equal(profile.at(np.array([0.0, 7.0, 9.0])).position, [SLEW] * 3)
    np.testing.assert_array_equal(profile.remaining(np.array([0.0, 9.0])), [0.0, 0.0])


def test_a_small_motion_takes_the_shortest_duration():
    assert from_rest(np.zeros(3), np.radians([0.01, 0.0, 0.0])).duration == LIMITS.min_duration


def test_one_time_and_many_times_agree_bit_for_bit():
    profile = from_rest(np.zeros(3), SLEW)
    times = np.linspace(0.0, 30.0, 1001)
    for many, single in zip(profile.at(times), profile.at(times[417]), strict=True):
        np.testing.assert_array_equal(many[417], single)


def test_numbers_restore_the_profile():
    first = from_rest(np.zeros(3), SLEW)
    second = plan(9.0, first.at(9.0), np.radians([1.0, 2.0, -3.0]), LIMITS)
    again = from_numbers(to_numbers(second))
    times = np.linspace(9.0, 60.0, 101)
    np.testing.assert_array_equal(np.stack(again.at(times)), np.stack(second.at(times)))
    np.testing.assert_array_equal(to_numbers(again), to_numbers(second))


@pytest.mark.parametrize("frequency", [0.45, 1.1, 5.1])  # Hz: slowest and fastest bus mode, suspension
def test_default_slew_leaves_lightly_damped_modes_at_rest(frequency):
    """Residual amplitude of an undamped oscillator driven by the acceleration, relative to the slew angle."""
    profile = from_rest(np.zeros(3), SLEW)
    assert 20.0 < profile.duration < 30.0
    t = np.linspace(0.0, profile.duration, 20001)
    omega = 2 * np.pi * frequency
    acceleration = profile.at(t).acceleration[:, 0]
    residual = abs(np.trapezoid(acceleration * np.exp(-1j * omega * t), t)) / omega
    bound = 1680.0 / (omega * profile.duration) ** 4
    assert residual / SLEW[0] < 1.05 * bound < 7e-5


@pytest.mark.parametrize(
    ("values", "name"),
    [((0.0, 1.0, 1.0, 1.0), "max_rate"), ((1.0, np.nan, 1.0, 1.0), "max_acceleration"),
     ((1.0, 1.0, np.inf, 1.0), "max_jerk"), ((1.0, 1.0, 1.0, -1.0), "min_duration")],
)  # fmt: skip
def test_impossible_limits_are_named(values, name):
    with pytest.raises(ParameterError, match=f"^{name}: must"):
        Limits(*values)


def test_hold_has_no_end():
    profile = Profile.hold(SLEW)
    np.testing.assert_array_equal(profile.at(-5.0).position, SLEW)
    assert profile.remaining(-5.0) == 0.0
