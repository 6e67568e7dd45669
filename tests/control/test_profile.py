"""Motion profiles: smoothness, limits, durations, ends, and what they leave in a flexible mode."""

from ctypes import c_double, c_void_p

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ps_fmu.control.commander import DEFAULT_LIMITS, Limits
from ps_fmu.mechanism.parameters import ParameterError
from ps_fmu.numerics.library import find_address, find_library

# Peaks of rate, acceleration and jerk of 35 tau^4 - 84 tau^5 + 70 tau^6 - 20 tau^7.
PEAK_RATE, PEAK_ACCELERATION, PEAK_JERK = 35.0 / 16.0, 84.0 * 5.0**0.5 / 25.0, 105.0 / 2.0
REDIRECTION_EXCESS = 0.1
LIMITS = DEFAULT_LIMITS
LIMIT = np.array([LIMITS.max_rate, LIMITS.max_acceleration, LIMITS.max_jerk])
ALL_LIMITS = np.append(LIMIT, LIMITS.min_duration)
SLEW = np.radians([8.5, 0.0, 0.0])

angle = st.floats(-0.15, 0.15)  # rad
orientations = st.tuples(angle, angle, angle).map(np.array)
fractions = st.floats(0.02, 0.98)


class Profile:
    """``Profile`` of ``native/control/profile.h``."""

    def __init__(self, numbers):
        self.numbers = numbers
        self.start_time, self.brake, self.transfer = numbers[:3].tolist()
        self.start, self.target = numbers[3:15].reshape(4, 3), numbers[15:]
        self.duration = max(self.brake, self.transfer)
        self.end_time = self.start_time + self.duration

    def at(self, times):
        """Position, rate, acceleration and jerk at times (...), (..., 4, 3)."""
        follow, found = find_library().profile_follow, np.zeros((*np.shape(times), 4, 3))
        for time, place in zip(np.ravel(times), found.reshape(-1, 12), strict=True):
            follow(c_void_p(find_address(self.numbers)), c_double(time), 3, c_void_p(find_address(place)))
        return found


def plan(time, start, target):
    numbers, given = np.zeros(18), [np.array(array, dtype=float) for array in (start, target, ALL_LIMITS)]
    places = (c_void_p(find_address(array)) for array in (numbers, *given))
    profile, *others = places
    find_library().profile_plan(profile, c_double(time), *others)
    return Profile(numbers)


def from_rest(start, target, time=0.0):
    return plan(time, [start, *np.zeros((3, 3))], target)


def peaks(profile):
    """Largest norms of rate, acceleration and jerk."""
    state = profile.at(np.linspace(profile.start_time, profile.end_time, 401))
    return np.linalg.norm(state[:, 1:], axis=2).max(axis=0)


def test_from_rest_it_is_the_polynomial_of_degree_7():
    profile = from_rest(np.zeros(3), SLEW)
    tau = np.linspace(0.0, 1.0, 11)
    expected = 35 * tau**4 - 84 * tau**5 + 70 * tau**6 - 20 * tau**7
    np.testing.assert_allclose(
        profile.at(tau * profile.duration)[:, 0, 0], expected * SLEW[0], atol=1e-15
    )


