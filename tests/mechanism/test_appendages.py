"""Hinged appendages as modes of the bus: closed forms of two bodies on a spring, limits, what they may move."""

import numpy as np
import pytest

from ps_fmu.mechanism.dynamics import rigid_body_mass
from ps_fmu.mechanism.modes import Appendage, join_bodies
from ps_fmu.mechanism.parameters import Bus
from ps_fmu.mechanism.quantities import ParameterError

HUB = (260.0, np.array([0.1, 0.0, -0.4]), np.diag([118.0, 120.0, 105.0]))  # kg, m, kg.m2
TWO_PI = 2.0 * np.pi


def array(**changes):
    """A solar array on the +y side of the hub."""
    values = {
        "mass": 20.0, "com_B": [0.0, 1.9, -0.4], "inertia_B": np.diag([9.6, 1.1, 10.7]), "hinge_B": [0.0, 0.7, -0.4],
        "axis_B": [1.0, 0.0, 0.0], "frequency": 0.8, "damping_ratio": 0.005,
    }  # fmt: skip
    return Appendage(**values | changes)


def free_frequencies(bus):
    """Natural frequencies of the free bus with its modes, Hz, without the rigid ones."""
    n = len(bus.modes)
    M, K = np.eye(6 + n), np.zeros((6 + n, 6 + n))
    M[:6, :6] = rigid_body_mass(bus.mass, bus.com_B, bus.inertia_B)
    for k, mode in enumerate(bus.modes, 6):
        M[:6, k] = M[k, :6] = mode.participation_B
        K[k, k] = (TWO_PI * mode.frequency) ** 2
    squares = np.sort(np.linalg.eigvals(np.linalg.solve(M, K)).real)
    return np.sqrt(squares[-n:]) / TWO_PI


def test_two_bodies_on_a_spring_in_a_plane():
    """Free-free: k (1/J1 + 1/J2 + ...) in closed form, from the kinetic energy of two collinear bodies.

    With the centres of mass a and b from the hinge and mu the reduced mass, T = 1/2 (I1 + mu a^2) w1^2
    + mu a b w1 w2 + 1/2 (I2 + mu b^2) w2^2 about the common centre of mass.
    """
    hub, body = (260.0, np.zeros(3), HUB[2]), array(com_B=[0.0, 1.9, 0.0], hinge_B=[0.0, 0.7, 0.0])
    mass, com, inertia = join_bodies([hub, (body.mass, body.com_B, body.inertia_B)])
    (mode,) = body.make_modes()
    found = free_frequencies(Bus(mass, com, inertia, (mode,)))
    a, b, mu = 0.7, 1.2, 260.0 * 20.0 / 280.0
    k = (9.6 + 20.0 * b**2) * (TWO_PI * 0.8) ** 2
    one, other, both = 118.0 + mu * a**2, 9.6 + mu * b**2, mu * a * b
    expected = np.sqrt(k * (one + other + 2.0 * both) / (one * other - both**2)) / TWO_PI
    np.testing.assert_allclose(found, [expected], rtol=1e-10)
    assert expected > 1.05 * 0.8  # a free hub gives way


def test_the_frequency_with_a_heavy_hub_is_that_of_the_hinge():
    body = array()
    bus = Bus(1e9, np.zeros(3), np.eye(3) * 1e9, body.make_modes())
    np.testing.assert_allclose(free_frequencies(bus), [0.8], rtol=1e-6)
    assert body.make_modes()[0].frequency == 0.8


def test_momentum_of_the_angle():
    """Participation is the momentum that a unit modal rate carries, summed over the points of the body."""
    random = np.random.default_rng(3)
    points, masses = random.normal([0.3, 2.0, -0.5], size=(40, 3)), random.uniform(0.1, 1.0, 40)
    mass, com, inertia = join_bodies([(m, r, np.zeros((3, 3))) for m, r in zip(masses, points, strict=True)])
    axis, hinge = np.array([1.0, 0.2, -0.4]), np.array([0.1, 0.6, -0.3])
    body = Appendage(mass, com, inertia, hinge, axis, 1.5, 0.01)
    (mode,) = body.make_modes()
    unit = axis / np.linalg.norm(axis)
    speeds = np.cross(unit, points - hinge)  # m/s at 1 rad/s
    momentum = np.concatenate([masses @ speeds, masses @ np.cross(points, speeds)])
    energy = masses @ (speeds**2).sum(axis=1)
    momentum /= np.sqrt(energy)
    np.testing.assert_allclose(mode.participation_B, momentum * np.sign(momentum @ mode.participation_B), rtol=1e-12)


