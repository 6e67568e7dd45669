"""The plant's map in two parts makes the steps of the dense map, at rest, in a slew, and on a bus that turns."""

import numpy as np
import pytest
from support.models import Host

H = 1e-4  # s
SAME = 1e-12  # of the largest value of each vector and state: yaw alone may be nothing but rounding
SLEW = {"coarse_command_1": 0.01, "coarse_command_2": -0.005}  # m
TURN = {"initial_angular_velocity__x": 0.01, "initial_angular_velocity__z": -0.02}  # rad/s


@pytest.mark.parametrize(("parameters", "inputs"), [({}, {}), ({}, SLEW), (TURN, {})], ids=["rest", "slew", "turn"])
def test_steps_are_those_of_the_dense_map(parameters, inputs):
    host = Host("manipulator_plant", **parameters).run_mode()
    host.set(**inputs)
    slave, random = host.slave, np.random.default_rng(4)
    found, expected = [], []
    for _ in range(150):
        slave.view("base_force")[:] = 10.0 * random.standard_normal(3)
        slave.view("fine_force")[:] = 0.1 * random.standard_normal(3)
        x, model = slave.x.copy(), slave.model
        host.step(H)
        operand = np.concatenate([x, slave._source[slave.n_states :]])
        if slave.model is model:  # else an event has moved x to another centre before the step
            expected.append(slave.step_map(H) @ operand)
            found.append(slave._target.copy())
    found, expected = np.array(found), np.array(expected)
    assert len(found) > 100
    assert len(slave._core.maps) == 2
    vectors = np.array([slave.layout.describe(place).partition(".")[0] for place in range(expected.shape[1])])
    largest = np.abs(expected).max(axis=0)
    scale = np.array([largest[vectors == name].max() for name in vectors])
    assert (scale[: slave.y.size] > 0.0).sum() > 50
    assert (np.abs(found - expected).max(axis=0) <= SAME * scale).all()


def test_maps_of_a_slew_share_their_patterns():
    host = Host("manipulator_plant").run_mode()
    slave, models, patterns = host.slave, [], []
    for k in range(1500):
        host.set(coarse_command_1=2e-6 * k, coarse_command_2=-1e-6 * k)
        host.step(H)
        if slave.model not in models:
            models.append(slave.model)
            patterns.append([each.matrix.pattern for each in slave._core.maps])
    in_motion = [pattern for model, pattern in zip(models, patterns, strict=True) if model.centre.fine.any()]
    assert len(in_motion) >= 3
    assert all(one is other for pair in in_motion for one, other in zip(pair, in_motion[0], strict=True))


def test_a_prescribed_base_keeps_one_map():
    host = Host("manipulator_plant", base="prescribed").run_mode()
    host.step(H)
    assert len(host.slave._core.maps) == 1
