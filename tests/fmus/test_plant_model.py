"""ManipulatorPlant driven as a Python object: what its ports mean, coarse commands, events, its maps."""

import numpy as np
import pytest
import scipy.linalg
from support.mechanics import PAPER, to_rotation_matrix
from support.models import Host

from ps_fmu.mechanism.linear_model import momentum
from ps_fmu.mechanism.signals import output_slices, servo_slices
from ps_fmu.mechanism.stepping import Memory
from ps_fmu.slavekit.author.slave import ModelError, Refused

ORIENTATION = ("orientation.roll", "orientation.pitch", "orientation.yaw")
H = 1e-3  # s


def test_every_number_of_the_parameter_set_is_a_parameter_with_its_value() -> None:
    host = Host("manipulator_plant")
    names = ("payload.mass", "bus.mode_1.frequency", "fine_leg_2.stiffness", "bus.com.z")
    assert host.get(*names) == [14.89, 0.4545, 32051.8, -2.0]


def test_acceleration_under_a_base_force_is_newtons_law() -> None:
    host = Host("manipulator_plant", base_force__x=100.0).run_mode()
    host.step(1e-4)
    # The centre of mass lies 2 m below the base frame: force / mass, and rotation about it.
    expected = 100.0 / PAPER.bus.mass + 100.0 * 2.0**2 / PAPER.bus.inertia_B[1, 1]
    assert host.get("base_acceleration.x")[0] == pytest.approx(expected, rel=0.03)


def test_initial_outputs_follow_inputs_set_in_initialisation_mode() -> None:
    host = Host("manipulator_plant")
    assert host.get(*ORIENTATION) == pytest.approx([0.0, 0.0, 0.0], abs=1e-15)
    host.set(coarse_command_1=0.005)
    assert host.get("coarse_displacement_1") == [0.005]
    assert abs(host.get(*ORIENTATION)[0]) > 0.01
    host.set(base_force__z=10.0)
    assert host.get("base_acceleration.z")[0] > 1e-3


def test_command_beyond_the_stroke_is_held_and_said_once() -> None:
    host = Host("manipulator_plant").run_mode()
    host.set(coarse_command_3=0.05)
    host.step(H, 20)
    assert host.messages().count("coarse_command_3: 0.05 m is outside the stroke") == 1
    assert 0.0 < host.get("coarse_displacement_3")[0] <= 0.02


def test_start_beyond_the_stroke_is_held() -> None:
    host = Host("manipulator_plant", coarse_command_3=0.05).run_mode()
    assert host.get("coarse_displacement_3") == [0.02]


@pytest.mark.parametrize(
    ("start", "text"),
    [
        ({"payload__mass": 0.0}, r"payload\.mass: must be greater than 0"),
        ({"payload__truss_mode_1__mass": 20.0}, r"payload\.truss_mode_1\.mass: too large"),
        ({"bus__mode_2__participation__tz": 200.0}, r"bus\.mode_2\.participation: too large"),
        (
            {"coarse_stroke__max": 0.3, "coarse_command_1": 0.25},
            r"coarse_stroke: too large: no usable pose with the coarse legs at \(250, 0, 0\) mm",
        ),
    ],
)
def test_impossible_parameter_is_named(start: dict[str, float], text: str) -> None:
    host = Host("manipulator_plant", **start)
    with pytest.raises(ModelError, match=text):
        host.slave.exit_initialization_mode()


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_input_that_is_not_finite_is_refused_and_named(value: float) -> None:
    host = Host("manipulator_plant").run_mode()
    with pytest.raises(Refused, match=r"base_torque\.y"):
        host.set(base_torque__y=value)
    host.step(H)
    assert host.get("base_rotation.y") == [0.0]


def test_step_size_may_change() -> None:
    """Exact discretisation: the same input over the same time, whatever the steps."""
    coarse, fine = (Host("manipulator_plant", base_torque__z=3.0).run_mode() for _ in range(2))
    coarse.step(2e-3, 50)
    fine.step(1e-3, 100)
    np.testing.assert_allclose(coarse.slave.y, fine.slave.y, rtol=1e-8, atol=1e-14)