def test_a_ball_joint_takes_up_all_that_turns_about_the_hinge():
    """Three axes: the modes together move the whole inertia about the hinge, and never more than the body's mass."""
    body = array(axis_B=np.eye(3), frequency=[0.8, 1.4, 2.0], com_B=[0.2, 1.9, -0.1])
    P = np.array([mode.participation_at(body.hinge_B) for mode in body.make_modes()])
    moved = P.T @ P
    at_hinge = rigid_body_mass(body.mass, body.com_B - body.hinge_B, body.inertia_B)
    np.testing.assert_allclose(moved[3:], at_hinge[3:], atol=1e-10)
    left = np.linalg.eigvalsh(at_hinge - moved)
    assert left.min() > -1e-10
    assert np.sum(left > 1e-6) == 3
    assert (np.diag(moved)[:3] <= body.mass).all()


def test_coupled_axes_keep_the_stiffness_of_each():
    """With one axis held, the other has its own frequency; together they have those of the matrices J and k."""
    axes = np.array([[1.0, 0.0, 0.0], [1.0, 0.0, 1.0]])
    body = array(axis_B=axes, frequency=[0.8, 1.4])
    n = axes / np.linalg.norm(axes, axis=1)[:, None]
    arm = np.array([0.0, 1.2, 0.0])
    J = n @ (body.inertia_B + 20.0 * (1.44 * np.eye(3) - np.outer(arm, arm))) @ n.T
    k = np.diag(J) * (TWO_PI * np.array([0.8, 1.4])) ** 2
    expected = np.sqrt(np.sort(np.linalg.eigvals(np.linalg.solve(J, np.diag(k))).real)) / TWO_PI
    np.testing.assert_allclose([mode.frequency for mode in body.make_modes()], expected, rtol=1e-10)


def test_a_mirrored_array_has_the_mirrored_participation():
    (one,), (other,) = array().make_modes(), array(com_B=[0.0, -1.9, -0.4], hinge_B=[0.0, -0.7, -0.4]).make_modes()
    np.testing.assert_allclose(np.abs(one.participation_B), np.abs(other.participation_B), atol=1e-12)
    # Turning about x, both carry the same angular momentum and opposite linear momentum.
    assert one.participation_B[2] * one.participation_B[3] == -other.participation_B[2] * other.participation_B[3]


def test_bodies_joined_in_any_order_and_taken_apart():
    bodies = [HUB, (20.0, np.array([0.0, 1.9, -0.4]), np.diag([9.6, 1.1, 10.7])), (5.0, np.ones(3), 0.1 * np.eye(3))]
    mass, com, inertia = join_bodies(bodies)
    again = join_bodies([bodies[2], join_bodies(bodies[:2])])
    for found, expected in zip(again, (mass, com, inertia), strict=True):
        np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-12)
    total = sum(rigid_body_mass(*body) for body in bodies)
    np.testing.assert_allclose(rigid_body_mass(mass, com, inertia), total, rtol=1e-12, atol=1e-9)


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"mass": 0.0}, "mass: must be greater than 0"),
        ({"frequency": 0.0}, "frequency: must be greater than 0"),
        ({"frequency": "fast"}, "frequency: expected a number"),
        ({"frequency": [0.8, 1.0]}, r"axis: expected shape \(2, 3\), got \(3,\)"),
        ({"frequency": [1.0] * 4, "axis_B": np.ones((4, 3))}, "frequency: expected one .* 3 axes, got 4"),
        ({"axis_B": [0.0, 0.0, 0.0]}, "axis: must not be the zero vector"),
        ({"axis_B": [[1.0, 0, 0], [2.0, 0, 0]], "frequency": [1.0, 2.0]}, "axis: .* lie in a line or plane"),
        ({"inertia_B": np.diag([1.0, 1.0, 9.0])}, "inertia: no rigid body"),
        ({"hinge_B": [0.0, np.nan, 0.0]}, "hinge: every number must be finite"),
    ],
)
def test_impossible_appendages_are_named(changes, text):
    with pytest.raises(ParameterError, match=text):
        array(**changes)
