"""Residual jitter behind real accelerometers: limits, statics, lever arms."""

from dataclasses import replace

import numpy as np
import pytest
from support.claims import verify_claim

from ps_fmu.control.pointing import PointingLaw
from ps_fmu.mechanism.parameters import load
from ps_fmu.mechanism.quantities import replace_values
from ps_fmu.sensors.inertial import default_sensors
from ps_fmu.theory.line_of_sight import PointingLoop, Timing
from ps_fmu.theory.loop import loop_at
from ps_fmu.theory.sampled import LOOP_DELAY
from ps_fmu.theory.sensed_isolation import (
    SensedIsolation,
    estimate_density,
    estimated_bias,
    line_of_sight,
    sensing_response,
    with_noise,
)
from ps_fmu.theory.transmissibility import jitter

STEP = 1e-4  # s


@pytest.fixture(scope="module")
def isolation():
    p = load()
    return SensedIsolation(loop_at(p), p.bus, p.noise, STEP, points=600)


def rms(responses, density):
    return np.sqrt(np.diag(responses.covariance(density)))


def test_with_ideal_sensors_it_is_the_known_jitter(isolation):
    """Off: passive.  With unlimited bandwidth the sensors cost one step of delay more."""
    p = load()
    off, ideal = isolation.solve(None, 1.0), replace_values(default_sensors(), {"accelerometer.bandwidth": 0.0})
    assert not off.to_noise.any()
    passive = jitter(isolation.loop, p.bus, p.noise, 1.0, active=False)
    assert rms(off, off.disturbance_density) == pytest.approx(passive.rms, rel=5e-3)
    on = isolation.solve(ideal, p.filters.highpass_frequency)
    active = jitter(isolation.loop.with_delay((LOOP_DELAY + 1.0) * STEP), p.bus, p.noise, 1.0, active=True)
    assert rms(on, on.disturbance_density) == pytest.approx(active.rms, rel=5e-3)


def test_a_constant_error_ends_as_the_rotation_that_the_isolator_believes_in(isolation):
    """The payload turns back by the high-passed double integral of the error: bias over frequency squared."""
    bias = np.array([0.0, 0.0, 0.0, 1e-6, -2e-6, 3e-6])  # rad/s2
    highpasses = (1e-4, 0.01, 0.05)  # Hz; from 0.5 Hz on the force K_a times the error adds 3 %
    offsets = [isolation.solve(default_sensors(), highpass).offset(bias) for highpass in highpasses]
    truths = [-bias[3:] / (2.0 * np.pi * highpass) ** 2 for highpass in highpasses]
    verify_claim(
        "sensor.offset",
        claim="A constant bias ends as a constant offset, of bias over high-pass frequency squared",
        where="`ps-fmu analyse sensors`: terminal, report",
        reference="high-passed double integral of a constant, by hand",
        error=np.abs(np.array(offsets) / truths - 1.0),
        bound=4e-3,
    )
    one = replace_values(default_sensors(), {"accelerometer_4.bias": 1e-5})
    assert estimated_bias(one) == pytest.approx(1e-5 * default_sensors().estimator[:6, 3])


def test_noise_is_linear_in_its_density_and_falls_with_the_highpass(isolation):
    """White noise of angular acceleration above a high-pass far below the suspension: variance as its frequency^-3."""
    sensors = with_noise(default_sensors(), 1e-7)
    low, high = (isolation.solve(sensors, highpass) for highpass in (0.02, 0.04))
    variances = [np.diag(found.covariance(found.noise_density(sensors))) for found in (low, high)]
    assert variances[0] / variances[1] == pytest.approx(8.0, rel=0.05)
    double = with_noise(default_sensors(), 2e-7)
    assert low.noise_density(double) == pytest.approx(4.0 * low.noise_density(sensors))
    # In closed form: an integral of D^2 / |s^2 + 2 z w s + w^2|^2 is D^2 / (8 z w^3) in f.
    spread = np.linalg.norm(sensors.estimator[3:6], axis=1)
    omega = 2.0 * np.pi * 0.02
    expected = (1e-7 * spread) ** 2 / (8.0 * np.sqrt(0.5) * omega**3)
    assert variances[0] == pytest.approx(expected, rel=0.03)


