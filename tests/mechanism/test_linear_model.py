"""The plant as a linear system: against the transfer matrices, conservation laws, exact steps."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.signal
from scipy.linalg import expm
from support.mechanics import PAPER, relative_error, to_rotation_matrix

from ps_fmu.mechanism.discretisation import zero_order_hold
from ps_fmu.mechanism.kinematics import forward_kinematics
from ps_fmu.mechanism.linear_model import Plant, momentum
from ps_fmu.mechanism.parameters import Optics
from ps_fmu.mechanism.quantities import ParameterError
from ps_fmu.mechanism.rotations import (
    GimbalLockError,
    from_rotation_matrix,
    from_rotation_vector,
    rotation_from_vector,
)
from ps_fmu.mechanism.signals import N_EXTERNAL, N_INPUTS, N_OUTPUTS, OUTPUTS, output_slices, servo_slices
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


def test_outputs_at_rest_are_the_pose() -> None:
    model = PLANT.linearise(SLOPE)
    x = PLANT.initial_state(model)
    y = model.output_map() @ np.concatenate([x, REST])
    np.testing.assert_allclose(y[PLACE["orientation"]], model.rpy, atol=1e-16)
    np.testing.assert_allclose(y[PLACE["relative_orientation"]], model.rpy, atol=1e-16)
    np.testing.assert_allclose(y[PLACE["coarse_displacement"]], SLOPE, atol=1e-18)
    np.testing.assert_array_equal(y[PLACE["base_attitude"]], [1.0, 0.0, 0.0, 0.0])
    R = to_rotation_matrix(y[PLACE["payload_attitude"]])
    np.testing.assert_allclose(R, model.dynamics.pose.rotation_BP, rtol=0.0, atol=1e-15)
    absolute = ("orientation", "relative_orientation", "coarse_displacement", "base_attitude", "payload_attitude")
    others = np.delete(y, np.concatenate([np.r_[PLACE[name]] for name in absolute]))
    np.testing.assert_allclose(others, 0.0, atol=1e-12)


def test_orientation_follows_forward_kinematics_to_first_order() -> None:
    model, near = PLANT.linearise(SLOPE), 1e-5 * np.array([1.0, -2.0, 0.5])
    x = PLANT.initial_state(model)
    x[S] = SLOPE + near
    y = model.output_map() @ np.concatenate([x, REST])
    np.testing.assert_allclose(y[PLACE["orientation"]], PLANT.linearise(SLOPE + near).rpy, atol=2e-8)


def test_outputs_are_those_of_the_moved_mechanism() -> None:
    """Frames and signs, against legs of other lengths on a base that has moved; first order in the motion."""
    plant = replace(PLANT, optics=Optics(focal_length=2.5, truss_sensitivity=3.0))
    attitude = from_rotation_vector(np.array([0.3, -2.0, 0.7]))
    model = plant.linearise(SLOPE, attitude)
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
    to_inertial = to_rotation_matrix(attitude) @ base
    truss_x, truss_y = x[d.slices["x_t"]]  # m, along x and y of P
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
        "fine_velocity": x[d.n : d.n + 3],
        "line_of_sight": theta_P[:2] + 3.0 * np.array([-truss_y, truss_x]),
        "base_attitude": from_rotation_matrix(to_inertial),
        "payload_attitude": from_rotation_matrix(to_inertial @ relative.R),
    }
    assert set(expected) == {signal.name for signal in OUTPUTS if "acceleration" not in signal.name}
    for group, value in expected.items():
        if "attitude" in group:
            value = value * np.sign(value @ found[group])  # q and -q are the same turn
        np.testing.assert_allclose(found[group], value, rtol=0.0, atol=1e-10, err_msg=group)
    assert np.abs(relative.orientation - model.rpy).min() > 1e-8


def test_momentum_of_a_pushed_free_body() -> None:
    """A constant force for one second leaves exactly its impulse in the bus rows."""
    model = PLANT.linearise(STILL)
    u = np.zeros(N_INPUTS)
    u[3:9] = [1.0, 2.0, -1.0, 0.3, 0.2, -0.1]
    x = (model.step_map(1.0) @ np.concatenate([np.zeros(model.n_states), u]))[N_OUTPUTS:]
    np.testing.assert_allclose(momentum(model, x), u[3:9], rtol=1e-9, atol=1e-11)


def test_internal_forces_leave_the_momentum_alone() -> None:
    model = PLANT.linearise(STILL)
    n = model.dynamics.n
    u = REST.copy()
    u[:3], u[9:12], u[18:21] = [5.0, -3.0, 2.0], [0.0, 1.0, -1.0], [2e-3, -3e-3, 1e-3]  # fine forces, a coarse motion
    x = (model.step_map(0.37) @ np.concatenate([np.zeros(model.n_states), u]))[N_OUTPUTS:]
    assert np.abs(momentum(model, x)).max() < 1e-9
    assert np.abs(x[n : 2 * n]).max() > 1e-4  # and yet it moves


def test_force_on_the_payload_leaves_its_impulse_about_the_base() -> None:
    """It acts in the axes of P at its origin."""
    model = PLANT.linearise(SLOPE)
    pose, u = model.dynamics.pose, np.zeros(N_INPUTS)
    force_P, torque_P = np.array([1.0, -2.0, 0.5]), np.array([0.3, 0.2, -0.1])  # N, N.m
    u[12:18] = np.concatenate([force_P, torque_P])
    x = (model.step_map(0.5) @ np.concatenate([np.zeros(model.n_states), u]))[N_OUTPUTS:]
    force_B, torque_B = pose.rotation_BP @ force_P, pose.rotation_BP @ torque_P
    torque_B = torque_B + np.cross(pose.translation_B, force_B)
    np.testing.assert_allclose(momentum(model, x), 0.5 * np.concatenate([force_B, torque_B]), rtol=1e-8, atol=1e-10)


def test_added_fine_forces_add_up() -> None:
    model, u = PLANT.linearise(SLOPE), np.zeros((2, N_INPUTS))
    u[0, 0:3], u[1, 0:3], u[1, 9:12] = [3.0, -1.0, 2.0], [1.0, -2.0, 2.5], [2.0, 1.0, -0.5]  # N
    both = np.concatenate([model.output_map(), model.step_map(1e-3)])[:, model.n_states :]
    once, twice = both @ u[0], both @ u[1]
    np.testing.assert_allclose(once, twice, rtol=1e-12, atol=1e-15)


def test_a_bus_that_turns_at_the_start_has_its_centre_of_mass_at_rest() -> None:
    model, turn_B = PLANT.linearise(SLOPE), np.array([0.02, -0.01, 0.03])  # rad/s
    x = PLANT.initial_state(model, turn_B)
    np.testing.assert_array_equal(x[26:29], turn_B)
    assert np.abs(momentum(model, x)[:3]).max() < 1e-12
    assert np.abs(x[23:26]).max() > 1e-3  # m/s


@pytest.mark.parametrize("damping_ratio", [0.3, 1.0, 2.0])
def test_servos_are_second_order(damping_ratio: float) -> None:
    servo = replace(PLANT.servo, frequency=3.0, damping_ratio=damping_ratio)
    model = replace(PLANT, servo=servo).linearise(STILL)
    x, times = np.zeros(model.n_states), np.arange(1, 200) * 5e-3  # s
    x[R] = [1e-3, -2e-3, 0.0]  # m
    step, found = model.step_map(5e-3), []
    for _ in times:
        x = (step @ np.concatenate([x, REST]))[N_OUTPUTS:]
        found.append(x[S])
    omega = 2.0 * np.pi * 3.0  # rad/s
    _, expected = scipy.signal.step(([omega**2], [1.0, 2.0 * damping_ratio * omega, omega**2]), T=np.r_[0.0, times])
    np.testing.assert_allclose(found, np.outer(expected[1:], [1e-3, -2e-3, 0.0]), rtol=0.0, atol=1e-12)


def test_inactive_coordinates_stay_zero() -> None:
    rods = replace(PAPER.manipulator.coarse_rods, axial_stiffness=0.0)
    plant = replace(PLANT, manipulator=replace(PAPER.manipulator, coarse_rods=rods))
    model = plant.linearise(STILL)
    e_c = model.dynamics.slices["e_c"]
    u = np.concatenate([np.ones(N_EXTERNAL), 1e-3 * np.ones(3), [1.0]])
    x = (model.step_map(0.1) @ np.concatenate([plant.initial_state(model), u]))[N_OUTPUTS:]
    np.testing.assert_array_equal(x[e_c], 0.0)
    assert np.abs(x[0:3]).min() > 0.0


@pytest.mark.parametrize("h", [1e-6, 1e-4, 1.8e-4, 2.5e-4])  # s: the series up to 1.9e-4 s
def test_series_for_short_steps_is_the_exponential(h: float) -> None:
    A, B, _, _ = PLANT.linearise(SLOPE).matrices()
    n, m = B.shape
    augmented = np.zeros((n + m, n + m))
    augmented[:n] = np.hstack([A, B]) * h
    expected, found = expm(augmented), np.hstack(zero_order_hold(A, B, h))
    assert (np.abs(found - expected[:n]) <= 2e-15 * np.abs(expected[:n]).max(axis=0) + 1e-300).all()


def test_parameters_are_used_as_given() -> None:
    heavier = replace(PLANT, payload=replace(PAPER.payload, mass=20.0)).linearise(STILL)
    assert heavier.dynamics.M[3, 3] - PLANT.linearise(STILL).dynamics.M[3, 3] == pytest.approx(20.0 - 14.89)


def test_a_pose_whose_pitch_is_90_degrees_is_refused_in_words(monkeypatch):
    """Strokes that reach it are far beyond the paper's: its angles are made to fail."""

    def fail(*_):
        raise GimbalLockError("pitch is 90 deg")

    monkeypatch.setattr(Plant, "_find_pose", fail)
    with pytest.raises(ParameterError, match=r"coarse_stroke: too large: no usable pose .*; pitch is 90 deg"):
        Plant.from_parameters(PAPER).linearise(np.zeros(3))