def test_rigid_variants() -> None:
    """A zero frequency or stiffness means rigid."""
    off = {f"bus__mode_{i}__frequency": 0.0 for i in range(1, 7)}
    off |= {f"payload__truss_mode_{i}__frequency": 0.0 for i in (1, 2)} | {"coarse_rods__axial_stiffness": 0.0}
    host = Host("manipulator_plant", fine_force_1=1.0, **off).run_mode()
    host.step(H, 10)
    assert sum(host.slave.step.mechanism.struct.mask) == 9
    assert host.slave.step.mechanism.n == 12
    assert host.get("fine_displacement_1")[0] > 0.0


PLACE = output_slices()
COMMAND = np.array([1e-3, -1e-3, 5e-4])  # m; 0.2 s at the rate limit, then the servo settles
N = 20  # coordinates
S, _, R = servo_slices(N)
POSITION, VELOCITY = slice(3, 6), slice(N + 3, N + 6)


def kept(slave):
    """What the plant keeps from step to step, by name."""
    return Memory.from_buffer(slave.memory)


def slew(steps, velocity_B=(0.0, 0.0, 0.0), step=H, command=COMMAND, **start):
    """The slave after a command in one step, on a bus at some velocity, and how many linear models it made."""
    host = Host("manipulator_plant", **start).run_mode()
    slave = host.slave
    slave.x[VELOCITY] = velocity_B  # m/s
    slave.step.begin(slave._core)
    slave.view("coarse_command")[:] = command
    made = set()
    for _ in range(steps):
        host.step(step)
        made.add(bytes(kept(slave).present))
    return slave, len(made)


def test_slew_ends_exactly_at_the_command_and_leaves_no_momentum():
    slave, made = slew(6000, **{f"fine_leg_{i}__damping": 2e3 for i in (1, 2, 3)})
    np.testing.assert_array_equal(slave.x[S], COMMAND)
    np.testing.assert_array_equal(kept(slave).present.coarse[:], COMMAND)
    assert not kept(slave).moving
    assert made < 5
    assert np.abs(momentum(slave.plant.linearise(COMMAND), slave.x[: 2 * N + 9])).max() < 2e-9  # N.s, N.m.s