def test_density_of_the_estimate_goes_through_the_lever_arms():
    near, f = with_noise(default_sensors(), 1.0), np.array([1.0, 100.0])
    far = replace(near, accelerometers=tuple(replace(a, position_B=2.0 * a.position_B) for a in near.accelerometers))
    ratio = estimate_density(far, f, STEP)[0] / np.where(np.eye(6) > 0.0, estimate_density(near, f, STEP)[0], np.inf)
    assert np.diag(ratio) == pytest.approx([1.0] * 3 + [0.25] * 3)
    held = replace(near, sample_time=1e-2)
    first_zero = np.array([100.0])  # Hz: of a value held for 10 ms
    assert np.abs(estimate_density(held, first_zero, STEP)).max() < 1e-20
    late = replace(near, latency=3e-3)
    assert np.angle(sensing_response(late, f[:1], STEP) / sensing_response(near, f[:1], STEP)) == pytest.approx(
        -2.0 * np.pi * 3e-3
    )


def test_a_line_of_sight_loop_is_that_of_its_own_theory(isolation):
    """With sensors without bandwidth, but for the step that the sensors cost."""
    ideal = replace_values(default_sensors(), {"accelerometer.bandwidth": 0.0})
    control = PointingLaw.from_parameters(load()).controller(np.zeros(3))
    timing = Timing(sample_time=0.01, latency=0.01, step=STEP)
    found = isolation.solve(ideal, 0.5, (control, timing))
    controller = isolation.loop.controller
    slower = replace(controller, filters=replace(controller.filters, highpass_frequency=0.5))
    delayed = replace(isolation.loop, controller=slower, delay=(LOOP_DELAY + 1.0) * STEP)
    some = slice(None, None, 50)
    s = 2j * np.pi * isolation.frequency[some]
    closed = PointingLoop(delayed, control, timing)
    K = slower.response(s) * np.exp(s * (STEP - delayed.delay))[:, None, None]
    expected = np.linalg.solve(np.eye(3) + closed.transfer(s), closed.plant(s) @ K)
    assert found.to_noise[some] == pytest.approx(expected, rel=1e-3, abs=1e-3 * np.abs(expected).max())
    assert line_of_sight(np.diag([9.0, 16.0, 100.0])) == 5.0


@pytest.mark.parametrize("gain_db", [0.0, 7.0, 8.4, 9.0, 12.0])
@pytest.mark.parametrize("sensed", [False, True])
def test_it_is_stable_where_the_loop_of_its_own_theory_is(isolation, gain_db, sensed):
    """Of a line-of-sight loop with more and more gain, isolator on and off."""
    law, highpass = PointingLaw.from_parameters(load()), 0.02  # Hz
    design = replace(law.loop, crossover_frequency=1.25 * 10.0 ** (gain_db / 20.0))
    control, timing = law.with_design(design).controller(np.zeros(3)), Timing(0.01, 0.01, STEP)
    controller = isolation.loop.controller
    tuned = replace(controller, filters=replace(controller.filters, highpass_frequency=highpass))
    loop = replace(isolation.loop, controller=tuned, delay=(LOOP_DELAY + 1.0) * STEP)
    ideal = replace_values(default_sensors(), {"accelerometer.bandwidth": 0.0})
    stable = not len(PointingLoop(loop, control, timing, isolated=sensed).unstable)
    assert isolation.is_stable(ideal if sensed else None, highpass, (control, timing)) == stable


def test_a_delay_beyond_the_limit_of_the_isolator_is_unstable():
    """The lighter support module stands 91.68 ms, of which exchange and sensors take 2.5 steps."""
    p = load(bus="LSM")
    ideal = replace_values(default_sensors(), {"accelerometer.bandwidth": 0.0})
    limit = loop_at(p).delay_limit - (LOOP_DELAY + 1.0) * STEP
    for share, stable in ((0.999, True), (1.001, False)):
        late = SensedIsolation(loop_at(p, delay=share * limit), p.bus, p.noise, STEP)
        assert late.is_stable(ideal, p.filters.highpass_frequency) == stable
