"""Inertial sensors: geometry, bandwidth, constant errors."""

import numpy as np
import pytest

from ps_fmu.mechanism.discretisation import zero_order_hold
from ps_fmu.mechanism.quantities import ParameterError, replace_values
from ps_fmu.sensors.errors import SensorNoise
from ps_fmu.sensors.inertial import (
    ACCELEROMETERS,
    CHANNELS,
    PRODUCTS,
    centripetal_rows,
    default_sensors,
    estimator,
    geometry_rows,
)
from ps_fmu.sensors.parameters import SensorLowpass


def with_values(**changes):
    """The default sensors, with two underscores for a dot."""
    return replace_values(default_sensors(), {name.replace("__", "."): value for name, value in changes.items()})


def test_readings_are_those_of_a_rigid_body():
    random = np.random.default_rng(4)
    r, n, a, alpha, w = (random.normal(size=shape) for shape in ((5, 3), (5, 3), 3, 3, 3))
    direct = [n[k] @ (a + np.cross(alpha, r[k]) + np.cross(w, np.cross(w, r[k]))) for k in range(5)]
    products = np.array([w[i] * w[j] for i, j in PRODUCTS])
    rows = geometry_rows(r, n) @ np.concatenate([a, alpha]) + centripetal_rows(r, n) @ products
    assert rows == pytest.approx(np.array(direct), rel=1e-12)


def test_the_estimate_undoes_the_geometry():
    sensors = default_sensors()
    rows, _ = sensors.reading_rows
    assert sensors.estimator[:6] @ rows[:, :6] == pytest.approx(np.eye(6), abs=1e-12)
    assert sensors.enabled.sum() == 9
    # Three triads 0.5 m from the axis: each axis thrice; 3 r^2 about z, half of it about x and y.
    spread = np.linalg.norm(sensors.estimator[:6], axis=1)
    assert spread == pytest.approx([3**-0.5] * 3 + [0.375**-0.5] * 2 + [0.75**-0.5], rel=1e-3)


@pytest.mark.parametrize(
    ("off", "motion"),
    [
        ((3, 6, 9), "none reads an acceleration of (0, 0, 0) m/s2 with an angular acceleration of"),
        (range(1, 10), "the 0 that are enabled"),
        ((2, 3, 5, 8, 9), "the 4 that are enabled"),
    ],
)
def test_a_geometry_that_cannot_see_six_degrees_of_freedom_is_refused(off, motion):
    with pytest.raises(ParameterError) as caught:
        _ = with_values(**{f"accelerometer_{k}__enabled": False for k in off}).estimator
    assert str(caught.value).startswith("accelerometers: ") and motion in str(caught.value)


def test_the_motion_that_is_named_is_not_seen():
    """Three triads on a line do not see a turn about it, wherever it lies."""
    line = np.array([0.3, -0.4, 0.2])
    r = np.repeat(np.outer([1.0, 2.0, 3.0], line), 3, axis=0) + np.array([0.1, 0.0, 0.0])
    n = np.tile(np.eye(3), (3, 1))
    with pytest.raises(ParameterError, match="cannot see") as caught:
        estimator(r, n)
    texts = str(caught.value).split("acceleration of (")[1:]
    motion = np.concatenate([np.array(text.split(")")[0].split(","), dtype=float) for text in texts])
    assert np.abs(geometry_rows(r, n) @ motion).max() < 0.05 * np.abs(motion).max()


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("bandwidth", [3.0, 150.0])
def test_bandwidth_is_discretised_exactly(order, bandwidth):
    low, h = SensorLowpass(bandwidth, order), 1e-3
    omega = 2.0 * np.pi * bandwidth
    A = np.array([[-omega]]) if order == 1 else omega * np.array([[0.0, 1.0], [-1.0, -np.sqrt(2.0)]])
    B = np.array([[omega]]) if order == 1 else np.array([[0.0], [omega]])
    Ad, Bd = zero_order_hold(A, B, h)
    found = low.discretise(h)
    assert found[0][:order, :order] == pytest.approx(Ad, abs=1e-13)
    assert found[1][:order] == pytest.approx(Bd[:, 0], abs=1e-13)
    assert abs(low.response(1j * omega)) == pytest.approx(np.sqrt(0.5))
    f = np.array([0.01 * bandwidth])
    delayed = low.response(2j * np.pi * f) * np.exp(-2j * np.pi * f * 0.5 * h)  # a hold is half a step late
    assert low.sampled_response(f, h) == pytest.approx(delayed, rel=1e-3)


