"""ManipulatorPlant and its coarse commands: where slews end, what they leave, when a linear model is made."""

import numpy as np
import pytest
from support.mechanics import to_rotation_matrix
from support.models import Host

from ps_fmu.mechanism.linear_model import momentum
from ps_fmu.mechanism.signals import output_slices, servo_slices

PLACE = output_slices()
COMMAND = np.array([1e-3, -1e-3, 5e-4])  # m; 0.2 s at the rate limit, then the servo settles
STEP = 1e-3  # s
N = 20  # coordinates
S, _, R = servo_slices(N)
POSITION, VELOCITY = slice(3, 6), slice(N + 3, N + 6)


def slew(steps, velocity_B=(0.0, 0.0, 0.0), step=STEP, command=COMMAND, **start):
    """The slave after a command in one step, on a bus at some velocity, and how many linear models it made."""
    host = Host("manipulator_plant", **start).run_mode()
    slave = host.slave
    slave.x[VELOCITY] = velocity_B  # m/s
    slave.balance.begin(slave.model, slave.x, 0.0)
    slave.view("coarse_command")[:] = command
    made = 0
    for _ in range(steps):
        model = slave.model
        host.step(step)
        made += slave.model is not model
    return slave, made


def test_slew_ends_exactly_at_the_command_and_leaves_no_momentum():
    slave, made = slew(6000, **{f"fine_leg_{i}__damping": 2e3 for i in (1, 2, 3)})
    np.testing.assert_array_equal(slave.x[S], COMMAND)
    np.testing.assert_array_equal(slave.model.centre.coarse, COMMAND)
    assert not slave.model.centre.speeds.any()
    assert 5 < made < 30
    assert np.abs(momentum(slave.model, slave.x)).max() < 2e-9  # N.s, N.m.s


def test_slew_is_the_same_on_a_bus_that_moves():
    """Galileo: a constant velocity of everything changes nothing but the position; both are components in B."""
    velocity = np.array([0.02, -0.5, 0.3])  # m/s
    (still, made), (moving, made_too) = slew(1500), slew(1500, velocity)
    assert made == made_too > 10
    q = moving.y[PLACE["base_attitude"]]
    to_B = to_rotation_matrix(q / np.linalg.norm(q)).T
    state = moving.x.copy()
    state[POSITION] -= to_B @ (1.5 * velocity)
    state[VELOCITY] -= to_B @ velocity
    others = np.delete(np.arange(len(state)), np.r_[POSITION])
    np.testing.assert_allclose(state[others], still.x[others], rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(state[POSITION], still.x[POSITION], rtol=0.0, atol=2e-10)
    assert np.abs(still.x[6:9]).max() > 1e-6  # rad, the reaction of the bus


def test_a_command_that_creeps_makes_no_new_model_until_it_stays():
    """A slew begins with less than 1e-12 m a step: each would be a pose that the legs have reached."""
    host = Host("manipulator_plant", servo__frequency=200.0).run_mode()
    slave = host.slave
    host.step(STEP)
    model = slave.model
    for k in range(1, 100):
        slave.view("coarse_command")[:] = k * 1e-13  # m
        host.step(STEP)
        assert slave.model is model
        assert np.abs(slave.x[S]).max() < 1e-11
    host.step(STEP, 200)
    np.testing.assert_array_equal(slave.model.centre.coarse, slave.view("coarse_command"))
    np.testing.assert_allclose(slave.x[S], slave.view("coarse_command"), rtol=0.0, atol=1e-24)


def test_rate_limit_and_stroke():
    host = Host("manipulator_plant").run_mode()
    slave = host.slave
    slave.view("coarse_command")[:] = 0.01, -0.01, 1e-9  # m
    host.step(STEP)
    np.testing.assert_allclose(slave.a[:3], [5e-3, -5e-3, 1e-6])  # m/s
    np.testing.assert_allclose(slave.x[R], [5e-6, -5e-6, 1e-9])
    within = slave.plant.within_stroke(np.array([0.5, -0.5, 0.01]))
    np.testing.assert_array_equal(within, [0.02, -0.02, 0.01])


def test_a_command_beyond_the_stroke_ends_at_the_stroke():
    slave, _ = slew(600, command=[0.5, -0.5, 0.01], servo__rate_limit=0.05)
    np.testing.assert_allclose(slave.x[R], [0.02, -0.02, 0.01], rtol=0.0, atol=1e-15)


def test_at_rest_at_the_command_nothing_moves():
    start = {f"coarse_command_{i}": value for i, value in zip((1, 2, 3), (0.004, -0.003, 0.002), strict=True)}
    host = Host("manipulator_plant", **start).run_mode()
    model, state = host.slave.model, host.slave.x.copy()
    host.step(STEP, 20)
    assert host.slave.model is model
    np.testing.assert_allclose(host.slave.x, state, rtol=0.0, atol=1e-16)


@pytest.mark.parametrize("step", [1e-4, 1e-3, 5e-3])
def test_a_slew_makes_few_linear_models(step):
    """A fast one of 8.5 deg; one model for each 30 um of the legs would be 400."""
    command = [0.0190, -0.0196, -0.0011]
    _, made = slew(round(0.6 / step), command=command, step=step, servo__rate_limit=0.05)
    assert 10 < made < 70


def test_fine_legs_held_at_another_length_need_one_model():
    """A constant force, and a little vibration: the model about the deformed pose at rest serves for good."""
    host = Host("manipulator_plant", **{f"fine_leg_{i}__damping": 300.0 for i in (1, 2, 3)}).run_mode()
    slave = host.slave
    slave.view("fine_force")[:] = 1.0, -0.5, 0.8  # N
    host.step(STEP, 1000)
    model = slave.model
    assert np.abs(model.centre.fine).max() > 2e-5  # m
    assert not model.centre.speeds.any()
    for k in range(500):
        slave.view("base_force")[0] = 5.0 * np.sin(0.06 * k)  # N
        host.step(STEP)
    assert slave.model is model
    np.testing.assert_allclose(slave.x[:3], [3.11e-5, -1.54e-5, 2.49e-5], rtol=0.0, atol=1e-6)