def test_peaks_from_rest():
    profile = from_rest(np.zeros(3), SLEW)
    T, D = profile.duration, SLEW[0]
    np.testing.assert_allclose(
        peaks(profile), [PEAK_RATE * D / T, PEAK_ACCELERATION * D / T**2, PEAK_JERK * D / T**3], rtol=1e-4
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
    second = plan(t, first.at(t), other)
    np.testing.assert_allclose(second.at(t), first.at(t), rtol=0, atol=1e-15)
    np.testing.assert_array_equal(second.at(second.end_time), [other, *np.zeros((3, 3))])


@given(orientations, orientations, orientations, orientations, fractions, fractions)
def test_limits_hold_within_their_excess_however_often_the_target_changes(a, b, c, d, first, second):
    profile = from_rest(a, b)
    for target, fraction in ((c, first), (d, second)):
        time = profile.start_time + fraction * profile.duration
        profile = plan(time, profile.at(time), target)
        assert np.all(peaks(profile) <= LIMIT * (1 + REDIRECTION_EXCESS) * 1.01)


@given(orientations, orientations, orientations, fractions)
def test_a_new_target_does_not_send_the_motion_astray(start, target, other, fraction):
    """It leaves the box of its old end points and the new target by a stopping distance, 6.5 deg at most."""
    first = from_rest(start, target)
    t = fraction * first.duration
    state = first.at(t)
    second = plan(t, state, other)
    path = second.at(np.linspace(t, second.end_time, 101))[:, 0]
    low, high = np.minimum(state[0], other), np.maximum(state[0], other)
    assert np.degrees(np.maximum(path - high, low - path).max()) < 6.5
    assert second.duration < 2.1 * max(from_rest(state[0], other).duration, 30.0)  # s


def test_the_same_target_at_rest_is_no_motion():
    profile = from_rest(SLEW, SLEW, time=7.0)
    assert profile.duration == 0.0
    np.testing.assert_array_equal(profile.at(np.array([0.0, 7.0, 9.0]))[:, 0], [SLEW] * 3)


def test_a_small_motion_takes_the_shortest_duration():
    assert from_rest(np.zeros(3), np.radians([0.01, 0.0, 0.0])).duration == LIMITS.min_duration


SAMPLES = np.linspace(0.0, 1.0, 33)


def excess(profile, allowed):
    """Largest ratio to what is allowed, at the samples that durations are judged by."""
    times = profile.start_time + np.outer((profile.brake, profile.transfer), SAMPLES).ravel()
    return (np.linalg.norm(profile.at(times)[:, 1:], axis=2) / allowed).max()


def with_durations(profile, brake, transfer, target):
    return Profile(np.concatenate([[profile.start_time, brake, transfer], profile.start.ravel(), target]))


@given(orientations, orientations, orientations, fractions)
def test_the_durations_are_the_first_of_those_tried_within_the_limits(start, target, other, fraction):
    """Brake and transfer, 3 % apart from a lower bound on: as by trying all before them."""
    first = from_rest(start, target)
    t = fraction * first.duration
    state = first.at(t)
    found = plan(t, state, other)
    own = np.linalg.norm(state[1:], axis=1)
    if not own.any():
        return
    allowed = np.maximum(own, LIMIT) * 1.001
    bound = max(own[0] / LIMIT[1], (own[0] / LIMIT[2]) ** 0.5, own[1] / LIMIT[2], 1e-3)
    brakes = 0.5 * bound * 1.03 ** np.arange(100)

    def brake_of(duration):
        r, a, j = state[1:]
        stop = state[0] + r * duration / 2 + a * duration**2 / 10 + j * duration**3 / 120
        return with_durations(found, duration, 0.0, stop)

    k = int(np.argmin(np.abs(brakes / found.brake - 1.0)))
    assert found.brake == pytest.approx(brakes[k], rel=1e-12)
    at_brake = excess(brake_of(found.brake), allowed)
    shorter = [excess(brake_of(duration), allowed) for duration in brakes[max(k - 3, 0) : k]]
    assert all(other > min(at_brake, 1.0) for other in shorter)
    stop = brake_of(found.brake).target
    if found.transfer:
        distance = np.linalg.norm(other - stop)
        shortest = max(10.0, PEAK_RATE * distance / LIMIT[0], (PEAK_ACCELERATION * distance / LIMIT[1]) ** 0.5,
                       np.cbrt(PEAK_JERK * distance / LIMIT[2]))  # fmt: skip
        transfers = shortest * 1.03 ** np.arange(60)
        k = int(np.argmin(np.abs(transfers / found.transfer - 1.0)))
        assert found.transfer == pytest.approx(transfers[k], rel=1e-12)
        allowed = np.maximum(allowed * max(1.0, at_brake), (1.0 + REDIRECTION_EXCESS) * LIMIT)
        for duration in transfers[max(k - 3, 0) : k]:
            assert excess(with_durations(found, found.brake, duration, other), allowed) > 1.0


@pytest.mark.parametrize("frequency", [0.45, 1.1, 5.1])  # Hz: slowest and fastest bus mode, suspension
def test_default_slew_leaves_lightly_damped_modes_at_rest(frequency):
    """Residual amplitude of an undamped oscillator driven by the acceleration, relative to the slew angle."""
    profile = from_rest(np.zeros(3), SLEW)
    assert 20.0 < profile.duration < 30.0
    t = np.linspace(0.0, profile.duration, 4001)
    omega = 2 * np.pi * frequency
    acceleration = profile.at(t)[:, 2, 0]
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
