"""Mass matrices against energy, against the paper's one-body coarse leg and against the multibody reference."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.claims import verify_claim
from support.mechanics import PAPER, dynamics_at, pose_at, reference_cases, reference_pose, rigid

from ps_fmu.mechanism.dynamics import bus_mass, payload_mass, rigid_body_mass
from ps_fmu.mechanism.kinematics import jacobians, leg_vectors, platform_jacobian, platform_joints_B
from ps_fmu.mechanism.parameters import LegPart
from ps_fmu.mechanism.rotations import rotation_matrix

small = st.floats(-1.0, 1.0)
twists = st.lists(small, min_size=6, max_size=6).map(np.array)
orientations = st.lists(st.floats(-4.0, 4.0), min_size=3, max_size=3).map(tuple)  # deg


def rigid_but_rods():
    return replace(rigid(), manipulator=PAPER.manipulator)


@pytest.mark.parametrize("case", reference_cases(), ids=lambda c: str(c["orientation_rpy_deg"]))
def test_mass_damping_stiffness_of_the_multibody_prototype(case: dict) -> None:
    d = dynamics_at(reference_pose(case), rigid())
    off = []
    for ours, theirs in ((d.M, "mass_9x9"), (d.C, "damping_9x9"), (d.K, "stiffness_9x9")):
        reference = np.array(case[theirs])
        off.append(np.abs(ours[:9, :9] - reference).max() / np.abs(reference).max())
    verify_claim(
        "model.matrices",
        claim="Mass, damping and stiffness of the mechanism, behind all closed forms and runs",
        where="all commands",
        reference="nonlinear multibody program (Pinocchio), linearised, at two orientations",
        error=max(off),
        bound=1e-9,
    )
    # The fine-leg block is a thousandth of the bus's: compare it on its own scale too.
    np.testing.assert_allclose(d.M[:3, :3], np.array(case["mass_9x9"])[:3, :3], rtol=1e-9)


def test_rigid_body_mass_is_its_kinetic_energy() -> None:
    rng = np.random.default_rng(1)
    com, twist = rng.normal(size=3), rng.normal(size=6)
    half = rng.normal(size=(3, 3))
    inertia = half @ half.T + np.eye(3)
    velocity = twist[:3] + np.cross(twist[3:], com)
    energy = 0.5 * 7.0 * velocity @ velocity + 0.5 * twist[3:] @ inertia @ twist[3:]
    assert 0.5 * twist @ rigid_body_mass(7.0, com, inertia) @ twist == pytest.approx(energy, rel=1e-13)


@given(orientations, twists, twists)
def test_energy_is_that_of_legs_payload_and_bus(rpy_deg, rates, base_twist) -> None:
    """Eq (21): the sum over parts of (A1)-(A3), with velocities from the geometry; coarse rods get longer, too."""
    p, pose = rigid_but_rods(), pose_at(rpy_deg)
    d, geometry = dynamics_at(pose, p), p.manipulator.geometry
    rate = np.concatenate([rates[3:], base_twist, rates[:3]])
    t, R = pose.translation_B, pose.rotation_BP
    relative = np.linalg.solve(platform_jacobian(geometry, t, R), rates)
    platform = relative + base_twist + np.concatenate([np.cross(base_twist[3:], t), np.zeros(3)])
    energy = 0.0
    for leg, vector, arm, base_arm in zip(
        p.manipulator.coarse_legs + p.manipulator.fine_legs,
        leg_vectors(geometry, t, R), platform_joints_B(geometry, R), geometry.base_joints_B, strict=True,
    ):  # fmt: skip
        length = np.linalg.norm(vector)
        n = vector / length
        v_p = platform[:3] + np.cross(platform[3:], arm)
        v_b = base_twist[:3] + np.cross(base_twist[3:], base_arm)
        omega = np.cross(n, v_p - v_b) / length  # (A11)
        for part, velocity in (
            (leg.upper, v_p - np.cross(omega, leg.upper.com_distance * n)),
            (leg.lower, v_b + np.cross(omega, leg.lower.com_distance * n)),
        ):
            energy += 0.5 * part.mass * velocity @ velocity + 0.5 * part.radial_inertia * omega @ omega
    energy += 0.5 * platform @ payload_mass(p.payload, R) @ platform + 0.5 * base_twist @ bus_mass(p.bus) @ base_twist
    assert 0.5 * rate @ d.M @ rate == pytest.approx(energy, rel=1e-12, abs=1e-15)


@given(orientations, st.lists(small, min_size=3, max_size=3).map(np.array), twists)
def test_locked_coarse_leg_is_the_papers_one_body(rpy_deg, fine_rate, base_twist) -> None:
    """(A17)-(A25) for one rigid body with centre of mass and inertia of its two parts at the current length."""
    manipulator, pose = PAPER.manipulator, pose_at(rpy_deg)
    geometry = manipulator.geometry
    J = jacobians(geometry, pose.translation_B, pose.rotation_BP)
    platform_twist = J.J_pf @ fine_rate + J.J_pb @ base_twist  # coarse actuators locked
    nothing = LegPart(mass=0.0, com_distance=0.0, radial_inertia=0.0)
    massless = tuple(replace(leg, lower=nothing, upper=nothing) for leg in manipulator.coarse_legs)
    whole, without = rigid(), rigid(replace(PAPER, manipulator=replace(manipulator, coarse_legs=massless)))
    rate = np.concatenate([fine_rate, base_twist])
    added = dynamics_at(pose, whole).M[:9, :9] - dynamics_at(pose, without).M[:9, :9]
    expected = 0.0
    vectors, arms = (
        leg_vectors(geometry, pose.translation_B, pose.rotation_BP),
        platform_joints_B(geometry, pose.rotation_BP),
    )
    for leg, vector, arm, base_arm in zip(
        manipulator.coarse_legs, vectors[:3], arms[:3], geometry.base_joints_B[:3], strict=True
    ):
        length = float(np.linalg.norm(vector))
        n = vector / length
        m = leg.lower.mass + leg.upper.mass
        upper_at = length - leg.upper.com_distance
        rho = (leg.lower.mass * leg.lower.com_distance + leg.upper.mass * upper_at) / m
        mu = (
            leg.lower.radial_inertia
            + leg.lower.mass * (leg.lower.com_distance - rho) ** 2
            + leg.upper.radial_inertia
            + leg.upper.mass * (upper_at - rho) ** 2
        )
        P = np.eye(3) - np.outer(n, n)
        v_p = platform_twist[:3] + np.cross(platform_twist[3:], arm)
        v_b = base_twist[:3] + np.cross(base_twist[3:], base_arm)
        m_alpha = (mu + m * rho**2) / length**2  # (A18)
        m_beta = m_alpha - 2.0 * m * rho / length  # (A21)
        m_alpha_beta = m_alpha - m * rho / length  # (A24)
        expected += (
            v_p @ (m_alpha * P) @ v_p + v_b @ (m * np.eye(3) + m_beta * P) @ v_b - 2.0 * m_alpha_beta * v_p @ P @ v_b
        )
    assert rate @ added @ rate == pytest.approx(expected, rel=1e-9, abs=1e-9)


@given(orientations)
def test_full_mass_is_symmetric_positive_definite(rpy_deg) -> None:
    d = dynamics_at(pose_at(rpy_deg))
    np.testing.assert_allclose(d.M, d.M.T, atol=1e-12 * np.abs(d.M).max())
    assert np.linalg.eigvalsh(d.M)[0] > 0.0


def test_total_mass_and_momentum_of_a_rigid_translation() -> None:
    """A common translation carries the mass of everything that moves."""
    d = dynamics_at(pose_at((3.0, -2.0, 1.0)))
    parts = PAPER.manipulator.coarse_legs + PAPER.manipulator.fine_legs
    total = PAPER.bus.mass + PAPER.payload.mass + sum(leg.lower.mass + leg.upper.mass for leg in parts)
    q_b = d.slices["q_b"].start
    assert d.M[q_b, q_b] == pytest.approx(total, rel=1e-13)


def test_payload_frame_does_not_matter() -> None:
    """M_p at a turned pose is that of the turned body."""
    R = rotation_matrix(np.array([0.3, -0.2, 0.5]))
    turn = np.kron(np.eye(2), R)
    np.testing.assert_allclose(
        payload_mass(PAPER.payload, R), turn @ payload_mass(PAPER.payload, np.eye(3)) @ turn.T, atol=1e-12
    )


def test_rod_and_truss_frequencies_of_the_notes() -> None:
    """Coarse-rod modes near 154 and 161 Hz, truss modes near 208 and 228 Hz at the nominal pose."""
    d = dynamics_at(pose_at((0.0, 0.0, 0.0)))
    frequencies = np.sort(np.sqrt(np.abs(np.linalg.eigvals(np.linalg.solve(d.M, d.K))))) / (2.0 * np.pi)
    np.testing.assert_allclose(frequencies[-5:-1], [154.0, 161.0, 208.0, 228.0], atol=0.6)
    assert 350.0 < frequencies[-1] < 380.0


def test_each_flexible_coordinate_has_its_frequency_and_damping_ratio() -> None:
    """With all other coordinates held."""
    d = dynamics_at(pose_at((8.5, 0.0, 0.0)))
    rods = PAPER.manipulator.coarse_rods
    expected = {
        "x_m": [(mode.frequency, mode.damping_ratio) for mode in PAPER.bus.modes],
        "x_t": [(mode.frequency, mode.damping_ratio) for mode in PAPER.payload.truss_modes],
        "e_c": [(np.sqrt(rods.axial_stiffness / m) / (2.0 * np.pi), rods.damping_ratio) for m in np.diag(d.M)[15:18]],
    }
    assert d.slices["e_c"] == slice(15, 18)
    for group, values in expected.items():
        M, C, K = (np.diag(matrix)[d.slices[group]] for matrix in (d.M, d.C, d.K))
        found = np.column_stack([np.sqrt(K / M) / (2.0 * np.pi), C / (2.0 * np.sqrt(K * M))])
        np.testing.assert_allclose(found, values, rtol=1e-12)


@given(orientations, st.integers(0, 2**32 - 1))
def test_truss_masses_move_with_the_platform_and_along_their_own_direction(rpy_deg, seed) -> None:
    """What their motion adds to the kinetic energy, from the velocity of each point mass."""
    pose = pose_at(rpy_deg)
    d = dynamics_at(pose)
    rate = np.random.default_rng(seed).normal(size=d.n)
    twist, R = d.platform_rows() @ rate, pose.rotation_BP
    added = 0.0
    for mode, own in zip(PAPER.payload.truss_modes, rate[d.slices["x_t"]], strict=True):
        held = twist[:3] + np.cross(twist[3:], R @ mode.position_P)
        moving = held + own * (R @ mode.direction_P)
        added += 0.5 * mode.mass * (moving @ moving - held @ held)
    still = rate.copy()
    still[d.slices["x_t"]] = 0.0
    assert 0.5 * (rate @ d.M @ rate - still @ d.M @ still) == pytest.approx(added, rel=1e-6)  # of 1e4 J


def test_switched_off_groups_are_inactive_and_unused_places_at_the_end_have_no_coordinates() -> None:
    pose = pose_at((0.0, 0.0, 0.0))
    off = replace(
        PAPER,
        manipulator=rigid().manipulator,
        payload=replace(PAPER.payload, truss_modes=tuple(replace(m, frequency=0.0) for m in PAPER.payload.truss_modes)),
        bus=replace(PAPER.bus, modes=tuple(replace(m, frequency=0.0) for m in PAPER.bus.modes)),
    )
    d, bare = dynamics_at(pose, off), dynamics_at(pose, rigid())
    assert d.active.tolist() == [True] * 9 + [False] * 3  # rigid rods
    first = replace(PAPER, bus=replace(PAPER.bus, modes=(off.bus.modes[0], *PAPER.bus.modes[1:4], *off.bus.modes[4:])))
    assert dynamics_at(pose, first).active.tolist() == [True] * 9 + [False] + [True] * 8
    np.testing.assert_allclose(d.M[:9, :9], bare.M[:9, :9], rtol=1e-14)
