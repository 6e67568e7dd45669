"""The mechanism in any motion: against conservation laws, point masses, differences, and the generated files."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.claims import verify_claim
from support.mechanics import PAPER, other_geometry, rigid

from ps_fmu.mechanism.compiled import N_MOVING_INPUTS, Mechanism, Place
from ps_fmu.mechanism.derivation import TARGET, write_header, write_source
from ps_fmu.mechanism.dynamics import bus_mass
from ps_fmu.mechanism.kinematics import forward_kinematics, jacobians
from ps_fmu.mechanism.modes import BusMode, PayloadMode
from ps_fmu.mechanism.rotations import from_rotation_vector, multiply, rotation_from_vector, skew
from ps_fmu.mechanism.signals import N_OUTPUTS, output_slices

STILL = np.zeros(N_MOVING_INPUTS)
UNIT = np.array([1.0, 0.0, 0.0, 0.0])
OUTPUT = output_slices()
seeds = st.integers(0, 2**32 - 1)


def flexible(seed):
    """Another geometry with all that can move: rods, modes of bus, truss and payload; one mode is switched off."""
    random, p = np.random.default_rng(seed), other_geometry(seed % 100, PAPER)
    own = PayloadMode(90.0, 0.0, np.repeat([0.3, 0.03], 3) * random.normal(size=6), 0.1, -0.2)
    off = PayloadMode(0.0, 0.0, random.normal(size=6), 0.1, -0.2)
    modes = (*p.bus.modes[:2], BusMode(5.0, 0.0, 2.0 * random.normal(size=6)))
    return replace(p, payload=replace(p.payload, modes=(off, own)), bus=replace(p.bus, modes=modes))


class Motion:
    """A mechanism, and where it is in a state."""

    def __init__(self, p, **options):
        self.p, self.geometry = p, p.manipulator.geometry
        self.mechanism = Mechanism(p.manipulator, p.payload, p.bus, p.servo, p.optics, **options)
        self.n = self.mechanism.n
        n_bus = self.mechanism.struct.n_bus
        self.rods, self.modes, self.truss = slice(9 + n_bus, 12 + n_bus), slice(9, 9 + n_bus), slice(12 + n_bus, self.n)
        self.s, self.ds, self.r = (slice(2 * self.n + k, 2 * self.n + k + 3) for k in (0, 3, 6))

    def draw(self, seed):
        """A state in wild motion; coordinates that are switched off are at rest."""
        random = np.random.default_rng([seed, 7])
        x = np.concatenate(
            [1e-3 * random.normal(size=self.n), 0.1 * random.normal(size=self.n), 5e-3 * random.normal(size=9)]
        )
        x[: 2 * self.n] *= np.tile(self.find_moving(), 2)
        x[self.ds] *= 10.0
        return x

    def find_moving(self):
        return self.mechanism.describe_coordinates()[2].astype(float)

    def find_place(self, x, attitude=UNIT):
        coarse = np.concatenate([x[self.s], np.zeros(3)])
        stretch = np.concatenate([x[self.rods] * self.mechanism.struct.mask[:3], x[:3]])
        poses = [
            forward_kinematics(self.geometry, self.geometry.nominal_lengths + coarse + more)
            for more in (stretch, np.zeros(6))
        ]
        (t, R), nominal = ((pose.translation_B, pose.R) for pose in poses)
        return Place.of(t, R, nominal, attitude)

    def evaluate(self, x, u=STILL, attitude=UNIT):
        return self.mechanism.evaluate(self.find_place(x, attitude), x, u)

    def find_rates(self, x, u=STILL):
        return self.evaluate(x, u).read("rates", self.mechanism.n_states)

    def find_energy(self, x, u=STILL):
        """Kinetic and elastic, J."""
        point = self.evaluate(x, u)
        t, R, J = point.read("motion", 3), point.read("motion", 12)[3:].reshape(3, 3), point.read("J_pl", 6, 6)
        M, m_c, _ = self.mechanism.find_masses(t, R, J, x[: self.n])
        rate, ds = x[self.n : 2 * self.n], x[self.ds]
        coarse = m_c[self.rods]
        kinetic = 0.5 * (rate @ M @ rate + 2.0 * rate @ m_c @ ds + ds @ coarse @ ds)
        stiffness, _, _ = self.mechanism.describe_coordinates()
        return kinetic + 0.5 * stiffness @ x[: self.n] ** 2

    def move(self, x, u=STILL, size=1.0):
        """The state, m, s and so on further along its rates."""
        return x + size * self.find_rates(x, u)


def differentiate(find, motion, x, u, h):
    """Rate of a quantity along the motion, and the error of that: by central differences of two sizes."""
    rates = motion.find_rates(x, u)
    once, twice = ((find(x + k * h * rates) - find(x - k * h * rates)) / (2.0 * k * h) for k in (1.0, 2.0))
    return once + (once - twice) / 3.0


def test_files_are_those_that_the_equations_make():
    assert (TARGET / "equations.h").read_text() == write_header()
    assert (TARGET / "equations.c").read_text() == write_source()


@settings(max_examples=15)
@given(seeds)
def test_energy_grows_by_the_power_of_forces_and_momentum_by_their_impulse(seed):
    """At one instant of a wild motion, dampers and servos off."""
    motion = Motion(flexible(seed))
    struct, random = motion.mechanism.struct, np.random.default_rng([seed, 3])
    struct.servo_stiffness = struct.servo_damping = 0.0  # a coarse actuator that keeps its rate does work
    struct.leg_damping[:] = [0.0] * 6
    for mode in (*struct.bus_modes, *struct.payload_modes):
        mode.damping = 0.0
    x, u = motion.draw(seed), STILL.copy()
    x[motion.ds] = 0.0
    u[:18] = random.normal(size=18)
    point = motion.evaluate(x, u)
    twist, w, v = point.read("twist", 6), x[motion.n + 6 : motion.n + 9], x[motion.n + 3 : motion.n + 6]
    t, R = point.read("motion", 3), point.read("motion", 12)[3:].reshape(3, 3)
    platform = twist + np.concatenate([v + np.cross(w, t), w])
    force, torque = R @ u[12:15], R @ u[15:18]
    power = (u[0:3] + u[9:12]) @ x[motion.n : motion.n + 3] + u[3:6] @ v + u[6:9] @ w
    power += force @ platform[:3] + torque @ platform[3:]
    scale = motion.find_energy(x, u)
    assert differentiate(lambda z: motion.find_energy(z, u), motion, x, u, 1e-5) == pytest.approx(
        power, rel=1e-6, abs=1e-6 * scale
    )

    def find_momentum(z):
        return motion.mechanism.find_momentum(motion.evaluate(z, u), z)[0]

    P, change = find_momentum(x), differentiate(find_momentum, motion, x, u, 1e-5)
    outer = np.concatenate([u[3:6] + force, u[6:9] + torque + np.cross(t, force)])
    turned = np.concatenate([np.cross(w, P[:3]), np.cross(w, P[3:]) + np.cross(v, P[:3])])
    np.testing.assert_allclose(change + turned, outer, rtol=0.0, atol=1e-7 * np.abs(turned).max() + 1e-6)


def test_free_motion_keeps_energy_and_momentum_to_the_fourth_order():
    """A wild motion of 5 ms by the classical method of Runge and Kutta; half the step, a sixteenth of the error."""
    motion = Motion(flexible(4))
    struct = motion.mechanism.struct
    struct.servo_stiffness = struct.servo_damping = 0.0
    struct.leg_damping[:] = [0.0] * 6
    for mode in (*struct.bus_modes, *struct.payload_modes):
        mode.damping = 0.0
    start = 0.3 * motion.draw(4)
    start[motion.ds] = 0.0

    def find_rates(y):
        """Of the state and, behind it, the attitude of B."""
        x, q = y[:-4], y[-4:]
        w = x[motion.n + 6 : motion.n + 9]
        return np.concatenate([motion.find_rates(x), 0.5 * multiply(q, np.concatenate([[0.0], w]))])

    def find_kept(y):
        x, q = y[:-4], y[-4:]
        momentum, _, _ = motion.mechanism.find_momentum(motion.evaluate(x), x)
        R = np.eye(3) + 2.0 * q[0] * skew(q[1:]) + 2.0 * skew(q[1:]) @ skew(q[1:])
        about_start = momentum[3:] + np.cross(x[3:6], momentum[:3])
        return np.concatenate([[motion.find_energy(x)], R @ momentum[:3], R @ about_start])

    off = []
    for n in (40, 80):
        y, h = np.concatenate([start, UNIT]), 0.005 / n
        before = find_kept(y)
        for _ in range(n):
            k1 = find_rates(y)
            k2 = find_rates(y + 0.5 * h * k1)
            k3 = find_rates(y + 0.5 * h * k2)
            y = y + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + find_rates(y + h * k3))
        sizes = before[0], np.abs(before[1:4]).max(), np.abs(before[4:]).max()
        off.append(np.abs(find_kept(y) - before) / np.repeat(sizes, (1, 3, 3)))
    verify_claim(
        "model.conservation",
        claim="Energy and momentum of the mechanism in free motion: rods, legs, modes of bus and payload, turning base",
        where="manipulator_plant in motion",
        reference="conservation laws over 5 ms by the method of Runge and Kutta, order 4",
        error=float(off[1].max()),
        bound=1e-8,
    )
    assert off[0].max() > 12.0 * off[1].max()


@settings(max_examples=15)
@given(seeds)
def test_directional_derivative_is_that_of_the_mechanism(seed):
    motion, random = Motion(flexible(seed)), np.random.default_rng([seed, 5])
    x, u = motion.draw(seed), np.concatenate([random.normal(size=21), np.zeros(6)])
    motion.mechanism.struct.leg_damping[:3] = [30.0, 40.0, 50.0]
    attitude = from_rotation_vector(random.normal(size=3))
    moving = np.tile(motion.find_moving(), 2)
    dx = np.concatenate([random.normal(size=2 * motion.n) * moving, random.normal(size=9)])
    du = np.concatenate([random.normal(size=21), np.zeros(6)])

    def find(size):
        z = x + size * dx
        point = motion.evaluate(z, u + size * du, multiply(attitude, from_rotation_vector(size * dx[6:9])))
        return np.concatenate([point.read("rates", len(z)), point.read("outputs", N_OUTPUTS)])

    h = 1e-6
    once, twice = ((find(k * h) - find(-k * h)) / (2.0 * k * h) for k in (1.0, 2.0))
    expected = once + (once - twice) / 3.0
    point = motion.evaluate(x, u, attitude)
    rates, outputs, _ = motion.mechanism.differentiate(point, dx, du)
    found, scale = np.concatenate([rates, outputs]), np.abs(find(0.0)).max() / h * 1e-15
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-7 * np.abs(expected).max() + 10.0 * scale)
    A, B, C, D, _, _ = motion.mechanism.linearise(point)
    by_columns = np.concatenate([A @ dx + B @ du, C @ dx + D @ du])
    np.testing.assert_allclose(by_columns, found, rtol=0.0, atol=1e-9 * np.abs(found).max())


@settings(max_examples=10)
@given(seeds)
def test_what_a_prescribed_base_needs_is_what_moves_a_free_one(seed):
    """The reaction, and what the bus alone needs, give a free base the motion that was prescribed."""
    p = replace(flexible(seed), bus=replace(PAPER.bus, modes=()))
    hosted, free, random = Motion(p, prescribed=True), Motion(p), np.random.default_rng([seed, 9])
    x, u = hosted.draw(seed), STILL.copy()
    u[:3], u[12:18], u[21:27] = random.normal(size=3), random.normal(size=6), random.normal(size=6)
    point, w = hosted.evaluate(x, u), x[hosted.n + 6 : hosted.n + 9]
    np.testing.assert_array_equal(point.read("outputs", 6), u[21:27])
    M, c = bus_mass(p.bus), p.bus.com_B
    inertia = M[3:, 3:]
    bus = M @ u[21:27] + np.concatenate([p.bus.mass * np.cross(w, np.cross(w, c)), np.cross(w, inertia @ w)])
    u[3:9], u[21:27] = point.read("reaction", 6) + bus, 0.0
    there = free.evaluate(x, u)
    np.testing.assert_allclose(there.read("outputs", 6), point.read("outputs", 6), rtol=0.0, atol=1e-9)
    found, expected = there.read("rates", len(x)), point.read("rates", len(x))
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-9 * np.abs(expected).max())


def test_rigid_rods_are_the_limit_of_stiff_ones_and_take_no_part():
    motion, x = Motion(rigid()), np.random.default_rng(2).normal(size=33) * 1e-3
    x[motion.rods], x[motion.n + 9 : motion.n + 12] = 1.0, 1.0
    rates = motion.find_rates(x)
    assert not rates[motion.rods].any() and not rates[motion.n + 9 : motion.n + 12].any()
    x[motion.rods], x[motion.n + 9 : motion.n + 12] = 0.0, 0.0
    np.testing.assert_array_equal(rates[:9], motion.find_rates(x)[:9])
    assert np.abs(motion.evaluate(x).read("reaction", 6)).max() < 1e-10  # N, N.m: the base is free


def test_platform_is_found_from_the_legs():
    motion, geometry = Motion(PAPER), PAPER.manipulator.geometry
    lengths = geometry.nominal_lengths + np.array([8e-3, -6e-3, 4e-3, 5e-4, -3e-4, 2e-4])
    t, R = motion.mechanism.find_place(lengths, geometry.nominal_translation_B, np.eye(3))
    expected = forward_kinematics(geometry, lengths)
    np.testing.assert_allclose(t, expected.translation_B, rtol=0.0, atol=1e-15)
    np.testing.assert_allclose(R, expected.R, rtol=0.0, atol=1e-14)
    for lost in (lengths * [1.0, 1.0, 1.0, 9.0, 1.0, 1.0], lengths * np.nan):
        with pytest.raises(ArithmeticError, match="no place of the platform has these leg lengths"):
            motion.mechanism.find_place(lost, geometry.nominal_translation_B, np.eye(3))


@pytest.mark.parametrize("angle", [1e-9, 1e-3, 0.3, 1.5])
def test_angles_and_rotation_vector_are_right_to_the_last_digits(angle):
    """Of orientation and vibration, whose series are our own."""
    motion, vector = Motion(PAPER), angle * np.array([0.6, -0.64, 0.48])
    geometry, R = PAPER.manipulator.geometry, rotation_from_vector(vector)
    t = geometry.nominal_translation_B
    place = Place.of(t, np.eye(3), (t, R), UNIT)
    y = motion.mechanism.evaluate(place, np.zeros(motion.mechanism.n_states), STILL).read("outputs", N_OUTPUTS)
    roll, pitch, yaw = y[OUTPUT["orientation"]]
    expected = np.arctan2(R[2, 1], R[2, 2]), np.arcsin(-R[2, 0]), np.arctan2(R[1, 0], R[0, 0])
    np.testing.assert_allclose([roll, pitch, yaw], expected, rtol=3e-15, atol=1e-17)
    np.testing.assert_allclose(y[OUTPUT["payload_rotation"]], -vector, rtol=3e-15, atol=1e-17)


def test_what_is_not_finite_or_singular_is_refused():
    motion = Motion(PAPER)
    x, geometry = np.zeros(motion.mechanism.n_states), PAPER.manipulator.geometry
    t = np.array([0.0, 0.0, 0.4])
    for spoil in (np.nan, np.inf, 1e200):
        bad = x.copy()
        bad[motion.n + 7] = spoil
        with pytest.raises(ArithmeticError, match="not finite"):
            motion.evaluate(bad)
    joints = motion.mechanism.struct.base_joint
    for k in range(6):  # all legs are parallel
        joints[3 * k : 3 * k + 3] = geometry.platform_joints_P[k]
    place = Place.of(t, np.eye(3), (t, np.eye(3)), UNIT)
    with pytest.raises(ArithmeticError, match="singular"):
        motion.mechanism.evaluate(place, x, STILL)
    with pytest.raises(ValueError, match="expected"):
        motion.mechanism.evaluate(place, x[1:], STILL)


def test_mechanism_takes_jacobians_of_any_pose():
    """By blocks, or with pivots where the directions of the coarse legs are nearly in one plane."""
    geometry, motion = PAPER.manipulator.geometry, Motion(PAPER)
    for tilt in (0.0, 0.3):
        R = rotation_from_vector(np.array([tilt, -tilt, 0.0]))
        t = geometry.nominal_translation_B
        point = motion.mechanism.evaluate(Place.of(t, R, (t, R), UNIT), np.zeros(motion.mechanism.n_states), STILL)
        np.testing.assert_allclose(point.read("J_pl", 6, 6), jacobians(geometry, t, R).J_pl, rtol=1e-12, atol=1e-13)
