"""Cosines and sines of many multiples of an angle, and the wheels that are made of them."""

import numpy as np
import pytest

from ps_fmu.disturbance.kinds.wheels import FORCE, TORQUE, Harmonics, WheelSource, wheel_plane
from ps_fmu.disturbance.smooth import ramp
from ps_fmu.disturbance.speed import SpeedProfile

AXIS, POSITION = np.array([1.0, 2.0, -0.5]), np.array([0.3, -0.2, 0.1])
RUN_UP = SpeedProfile(-50.0, 600.0, 0.5, 3.0)  # rad/s, s: with the fade-in, all terms act


def turn(multiple: float, angle: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The force of one harmonic of a wheel at 1 rad/s, over its size, and the cosine and sine that it has to be."""
    one, axis, steady = Harmonics(np.array([multiple]), np.ones(1)), np.array([0.0, 0.0, 1.0]), SpeedProfile(1, 1, 0, 0)
    wheel = WheelSource(steady, axis, np.zeros(3), (3,), rise_time=1e-9, force=one, torque=one)
    along, across = wheel_plane(axis)
    found = wheel(angle)[:, :3] @ np.stack([along, across], axis=1)
    phase = 2.0 * np.pi * np.random.Generator(np.random.Philox(np.random.SeedSequence((3,)))).random(2)[0]
    product = multiple * angle
    expected = np.stack([np.cos(product + phase), np.sin(product + phase)], axis=1)
    return found, expected


def test_all_around_the_circle_and_far_along() -> None:
    random = np.random.default_rng(1)
    for most, tolerance in ((10.0, 1e-13), (1e5, 1e-9)):  # the second: rounding of the product
        for multiple in random.uniform(0.1, 20.0, 7):
            found, expected = turn(float(multiple), random.uniform(0.1, most, 5000))
            np.testing.assert_allclose(found, expected, rtol=0.0, atol=tolerance)


def test_between_two_points_of_the_table() -> None:
    """Where the series are at their worst."""
    found, expected = turn(1.0, (np.arange(1024) + 0.5) * 2.0 * np.pi / 1024)
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=6e-15)


@pytest.mark.parametrize("angle", [1e15, 1e17, 1e300])
def test_angles_without_a_fraction_stay_on_the_circle(angle: float) -> None:
    found, _ = turn(1.0, np.array([angle]))
    assert abs(np.hypot(*found[0]) - 1.0) < 1e-9


def test_a_wheel_is_the_second_derivative_of_its_harmonics() -> None:
    """Each harmonic by itself, from numpy's cosines and sines, with all terms of the run-up and of the fade-in."""
    wheel = WheelSource(RUN_UP, AXIS, POSITION, (7,), rise_time=1.0)
    phases = 2.0 * np.pi * np.random.Generator(np.random.Philox(np.random.SeedSequence((7,)))).random(24)
    time = np.linspace(0.0, 4.5, 3001)
    W, rate, rise = RUN_UP.speed(time), RUN_UP.acceleration(time), ramp(time, 1.0)
    force, torque = np.zeros((2, time.size, 3))
    one, other = wheel_plane(AXIS)
    for into, harmonics, first in ((force, FORCE, 0), (torque, TORQUE, 12)):
        for k, (order, size) in enumerate(zip(harmonics.orders, harmonics.coefficients, strict=True)):
            angle = order * RUN_UP.angle(time) + phases[first + k]
            along = np.outer(np.cos(angle), one) + np.outer(np.sin(angle), other)
            across = np.outer(-np.sin(angle), one) + np.outer(np.cos(angle), other)
            into += size * (rise.value * W**2)[:, None] * along
            into -= size / order * (rise.value * rate + 2.0 * rise.rate * W)[:, None] * across
            into -= size / order**2 * rise.curvature[:, None] * along
    torque += np.cross(POSITION, force)
    found = wheel(time)
    np.testing.assert_allclose(found[:, :3], force, rtol=0.0, atol=1e-12 * np.abs(force).max())
    np.testing.assert_allclose(found[:, 3:], torque, rtol=0.0, atol=1e-12 * np.abs(torque).max())


@pytest.mark.parametrize("size", [1, 7, 255, 256, 300, 1000])
def test_a_sample_does_not_depend_on_those_beside_it(size: int) -> None:
    wheel = WheelSource(RUN_UP, AXIS, POSITION, (7,), rise_time=1.0)
    time = np.arange(1, 2001) * 1e-3
    parts = [wheel(time[first : first + size]) for first in range(0, time.size, size)]
    np.testing.assert_array_equal(np.concatenate(parts), wheel(time))
