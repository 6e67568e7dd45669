"""Convective forces and momentum against bodies made of point masses, whose motion is differentiated numerically."""

from dataclasses import replace

import numpy as np
import pytest
from support.mechanics import PAPER, other_geometry, rigid

from ps_fmu.mechanism.compiled import N_MOVING_INPUTS, Mechanism, Place
from ps_fmu.mechanism.kinematics import forward_kinematics
from ps_fmu.mechanism.rotations import rotation_from_vector

RANDOM = np.random.default_rng(8)
LENGTHS = np.array([4e-3, -3e-3, 2e-3, 4e-4, -8e-4, 5e-4])  # m, from nominal; coarse legs, fine legs
SPEEDS = np.concatenate([0.02 * RANDOM.normal(size=3), 0.3 * RANDOM.normal(size=3), 0.05 * RANDOM.normal(size=3)])
VELOCITY = np.array([0.1, -0.2, 0.3])  # m/s
FINE, TURN, COARSE = slice(0, 3), slice(3, 6), slice(6, 9)  # of SPEEDS: m/s, rad/s, m/s
SYSTEMS = {"paper": rigid(), "another geometry": other_geometry(0)}


def body_points(mass, com, inertia):
    """A rigid body as six equal masses (6, 3) on its principal axes."""
    moments, axes = np.linalg.eigh(inertia)
    halves = np.sqrt(3.0 * (0.5 * moments.sum() - moments) / mass)  # m
    points = np.concatenate([axes * halves, -axes * halves], axis=1).T
    return np.full(6, mass / 6.0), com + points


def leg_points(leg):
    """Masses and distances along the leg, two of each part, from the base joint (lower) and the platform's (upper)."""
    for part in (leg.lower, leg.upper):
        radius = np.sqrt(part.radial_inertia / part.mass)
        yield [(0.5 * part.mass, part.com_distance + sign * radius) for sign in (1.0, -1.0)]


def point_masses(p, time):
    """Masses (k,) and places (k, 3) in inertial axes: at time 0 those of B, which moves as VELOCITY and SPEEDS say."""
    geometry = p.manipulator.geometry
    rates = np.concatenate([SPEEDS[COARSE], SPEEDS[FINE]])
    pose = forward_kinematics(geometry, geometry.nominal_lengths + LENGTHS + time * rates)
    masses, places = [], []

    def put(mass, points):
        masses.extend(np.atleast_1d(mass))
        places.extend(np.atleast_2d(points))

    put(*body_points(p.bus.mass, p.bus.com_B, p.bus.inertia_B))
    m, points_P = body_points(p.payload.mass, p.payload.com_P, p.payload.inertia_P)
    put(m, pose.translation_B + points_P @ pose.R.T)
    for leg in p.manipulator.coarse_legs + p.manipulator.fine_legs:
        top = pose.translation_B + pose.R @ leg.platform_joint_P
        along = (top - leg.base_joint_B) / np.linalg.norm(top - leg.base_joint_B)
        lower, upper = leg_points(leg)
        for mass, distance in lower:
            put(mass, leg.base_joint_B + distance * along)
        for mass, distance in upper:
            put(mass, top - distance * along)
    # A constant angular velocity in B is one in inertial axes, too; the origin moves straight on.
    R_NB = rotation_from_vector(SPEEDS[TURN] * time)
    return np.array(masses), np.array(places) @ R_NB.T + VELOCITY * time


def differentiate(p, order):
    """First or second derivative of the places at time 0; (k, 3)."""
    h = {1: 1e-4, 2: 2e-3}[order]  # s
    at = [point_masses(p, k * h)[1] for k in (-2, -1, 0, 1, 2)]
    weights = {1: (1 / 12, -2 / 3, 0.0, 2 / 3, -1 / 12), 2: (-1 / 12, 4 / 3, -5 / 2, 4 / 3, -1 / 12)}[order]
    return sum(w * x for w, x in zip(weights, at, strict=True)) / h**order


def evaluate(p, speeds=SPEEDS, velocity=VELOCITY):
    """The mechanism at LENGTHS with all accelerations held at zero: its motion, state and all that there is."""
    mechanism, geometry = Mechanism(p.manipulator, p.payload, p.bus), p.manipulator.geometry
    mechanism.struct.mask[:] = [0.0] * 12
    mechanism.struct.leg_stiffness[:] = mechanism.struct.leg_damping[:] = [0.0] * 6
    found, n = forward_kinematics(geometry, geometry.nominal_lengths + LENGTHS), mechanism.n
    x = np.zeros(mechanism.n_states)
    x[n : n + 3], x[n + 3 : n + 6], x[n + 6 : n + 9], x[2 * n + 3 : 2 * n + 6] = np.split(
        np.concatenate([speeds[:3], velocity, speeds[3:]]), 4
    )
    pose = found.translation_B, found.R
    place = Place.of(*pose, pose, np.array([1.0, 0.0, 0.0, 0.0]))
    return mechanism, x, mechanism.evaluate(place, x, np.zeros(N_MOVING_INPUTS))


@pytest.mark.parametrize("name", SYSTEMS)
def test_force_and_torque_on_the_whole_are_those_of_its_point_masses(name):
    p = SYSTEMS[name]
    mass, place = point_masses(p, 0.0)
    force = mass[:, None] * differentiate(p, 2)
    expected = np.concatenate([force.sum(axis=0), np.cross(place, force).sum(axis=0)])
    _, _, point = evaluate(p)
    np.testing.assert_allclose(point.read("reaction", 6), expected, rtol=0.0, atol=1e-6 * np.abs(expected).max())


@pytest.mark.parametrize("name", SYSTEMS)
def test_momentum_is_that_of_its_point_masses(name):
    p = SYSTEMS[name]
    mass, place = point_masses(p, 0.0)
    momentum = mass[:, None] * differentiate(p, 1)
    expected = np.concatenate([momentum.sum(axis=0), np.cross(place, momentum).sum(axis=0)])
    mechanism, x, point = evaluate(p)
    found, total, com_B = mechanism.find_momentum(point, x)
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-9 * np.abs(expected).max())
    np.testing.assert_allclose(com_B, mass @ place / mass.sum(), rtol=0.0, atol=1e-14)
    assert total == pytest.approx(mass.sum(), rel=1e-14)


def test_a_body_that_only_turns_needs_centripetal_and_gyroscopic_forces():
    """The mechanism is so light here that the bus alone is left: w x I w, and m w x (w x c)."""
    bus = replace(PAPER.bus, mass=1e9, inertia_B=1e9 * np.diag([3.0, 4.0, 5.0]), com_B=np.array([0.0, 0.0, -2.0]))
    w = np.array([0.1, 0.2, -0.3])  # rad/s
    speeds = np.concatenate([np.zeros(3), w, np.zeros(3)])
    _, _, point = evaluate(replace(rigid(), bus=replace(bus, modes=())), speeds)
    force = 1e9 * np.cross(w, np.cross(w, bus.com_B))
    torque = np.cross(bus.com_B, force) + np.cross(w, bus.inertia_B @ w)
    np.testing.assert_allclose(point.read("reaction", 6), np.concatenate([force, torque]), rtol=1e-6, atol=100.0)