def test_without_bandwidth_the_output_is_the_input():
    low = SensorLowpass(0.0, 2)
    Ad, bd = low.discretise(1e-3)
    assert not Ad.any() and bd.tolist() == [1.0, 0.0]
    assert low.response(1j) == 1.0
    assert low.sampled_response(np.array([100.0]), 1e-3)[0] == pytest.approx(np.exp(-0.2j * np.pi))


def test_constant_errors_are_stated_or_drawn():
    sensors = with_values(accelerometer_2__bias=0.5, accelerometer_3__scale_factor_error=0.1)
    assert sensors.bias.nonzero()[0].tolist() == [1] and sensors.bias[1] == 0.5
    assert sensors.gain[2] == 1.1 and (np.delete(sensors.gain, 2)[: ACCELEROMETERS - 1] == 1.0).all()
    turned = with_values(accelerometer_1__misalignment__z=0.01)
    rows, _ = turned.reading_rows
    assert rows[0, :3] == pytest.approx([np.cos(0.01), np.sin(0.01), 0.0], abs=1e-5)
    drawn = [with_values(seed=seed, accelerometer__bias_spread=2.0).bias for seed in range(60)]
    assert np.std(drawn, axis=0)[:9] == pytest.approx(2.0, rel=0.35)
    assert not np.array(drawn)[:, 9:].any()  # nothing is there


def test_noise_is_that_of_each_channel_alone():
    """To switch on another sensor changes no other's noise; those that are off have none."""
    index = np.arange(1000)
    noise = default_sensors().compute_errors(1e-3, index)
    more = with_values(accelerometer_11__enabled=True, rate_sensor__enabled=True).compute_errors(1e-3, index)
    np.testing.assert_array_equal(more[:, :9], noise[:, :9])
    assert noise[:, 9:].any() == 0 and more[:, [10, 12, 13, 14]].all() and noise.shape == (1000, CHANNELS)


def test_errors_are_noise_and_bias_and_zero_in_gaps():
    """Of samples side by side, and of a few far apart."""
    sensors = with_values(accelerometer_2__enabled=False, accelerometer_3__bias=1e-3, rate_sensor__enabled=True)
    for index in (np.arange(300, 900), np.array([5, 5000, 5001, 10**7])):
        found = sensors.compute_errors(1e-3, index)
        linear = SensorNoise(sensors.accelerometer.noise, 9, 1e-3, sensors.seed, 1)(index)
        rates = SensorNoise(sensors.rate_sensor.noise, 3, 1e-3, sensors.seed, 2)(index)
        linear[:, 2] += 1e-3
        linear[:, 1] = 0.0
        np.testing.assert_array_equal(found, np.concatenate([linear, np.zeros((len(index), 3)), rates], axis=1))


def test_noise_of_the_estimate_goes_through_the_lever_arms():
    sensors = with_values(accelerometer__bias_instability=0.0)
    readings = sensors.compute_errors(1e-4, np.arange(50_000))
    covariance = np.cov((readings @ sensors.estimator[:6].T).T)
    expected = sensors.estimator[:6] @ sensors.estimator[:6].T * 9.6e-8**2 / 2e-4
    assert covariance == pytest.approx(expected, abs=0.03 * expected.max())


@pytest.mark.parametrize(
    ("name", "value", "text"),
    [
        ("accelerometer.order", 3, "accelerometer.order: must not be more than 2, got 3"),
        ("accelerometer.resolution", 2.0, "accelerometer.range: 1 is below the resolution, 2"),
        ("accelerometer_4.misalignment.x", 1.0, "accelerometer_4.misalignment: expected small angles"),
        ("rate_sensor_2.scale_factor_error", 2.0, "rate_sensor_2.scale_factor_error: must not be more than 0.5, got 2"),
        ("seed", -1, "seed: must not be less than 0, got -1"),
    ],
)
def test_impossible_values_are_refused_by_name(name, value, text):
    with pytest.raises(ParameterError) as caught:
        replace_values(default_sensors(), {name: value})
    assert str(caught.value).startswith(text)


def test_a_direction_may_have_any_length_but_none():
    sensors = with_values(accelerometer_1__direction__x=7.0)
    np.testing.assert_array_equal(sensors.reading_rows[0], default_sensors().reading_rows[0])
    with pytest.raises(ParameterError, match=r"accelerometer_1\.direction: must not be zero"):
        with_values(accelerometer_1__direction__x=0.0)
