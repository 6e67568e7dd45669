"""InertialSensors: readings in the FMU against its equations; sampling, latency, limits, noise, states."""

import numpy as np
import pytest
from support.models import Host

from ps_fmu.mechanism.quantities import replace_values
from ps_fmu.sensors.inertial import ACCELEROMETERS, default_sensors
from ps_fmu.slavekit.author.slave import ModelError

H = 1e-4  # s
ESTIMATE = [f"estimated_{kind}.{axis}" for kind in ("acceleration", "angular_acceleration") for axis in "xyz"]
CHANNEL = [f"channel_{k}" for k in range(1, ACCELEROMETERS + 1)]
QUIET = {"accelerometer__noise_density": 0.0, "accelerometer__bias_instability": 0.0, "accelerometer__resolution": 0.0}
NOISY = {"accelerometer__noise_density": 1e-4, "accelerometer__bias_instability": 1e-4}
TURNING = {"base_acceleration__x": 1e-2, "base_angular_acceleration__z": -2e-2, "base_angular_velocity__y": 0.5}


def sensors_with(values):
    return replace_values(default_sensors(), {name.replace("__", "."): value for name, value in values.items()})


def run(host, steps, h=H, every=1):
    """Readings after each ``every``-th step, (n, ACCELEROMETERS)."""
    found = []
    for _ in range(steps // every):
        host.step(h, every)
        found.append(host.get(*CHANNEL))
    return np.array(found)


def test_readings_are_those_of_the_equations():
    """A rigid motion that turns: low-pass, scale factor, misalignment, bias; settled and in between."""
    values = QUIET | {
        "accelerometer_2__misalignment__x": 0.01, "accelerometer_4__scale_factor_error": 0.02,
        "accelerometer_9__bias": 3e-4, "accelerometer_1__position__x": 0.3, "rate_sensor__enabled": True,
    }  # fmt: skip
    host, sensors = Host("inertial_sensors", **values).run_mode(), sensors_with(values)
    host.set(**TURNING)
    u = np.array([1e-2, 0, 0, 0, 0, -2e-2, 0, 0.5, 0])
    rows, products = sensors.reading_rows
    true = rows @ u + products @ np.array([0.0, 0.25, 0.0, 0.0, 0.0, 0.0])
    omega, t = 2.0 * np.pi * 200.0, 20 * H
    rise = 1.0 - np.exp(-omega * t / np.sqrt(2)) * (np.cos(omega * t / np.sqrt(2)) + np.sin(omega * t / np.sqrt(2)))
    host.step(H, 20)
    expected = sensors.gain * true * rise + sensors.bias
    assert host.get(*CHANNEL) == pytest.approx(expected[:ACCELEROMETERS], abs=1e-12)
    host.step(H, 500)
    readings = sensors.gain * true + sensors.bias
    assert host.get(*CHANNEL) == pytest.approx(readings[:ACCELEROMETERS], rel=1e-9)
    assert host.get(*ESTIMATE) == pytest.approx(sensors.estimator[:6] @ readings, rel=1e-8)


def test_the_first_readings_are_of_the_first_motion():
    host = Host("inertial_sensors", **QUIET, **TURNING)
    before = host.get(*ESTIMATE)
    assert before == pytest.approx([1e-2, 0, 0, 0, 0, -2e-2], abs=1e-12)
    host.run_mode().step(H, 3)
    assert host.get(*ESTIMATE) == pytest.approx(before, abs=1e-12)


def test_resolution_is_exact():
    host = Host("inertial_sensors", **NOISY, accelerometer__resolution=1e-3).run_mode()
    found = run(host, 200)
    np.testing.assert_array_equal(found, np.rint(found / 1e-3) * 1e-3)
    assert len(np.unique(found)) > 5


def test_latency_is_exact():
    start = Host("inertial_sensors", **NOISY)
    first = start.get(*CHANNEL)
    prompt, late = run(start.run_mode(), 100), run(Host("inertial_sensors", **NOISY, latency=7 * H).run_mode(), 100)
    np.testing.assert_array_equal(late[7:], prompt[:-7])
    np.testing.assert_array_equal(late[:7], [first] * 7)


def test_samples_are_held_and_are_the_same_for_each_step():
    """A step of 1, 2 and 5 tenths of a millisecond with samples each millisecond: the same readings, held between."""
    found = {}
    for tenths in (1, 2, 5):
        # not rounded: two of a hundred rounded readings may be equal by chance
        host = Host("inertial_sensors", **NOISY | {"accelerometer__resolution": 0.0}, sample_time=1e-3).run_mode()
        found[tenths] = run(host, 1000 // tenths, tenths * H)
    fine = found[1].reshape(100, 10, ACCELEROMETERS)
    for tenths, readings in found.items():
        np.testing.assert_array_equal(readings[10 // tenths - 1 :: 10 // tenths], fine[:, 9])
    np.testing.assert_array_equal(fine[1:, :9], np.repeat(fine[:-1, 9:], 9, axis=1))
    assert len(np.unique(fine[:, 9, 0])) == 100


def test_steps_of_any_size_are_those_of_a_fine_grid():
    """Noisy samples at rest and their latency, at the steps' ends."""
    fine, coarse = (
        Host("inertial_sensors", **NOISY, sample_time=1e-3, latency=2.3e-3).run_mode() for _ in range(2)
    )  # fmt: skip
    start = 0
    for n in [10, 3, 7, 5, 6, 9, 1, 9] * 10:  # steps of the fine grid
        fine.step(H, n)
        assert coarse.slave.do_step(start * H, n * H)
        start += n
        assert coarse.get(*CHANNEL) == fine.get(*CHANNEL), start


def test_a_reading_beyond_the_range_is_held_and_said_once():
    host = Host("inertial_sensors", **QUIET, accelerometer__range=5e-3).run_mode()
    host.step(H, 5)
    assert not host.flag("saturated") and host.messages() == ""
    host.set(base_acceleration__y=-1e-2)
    host.step(H, 200)
    assert host.flag("saturated") and host.get("channel_2", "channel_5", "channel_1") == [-5e-3, -5e-3, 0.0]
    assert host.messages().count("met the range of its sensor") == 1
    assert "channel_2, channel_5, channel_8" in host.messages()
    host.set(base_acceleration__y=0.0)
    host.step(H, 200)
    assert not host.flag("saturated")


def test_a_geometry_that_cannot_see_all_motion_is_refused():
    off = {f"accelerometer_{k}__enabled": False for k in (3, 6, 9)}
    with pytest.raises(ModelError, match="accelerometers: the 6 that are enabled cannot see six degrees of freedom"):
        Host("inertial_sensors", **off).run_mode()


def test_rate_sensors():
    host = Host("inertial_sensors", base_angular_velocity__z=0.1).run_mode()
    host.step(H, 10)
    names = [f"estimated_angular_velocity.{axis}" for axis in "xyz"]
    assert host.get(*names) == [0.0, 0.0, 0.0]
    spreads = {f"rate_sensor__{name}_spread": 0.0 for name in ("scale_factor", "misalignment")}
    on = {"rate_sensor__enabled": True, **spreads}
    host = Host("inertial_sensors", base_angular_velocity__z=0.1, **on).run_mode()
    readings = []
    for _ in range(500):
        host.step(H)
        readings.append(host.get(*names))
    scatter = 6.2e-5 / np.sqrt(2.0 * H)  # rad/s
    assert np.mean(readings, axis=0) == pytest.approx([0.0, 0.0, 0.1], abs=5.0 * scatter / np.sqrt(500))
    assert np.std(readings, axis=0) == pytest.approx(scatter, rel=0.15)


def test_allan_deviation_of_the_outputs():
    """White noise of channels and estimate, scaled up, from a run of 4 s: within five standard errors."""
    host = Host("inertial_sensors", accelerometer__noise_density=1e-3, accelerometer__bias_instability=0.0).run_mode()
    record = []
    for _ in range(4000):
        host.step(1e-3)
        record.append(host.get(*CHANNEL[:9], *ESTIMATE))
    spread = np.concatenate([np.ones(9), np.linalg.norm(default_sensors().estimator[:6], axis=1)])
    for width in (1, 10):
        means = np.array(record).reshape(-1, width, 15).mean(axis=1)
        found = np.sqrt(0.5 * (np.diff(means, axis=0) ** 2).mean(axis=0))
        expected = 1e-3 / np.sqrt(2.0) / np.sqrt(width * 1e-3) * spread
        assert found == pytest.approx(expected, rel=5.0 * np.sqrt(0.75 * width / 4000))


def test_a_refused_state_leaves_the_sensors_as_they_are():
    """One of accelerometers that cannot see all motion."""
    host, other = (Host("inertial_sensors", **NOISY, **TURNING).run_mode() for _ in range(2))
    host.step(H, 3)
    other.step(H, 3)
    state = host.slave._get_fmu_state()
    for k in range(1, ACCELEROMETERS):
        state.buffer[host.slave.layout.reference[f"accelerometer_{k}.enabled"]] = 0.0
    with pytest.raises(ModelError, match="cannot see six degrees of freedom"):
        host.restore(host.slave._fmu_state_to_bytes(state), 3)
    np.testing.assert_array_equal(run(host, 3), run(other, 3))
    assert host.get(*ESTIMATE) == other.get(*ESTIMATE)
