"""The plant as a linear system: against the transfer matrices, conservation laws, exact steps."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.signal
from scipy.linalg import expm
from support.mechanics import PAPER, relative_error

from ps_fmu.mechanism.discretisation import zero_order_hold
from ps_fmu.mechanism.dynamics import Pose
from ps_fmu.mechanism.forward_kinematics import forward_kinematics
from ps_fmu.mechanism.linear_model import N_INPUTS, N_OUTPUTS, OUTPUTS, Plant, momentum, output_slices, servo_slices
from ps_fmu.mechanism.rotations import rotation_from_vector
from ps_fmu.mechanism.slews import Convection, coarse_motion
from ps_fmu.theory.transfer_matrices import Practical

PLANT = Plant.from_parameters(PAPER)
STILL = np.zeros(3)
REST = np.array([0.0] * (N_INPUTS - 1) + [1.0])  # no force, no motion, the constant 1
SLOPE = np.array([0.004, -0.003, 0.002])  # m
PLACE = output_slices()
S, DS, R = servo_slices(20)


def test_state_space_is_the_practical_plant() -> None:
    model = PLANT.linearise(SLOPE)
    A, B, C, D = model.matrices()
    practical = Practical(model.dynamics)
    s = 2j * np.pi * np.geomspace(0.1, 400.0, 25)
    response = C @ np.linalg.solve(s[:, None, None] * np.eye(len(A)) - A, B.astype(complex)) + D
    R_PB = model.dynamics.pose.rotation_BP.T
    rotation = response[:, PLACE["payload_rotation"]]
    assert relative_error(rotation[..., 0:3], R_PB @ practical.A(s)) < 1e-8
    assert relative_error(rotation[..., 3:9], R_PB @ practical.B(s)) < 1e-8
    acceleration = response[:, 0:6]
    s2 = (s * s)[:, None, None]
    assert relative_error(acceleration[..., 0:3], s2 * practical.C(s)) < 1e-8
    assert relative_error(acceleration[..., 3:9], s2 * practical.D(s)) < 1e-8


def test_step_is_exact_for_a_held_input() -> None:
    """One long step equals many short ones, and both equal the exponential."""
    model = PLANT.linearise(STILL)
    rng = np.random.default_rng(3)
    x, u = rng.normal(size=model.n_states) * 1e-4, rng.normal(size=N_INPUTS)
    p = N_OUTPUTS
    once = model.step_map(1e-3) @ np.concatenate([x, u])
    short, state = model.step_map(1e-4), x
    for _ in range(10):
        result = short @ np.concatenate([state, u])
        state = result[p:]
    np.testing.assert_allclose(result, once, rtol=1e-9, atol=1e-12 * np.abs(once).max())


def test_zero_order_hold_of_a_double_integrator() -> None:
    Ad, Bd = zero_order_hold(np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[0.0], [1.0]]), 0.5)
    np.testing.assert_allclose(Ad, [[1.0, 0.5], [0.0, 1.0]])
    np.testing.assert_allclose(Bd, [[0.125], [0.5]])


def test_outputs_at_rest_are_the_pose() -> None:
    model = PLANT.linearise(SLOPE)
    x = PLANT.initial_state(model)
    y = model.output_map() @ np.concatenate([x, REST])
    np.testing.assert_allclose(y[PLACE["orientation"]], model.rpy, atol=1e-16)
    np.testing.assert_allclose(y[PLACE["relative_orientation"]], model.rpy, atol=1e-16)
    np.testing.assert_allclose(y[PLACE["coarse_displacement"]], SLOPE, atol=1e-18)
    others = np.delete(y, np.r_[PLACE["orientation"], PLACE["relative_orientation"], PLACE["coarse_displacement"]])
    np.testing.assert_allclose(others, 0.0, atol=1e-12)


def test_orientation_follows_forward_kinematics_to_first_order() -> None:
    model, near = PLANT.linearise(SLOPE), 1e-5 * np.array([1.0, -2.0, 0.5])
    x = PLANT.initial_state(model)
    x[S] = SLOPE + near
    y = model.output_map() @ np.concatenate([x, REST])
    np.testing.assert_allclose(y[PLACE["orientation"]], PLANT.linearise(SLOPE + near).rpy, atol=2e-8)


def test_outputs_are_those_of_the_moved_mechanism() -> None:
    """Frames and signs, against legs of other lengths on a base that has moved; first order in the motion."""
    plant = replace(PLANT, optics=replace(PLANT.optics, focal_length=2.5))
    model = plant.linearise(SLOPE)
    d, pose = model.dynamics, model.dynamics.pose
    x = plant.initial_state(model)
    x[: 2 * d.n] = 1e-7 * np.random.default_rng(6).normal(size=2 * d.n)  # m, rad, m/s, rad/s
    y = model.output_map() @ np.concatenate([x, REST])
    found = {group: y[place] for group, place in PLACE.items()}
    d_f, e_c = x[d.slices["d_f"]], x[d.slices["e_c"]]
    t_b, theta_b = x[3:6], x[6:9]

    geometry = plant.manipulator.geometry
    lengths = geometry.nominal_lengths + np.concatenate([SLOPE + e_c, d_f])
    relative = forward_kinematics(geometry, lengths)
    base = rotation_from_vector(theta_b)
    turned = base @ relative.R @ pose.rotation_BP.T  # of the platform, in B
    theta_B = 0.5 * np.array([turned[2, 1] - turned[1, 2], turned[0, 2] - turned[2, 0], turned[1, 0] - turned[0, 1]])
    theta_P = pose.rotation_BP.T @ theta_B
    boresight_P = pose.rotation_BP.T @ turned @ pose.rotation_BP @ [0.0, 0.0, 1.0]
    expected = {
        "base_velocity": x[d.n + 3 : d.n + 6],
        "base_angular_velocity": x[d.n + 6 : d.n + 9],
        "base_position": t_b,
        "base_rotation": theta_b,
        "payload_position": t_b + base @ relative.translation_B - pose.translation_B,
        "payload_rotation": theta_P,
        "fine_displacement": d_f,
        "coarse_displacement": SLOPE,
        "orientation": model.rpy,
        "relative_orientation": relative.orientation,
        "los": 2.5 * boresight_P[:2],
    }
    assert set(expected) == {signal.name for signal in OUTPUTS if "acceleration" not in signal.name}
    for group, value in expected.items():
        np.testing.assert_allclose(found[group], value, rtol=0.0, atol=1e-10, err_msg=group)
    assert np.abs(relative.orientation - model.rpy).min() > 1e-8


def test_momentum_of_a_pushed_free_body() -> None:
    """A constant force for one second leaves exactly its impulse in the bus rows."""
    model = PLANT.linearise(STILL)
    u = np.zeros(N_INPUTS)
    u[3:9] = [1.0, 2.0, -1.0, 0.3, 0.2, -0.1]
    x = (model.step_map(1.0) @ np.concatenate([np.zeros(model.n_states), u]))[N_OUTPUTS :]
    np.testing.assert_allclose(momentum(model, x), u[3:9], rtol=1e-9, atol=1e-11)


def test_internal_forces_leave_the_momentum_alone() -> None:
    model = PLANT.linearise(STILL)
    n = model.dynamics.n
    u = REST.copy()
    u[:3], u[9:12] = [5.0, -3.0, 2.0], [2e-3, -3e-3, 1e-3]  # fine forces and a coarse motion
    x = (model.step_map(0.37) @ np.concatenate([np.zeros(model.n_states), u]))[N_OUTPUTS :]
    assert np.abs(momentum(model, x)).max() < 1e-9
    assert np.abs(x[n : 2 * n]).max() > 1e-4  # and yet it moves


def test_new_pose_owes_the_bus_the_momentum_it_takes() -> None:
    """Coordinates and velocities are carried over; what they lose in momentum comes back as a wrench."""
    old, h = PLANT.linearise(STILL), 1e-3
    x, n = np.random.default_rng(5).normal(size=old.n_states), old.dynamics.n
    x[S], x[R] = SLOPE, SLOPE
    x[n + 3 : n + 6] -= momentum(old, x)[:3] / old.dynamics.M[3, 3]  # m/s: the common centre of mass rests
    convection = Convection(np.zeros(6), since_pose=5 * h)
    motion = coarse_motion(PLANT, old, x, convection, SLOPE, h, 1e-5)
    assert motion.model is not old
    np.testing.assert_array_equal(motion.state, x)
    owed = momentum(old, x) - momentum(motion.model, x)
    given, convection = motion.wrench * h, motion.convection
    for _ in range(10):
        wrench, convection = convection.step(h)
        given = given + wrench * h
    np.testing.assert_allclose(given, owed, rtol=1e-9)  # differences of momenta up to 1e4
    assert not convection.owed.any()
    np.testing.assert_allclose(motion.wrench, owed / (5 * h), rtol=1e-9)


def test_convective_wrench_acts_as_long_as_the_pose_before_lasted() -> None:
    h, taken = 1e-3, np.arange(1.0, 7.0)
    convection = Convection(np.zeros(6))
    for _ in range(4):
        wrench, convection = convection.step(h)
        assert not wrench.any()
    convection, given = convection.at_new_pose(taken), []
    for _ in range(6):
        wrench, convection = convection.step(h)
        given.append(wrench)
    np.testing.assert_allclose(given, np.outer([1, 1, 1, 1, 0, 0], taken / (4 * h)))
    # The next pose, after six steps, begins with what is owed by then.
    convection = convection.at_new_pose(taken)
    for _ in range(2):
        wrench, convection = convection.step(h)
    wrench, _ = convection.at_new_pose(taken).step(h)
    np.testing.assert_allclose(wrench, (taken + 4.0 / 6.0 * taken) / (2 * h))


@pytest.mark.parametrize("damping_ratio", [0.3, 1.0, 2.0])
def test_servos_are_second_order(damping_ratio: float) -> None:
    servo = replace(PLANT.servo, frequency=3.0, damping_ratio=damping_ratio)
    model = replace(PLANT, servo=servo).linearise(STILL)
    x, times = np.zeros(model.n_states), np.arange(1, 200) * 5e-3  # s
    x[R] = [1e-3, -2e-3, 0.0]  # m
    step, found = model.step_map(5e-3), []
    for _ in times:
        x = (step @ np.concatenate([x, REST]))[N_OUTPUTS :]
        found.append(x[S])
    omega = 2.0 * np.pi * 3.0  # rad/s
    _, expected = scipy.signal.step(([omega**2], [1.0, 2.0 * damping_ratio * omega, omega**2]), T=np.r_[0.0, times])
    np.testing.assert_allclose(found, np.outer(expected[1:], [1e-3, -2e-3, 0.0]), rtol=0.0, atol=1e-12)


def run_slew(
    plant: Plant, command: np.ndarray, h: float, steps: int, velocity_B: np.ndarray = STILL
) -> tuple[np.ndarray, object, int]:
    """A step command to a bus at some velocity, as the FMU executes it: state at the end, model, number of poses."""
    model = plant.linearise(STILL)
    x, u, poses, moving, convection = plant.initial_state(model), REST.copy(), 1, True, Convection(np.zeros(6))
    x[23:26] = velocity_B  # m/s
    step = model.step_map(h)
    for _ in range(steps):
        if moving:
            motion = coarse_motion(plant, model, x, convection, command, h, 5e-5)
            if motion.model is not model:
                step, poses = motion.model.step_map(h), poses + 1
            model, x, convection, moving = motion.model, motion.state, motion.convection, motion.moving
            u[9:12], u[12:18] = motion.rate, motion.wrench
        x = (step @ np.concatenate([x, u]))[N_OUTPUTS :]
    return x, model, poses


def test_slew_ends_exactly_at_the_command_and_leaves_no_momentum() -> None:
    command = np.array([1e-3, -1e-3, 5e-4])  # m; 0.2 s at the rate limit, then the servo settles
    plant = replace(PLANT, servo=replace(PLANT.servo, rate_limit=0.005))
    x, model, poses = run_slew(plant, command, 1e-3, 3000)
    np.testing.assert_array_equal(model.coarse_reference, command)
    assert 15 < poses < 30
    assert np.abs(momentum(model, x)).max() < 1e-9


def test_slew_is_the_same_on_a_bus_that_moves() -> None:
    """Galileo: a constant velocity of everything changes nothing but the position."""
    command, velocity_B = np.array([1e-3, -1e-3, 5e-4]), np.array([0.02, -0.5, 0.3])  # m, m/s
    still, _, _ = run_slew(PLANT, command, 1e-3, 1500)
    moving, _, _ = run_slew(PLANT, command, 1e-3, 1500, velocity_B)
    moving[3:6] -= 1.5 * velocity_B
    moving[23:26] -= velocity_B
    np.testing.assert_allclose(moving, still, rtol=0.0, atol=1e-12)
    assert np.abs(still[6:9]).max() > 1e-6  # rad, the reaction of the bus


def test_a_command_that_creeps_makes_no_new_pose_until_it_stays() -> None:
    """A slew begins with less than 1e-12 m a step: each would be a pose that the legs have reached."""
    model = PLANT.linearise(SLOPE)
    x, convection = PLANT.initial_state(model), Convection(np.zeros(6))
    for k in range(1, 6):
        command = SLOPE + k * 1e-13  # m
        motion = coarse_motion(PLANT, model, x, convection, command, 1e-4, 1e-4)
        assert motion.model is model
        assert motion.moving
        x, convection = motion.state, motion.convection
        np.testing.assert_array_equal(x[S], command)
    motion = coarse_motion(PLANT, model, x, convection, command, 1e-4, 1e-4)
    np.testing.assert_array_equal(motion.model.coarse_reference, command)


def test_rate_limit_and_stroke() -> None:
    model = PLANT.linearise(STILL)
    command = np.array([0.01, -0.01, 1e-9])
    motion = coarse_motion(PLANT, model, PLANT.initial_state(model), Convection(np.zeros(6)), command, 1e-3, 1e-4)
    np.testing.assert_allclose(motion.rate, [5e-3, -5e-3, 1e-6])  # m/s
    assert motion.moving
    np.testing.assert_array_equal(PLANT.within_stroke(np.array([0.5, -0.5, 0.01])), [0.02, -0.02, 0.01])


def test_at_rest_at_the_command_nothing_moves() -> None:
    model = PLANT.linearise(SLOPE)
    x = PLANT.initial_state(model)
    motion = coarse_motion(PLANT, model, x, Convection(np.zeros(6)), SLOPE, 1e-3, 1e-4)
    assert motion.model is model
    assert not motion.moving
    np.testing.assert_array_equal(motion.state, x)


def test_inactive_coordinates_stay_zero() -> None:
    rods = replace(PAPER.manipulator.coarse_rods, axial_stiffness=0.0)
    plant = replace(PLANT, manipulator=replace(PAPER.manipulator, coarse_rods=rods))
    model = plant.linearise(STILL)
    e_c = model.dynamics.slices["e_c"]
    u = np.concatenate([np.ones(9), 1e-3 * np.ones(3), np.zeros(6), [1.0]])
    x = (model.step_map(0.1) @ np.concatenate([plant.initial_state(model), u]))[N_OUTPUTS :]
    np.testing.assert_array_equal(x[e_c], 0.0)
    assert np.abs(x[0:3]).min() > 0.0


def test_same_displacement_same_bits() -> None:
    """What a restored FMU state relies on."""
    first, second = PLANT.linearise(SLOPE), PLANT.linearise(SLOPE.copy())
    np.testing.assert_array_equal(first.step_map(1e-4), second.step_map(1e-4))
    assert isinstance(first.dynamics.pose, Pose)


def test_exponential_agrees_with_a_finer_one() -> None:
    """The plant is stiff (370 Hz) and free (double integrators): the scaled exponential has all its digits."""
    A, B, _, _ = PLANT.linearise(STILL).matrices()
    Ad, _ = zero_order_hold(A, B, 1e-2)
    fine = expm(A * (1e-2 / 64.0))
    assert np.abs(Ad - np.linalg.matrix_power(fine, 64)).max() < 1e-9 * np.abs(Ad).max()


def test_parameters_are_used_as_given() -> None:
    heavier = replace(PLANT, payload=replace(PAPER.payload, mass=20.0)).linearise(STILL)
    assert heavier.dynamics.M[3, 3] - PLANT.linearise(STILL).dynamics.M[3, 3] == pytest.approx(20.0 - 14.89)