def test_slew_is_the_same_on_a_bus_that_moves():
    """Galileo: a constant velocity of everything changes nothing but the position; both are components in B."""
    velocity = np.array([0.02, -0.5, 0.3])  # m/s
    (still, made), (moving, made_too) = slew(1500), slew(1500, velocity)
    assert made == made_too
    to_B = to_rotation_matrix(moving.y[PLACE["base_attitude"]]).T
    state = moving.x.copy()
    state[POSITION] -= to_B @ (1.5 * velocity)
    state[VELOCITY] -= to_B @ velocity
    others = np.delete(np.arange(len(state)), np.r_[POSITION])
    np.testing.assert_allclose(state[others], still.x[others], rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(state[POSITION], still.x[POSITION], rtol=0.0, atol=4e-10)
    assert np.abs(still.x[6:9]).max() > 1e-6  # rad, the reaction of the bus


def test_a_command_that_creeps_moves_nothing_until_it_stays():
    """A slew begins with less than 1e-12 m a step: each would be a pose that the legs have reached."""
    host = Host("manipulator_plant", servo__frequency=200.0).run_mode()
    slave = host.slave
    host.step(H)
    for k in range(1, 100):
        slave.view("coarse_command")[:] = k * 1e-13  # m
        host.step(H)
        assert not kept(slave).moving
        assert np.abs(slave.x[S]).max() < 1e-11
    host.step(H, 400)
    np.testing.assert_array_equal(kept(slave).present.coarse[:], slave.view("coarse_command"))
    np.testing.assert_allclose(slave.x[S], slave.view("coarse_command"), rtol=0.0, atol=1e-24)


def test_rate_limit_and_stroke():
    host = Host("manipulator_plant").run_mode()
    slave = host.slave
    slave.view("coarse_command")[:] = 0.01, -0.01, 1e-9  # m
    host.step(H)
    np.testing.assert_allclose(slave.x[R], [5e-6, -5e-6, 1e-9])
    within = slave.plant.within_stroke(np.array([0.5, -0.5, 0.01]))
    np.testing.assert_array_equal(within, [0.02, -0.02, 0.01])


def test_a_command_beyond_the_stroke_ends_at_the_stroke():
    slave, _ = slew(600, command=[0.5, -0.5, 0.01], servo__rate_limit=0.05)
    np.testing.assert_allclose(slave.x[R], [0.02, -0.02, 0.01], rtol=0.0, atol=1e-15)


def test_at_rest_at_the_command_nothing_moves():
    start = {f"coarse_command_{i}": value for i, value in zip((1, 2, 3), (0.004, -0.003, 0.002), strict=True)}
    host = Host("manipulator_plant", **start).run_mode()
    state = host.slave.x.copy()
    host.step(H, 20)
    assert not kept(host.slave).moving
    np.testing.assert_allclose(host.slave.x, state, rtol=0.0, atol=1e-16)


def test_fine_legs_held_at_another_length_rest_there():
    """A constant force, and a little vibration: the model about the deformed pose at rest serves for good."""
    host = Host("manipulator_plant", **{f"fine_leg_{i}__damping": 300.0 for i in (1, 2, 3)}).run_mode()
    slave = host.slave
    slave.view("fine_force")[:] = 1.0, -0.5, 0.8  # N
    host.step(H, 1500)
    before = bytes(kept(slave).present)
    assert np.abs(kept(slave).present.fine).max() > 2e-5  # m
    assert not kept(slave).moving
    for k in range(500):
        slave.view("base_force")[0] = 5.0 * np.sin(0.06 * k)  # N
        host.step(H)
    assert bytes(kept(slave).present) == before
    np.testing.assert_allclose(slave.x[:3], [3.11e-5, -1.54e-5, 2.49e-5], rtol=0.0, atol=1e-6)


def test_forces_that_hold_fine_legs_give_no_momentum():
    """A force of a fine leg acts on both of its ends.  A creep of 1e-6 m under it must not push the whole."""
    host = Host("manipulator_plant", **{f"fine_leg_{i}__damping": 300.0 for i in (1, 2, 3)}).run_mode()
    slave, force = host.slave, np.array([1.0, -0.5, 0.8])  # N
    slave.view("fine_force")[:] = force
    host.step(H, 1500)
    model = slave.plant.linearise(np.zeros(3))  # whose masses are those at 3e-5 m, to 1e-4 of them
    before = momentum(model, slave.x[: model.n_states])
    for k in range(4000):
        slave.view("fine_force")[:] = force * (1.0 - 5e-6 * k)
        host.step(H)
    assert not kept(slave).moving
    assert np.abs(momentum(model, slave.x[: model.n_states]) - before).max() < 1e-8  # N.s, N.m.s


FINE = 1e-4  # s
SAME = 1e-11  # of the largest value of each vector and state: yaw alone may be nothing but rounding


@pytest.mark.parametrize("command", [(0.0, 0.0, 0.0), (0.012, -0.007, 0.004)])
def test_steps_at_rest_are_those_of_the_linear_model(command):
    """The matrices of PlantModel, with another exponential."""
    host = Host("manipulator_plant", **{f"coarse_command_{i}": each for i, each in enumerate(command, 1)}).run_mode()
    slave, random = host.slave, np.random.default_rng(4)
    model = slave.plant.linearise(np.array(command))
    A, B, C, D = model.matrices()
    n, m = B.shape
    both = scipy.linalg.expm(FINE * np.vstack([np.hstack([A, B]), np.zeros((m, n + m))]))
    u, x, found, expected = np.zeros(m), slave.x[:n].copy(), [], []
    u[-1] = 1.0
    for _ in range(150):
        u[:18] = 0.1 * random.standard_normal(18)
        slave.u[:18] = u[:18]
        host.step(FINE)
        x = both[:n] @ np.concatenate([x, u])
        found.append(np.concatenate([slave.y[: len(C)], slave.x[:n]]))
        expected.append(np.concatenate([C @ x + D @ u, x]))
    assert not kept(slave).moving
    found, expected = np.array(found), np.array(expected)
    places = {**PLACE, **{f"state {k}": slice(len(C) + k, len(C) + k + 1) for k in range(n)}}
    for name, place in places.items():
        close = max(SAME * np.abs(expected[:, place]).max(), 1e-16)
        np.testing.assert_allclose(found[:, place], expected[:, place], rtol=0.0, atol=close, err_msg=name)

