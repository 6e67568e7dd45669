"""Kinematics: (5) to (17), Algorithm 1, and the kinetic energy of the legs: Appendix A."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from ...control.commander import DEFAULT_ALGORITHM_1
from ...mechanism.dynamics import Pose, leg_mass
from ...mechanism.inverse_kinematics import Solver, descend, inverse_kinematics, step_size_bound, trilaterate
from ...mechanism.kinematics import displacements, forward_kinematics, leg_lengths, leg_vectors
from ...mechanism.parameters import Array, CoarseLeg, LegPart
from ...mechanism.rotations import rotation_from_vector, rotation_matrix
from ...theory.transfer_matrices import Nominal
from ..bus_cases import assemble_nominal
from ..figures.fig06 import compute_reach
from ..figures.fig07.runs import EPSILON_AS_PUBLISHED
from ..figures.table2.runs import ORIENTATIONS
from ..published import published_numbers
from . import case
from .case import BY_READING, Erratum, rate, relative_error

EPSILON = DEFAULT_ALGORITHM_1.epsilon  # m, of Algorithm 1 as printed


def second_vector() -> Erratum:
    """(5)."""
    return Erratum("(5)", "q_p = (t_b, theta_b)", "q_b = (t_b, theta_b)", BY_READING)


def base_term() -> Erratum:
    """(8), (11): a motion of base and legs, to first order, against the nonlinear forward kinematics."""
    geometry, pose, J = case.parameters().manipulator.geometry, case.pose(), case.dynamics().jacobians
    rng = np.random.default_rng(case.SEED)
    d, q_b = 0.1 * rng.normal(size=(8, 6)), rng.normal(size=(8, 6))  # m, and m and rad
    lengths = leg_lengths(geometry, pose.translation_B, pose.rotation_BP)

    def platform(t: float) -> Array:
        found = forward_kinematics(geometry, lengths + t * d, pose.translation_B, pose.rotation_BP)
        turned = rotation_from_vector(t * q_b[:, 3:])
        translation = t * q_b[:, :3] + np.squeeze(turned @ found.translation_B[..., None], -1)
        R = turned @ found.R @ pose.rotation_BP.T
        rotation = 0.5 * np.stack([R[:, 2, 1] - R[:, 1, 2], R[:, 0, 2] - R[:, 2, 0], R[:, 1, 0] - R[:, 0, 1]], -1)
        return np.hstack([translation, rotation])

    moved = rate(platform, 3e-4)
    by_legs, by_base = d @ J.J_pl.T, q_b @ J.J_pb.T
    return Erratum(
        "(8), (11)",
        "dq_p = J_pl dd - J_pb dq_b",
        "dq_p = J_pl dd + J_pb dq_b, as in (24)",
        "finite differences of the forward kinematics on a moving base, eight random motions",
        relative_error(by_legs + by_base, moved),
        relative_error(by_legs - by_base, moved),
    )


def rotation() -> Erratum:
    """(14): which way the matrix maps."""
    geometry = case.parameters().manipulator.geometry
    of_table_2 = np.radians(list(ORIENTATIONS.values()))
    angles = np.vstack([of_table_2, np.random.default_rng(case.SEED).uniform(-0.2, 0.2, (8, 3))])  # rad
    roll, pitch, yaw = (rotation_from_vector(angles[:, [i]] * np.eye(3)[i]) for i in range(3))
    one_by_one, R = yaw @ pitch @ roll, rotation_matrix(angles)
    transposed = np.swapaxes(R, -1, -2)
    coarse, wrong = (
        displacements(geometry, trilaterate(geometry, matrix).translation_B, matrix)[: len(of_table_2), :3]
        for matrix in (R, transposed)
    )
    return Erratum(
        "(14)",
        "the matrix is right, its name can be read the other way",
        "R = Rz(yaw) Ry(pitch) Rx(roll) maps components in P to components in B",
        "product of three elementary rotations; with the transposed matrix the coarse legs are up to "
        f"{1e3 * np.abs(wrong - coarse).max():.0f} mm off at the four orientations of section 4.2",
        relative_error(R, one_by_one),
        relative_error(transposed, one_by_one),
    )


def fine_displacement() -> Erratum:
    """(16), first line."""
    geometry = case.parameters().manipulator.geometry
    d = np.random.default_rng(case.SEED).uniform(-1e-3, 1e-3, (8, 6))  # m
    pose = forward_kinematics(geometry, geometry.nominal_lengths + d)
    found = displacements(geometry, pose.translation_B, pose.R)[:, 3:]
    printed = np.linalg.norm(leg_vectors(geometry, pose.translation_B, pose.R), axis=-1)[:, 3:]
    return Erratum(
        "(16), first line",
        "d_fi = |l_fi|",
        "d_fi = |l_fi| - l_f0",
        "poses of the forward kinematics for known displacements within 1 mm",
        relative_error(found, d[:, 3:]),
        relative_error(printed, d[:, 3:]),
    )


def algorithm_1() -> Erratum:
    """Algorithm 1: step size and error limit, and the closed form beside them."""
    geometry, surface = case.parameters().manipulator.geometry, compute_reach().surface
    some = slice(None, None, 20)
    orientation, pose = surface.orientation[some], surface.pose
    bounds = [step_size_bound(geometry, t, R) for t, R in zip(pose.translation_B[some], pose.R[some], strict=True)]
    smallest, largest = (published_numbers()[f"fig7.{name}"].value for name in ("smallest_error", "error"))
    needed = _orientation_error(orientation, partial(descend, epsilon=EPSILON_AS_PUBLISHED))
    return Erratum(
        "Algorithm 1",
        f"no bound of mu; epsilon for example {EPSILON:g} m",
        "mu < 2 / lambda_max(J J^T); epsilon by the precision wanted, or closed-form trilateration",
        f"forward kinematics of the result at {len(orientation)} orientations on the limit of the workspace, closed "
        f"form and epsilon = {EPSILON:g} m; {EPSILON_AS_PUBLISHED:g} m leaves {needed:.0e} deg, "
        f"and Fig 7 shows {smallest:g} to {largest:g} deg. "
        f"The bound of mu is {min(bounds):.2f} to {max(bounds):.2f}: at the nominal pose, "
        f"each step with 0.95 of it multiplies the error by "
        f"{_contraction(0.95):.2f}, with 1.05 of it by {_contraction(1.05):.2f}",
        _orientation_error(orientation, trilaterate),
        _orientation_error(orientation, partial(descend, epsilon=EPSILON)),
        "deg",
    )


ENTRIES = (second_vector, base_term, rotation, fine_displacement, algorithm_1)


def _orientation_error(orientation: Array, solver: Solver) -> float:
    """Largest error, deg, if the coarse legs have the lengths found and the fine legs their nominal ones."""
    geometry = case.parameters().manipulator.geometry
    found = inverse_kinematics(geometry, orientation, solver)
    lengths = geometry.nominal_lengths + np.pad(found.coarse_displacement, ((0, 0), (0, 3)))
    return float(np.degrees(np.abs(forward_kinematics(geometry, lengths).orientation - orientation).max()))


def _contraction(fraction: float) -> float:
    """What a step of Algorithm 1 multiplies the length errors by, with mu a fraction of its bound."""
    geometry = case.parameters().manipulator.geometry
    centres = (geometry.base_joints_B - geometry.platform_joints_P)[3:]  # of the spheres, at zero orientation
    mu = fraction * step_size_bound(geometry, geometry.nominal_translation_B, np.eye(3))
    t_B = geometry.nominal_translation_B + 1e-9  # m
    errors = []
    for _ in range(40):
        legs = t_B - centres
        lengths = np.linalg.norm(legs, axis=1)
        e = geometry.nominal_lengths[3:] - lengths
        t_B = t_B + mu * (legs / lengths[:, None]).T @ e
        errors.append(float(np.linalg.norm(e)))
    return errors[-1] / errors[-2]


NOTHING = LegPart(mass=0.0, com_distance=0.0, radial_inertia=0.0)
TURNED = np.radians([0.0, 0.0, 14.0])  # rad, of section 4.2: every coarse leg is far from its nominal length
ROD_RADIUS = 0.01  # m, chosen: a leg's axial inertia is not published


def slips() -> Erratum:
    """What does not change a result."""
    return Erratum(
        "(A4), (A8), (A10), (A13), (A14), (A16)",
        "v_pf = t_p + ...; n~_cc; index r for c; mu_c twice; terms without transposition",
        "v_pf = t_p' + ...; n~_c; index c; mu_c and eta_c; (q_p'^T q_b'^T)",
        BY_READING,
    )


def spin_of_a_leg() -> Erratum:
    """(A6): B and C with the legs turning about their axes as the base does, and not at all."""
    d, p = case.dynamics(), case.parameters()
    q_b = d.slices["q_b"]
    vectors = leg_vectors(p.manipulator.geometry, d.pose.translation_B, d.pose.rotation_BP)
    axes = vectors / np.linalg.norm(vectors, axis=1)[:, None]
    mass = [leg.lower.mass + leg.upper.mass for leg in _legs()]
    spin = sum(0.5 * m * ROD_RADIUS**2 * np.outer(n, n) for m, n in zip(mass, axes, strict=True))
    M = d.M.copy()
    M[q_b, q_b][3:, 3:] += spin
    with_base, without = Nominal(replace(d, M=M)), case.nominal()
    errors = [relative_error(getattr(without, name)(case.S), getattr(with_base, name)(case.S)) for name in ("B", "C")]
    return Erratum(
        "(A6)",
        "w_leg^T n_U = 0",
        "(w_leg - w_b)^T n_U = 0",
        "the joint's axis turns with the base: a rigid turn of everything turns the legs too. Error of B and C with "
        f"solid cylinders of {1e3 * ROD_RADIUS:g} mm radius as legs; the identified set has no axial inertia",
        error_printed=max(errors),
    )


def angular_velocity() -> Erratum:
    """(A11): kinetic energy of the legs while the fine legs move, base and coarse legs at rest."""
    geometry, pose, legs = case.parameters().manipulator.geometry, case.pose(), _legs()
    twist = np.random.default_rng(case.SEED).normal(size=(8, 3)) @ case.dynamics().jacobians.J_pf.T
    upper, lower = (np.array([getattr(leg, end).com_distance for leg in legs])[:, None] for end in ("upper", "lower"))

    def places(t: float) -> Array:
        """Centres of mass of upper and lower parts, and directions of the legs, (3, 8, 6, 3)."""
        R = rotation_from_vector(t * twist[:, 3:]) @ pose.rotation_BP
        vectors = leg_vectors(geometry, pose.translation_B + t * twist[:, :3], R)
        n = vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
        return np.stack([geometry.base_joints_B + vectors - upper * n, geometry.base_joints_B + lower * n, n])

    v_upper, v_lower, turning = np.sum(rate(places, 1e-4) ** 2, axis=-1)  # squares of speed, and of angular velocity
    energy = np.zeros(len(twist))
    for k, leg in enumerate(legs):
        inertia = leg.upper.radial_inertia + leg.lower.radial_inertia
        energy += 0.5 * (leg.upper.mass * v_upper[:, k] + leg.lower.mass * v_lower[:, k] + inertia * turning[:, k])

    right = 0.5 * np.sum(twist @ leg_mass(legs, geometry, pose.translation_B, pose.rotation_BP).alpha * twist, axis=1)
    printed = right.copy()
    for k, length in enumerate(leg_lengths(geometry, pose.translation_B, pose.rotation_BP)[:3]):
        body = _one_body(legs[k], length).lower
        about_joint = body.radial_inertia + body.mass * body.com_distance**2
        printed += 0.5 * about_joint * (length**2 - 1.0) * turning[:, k]  # w_c without 1 / l_c
    return Erratum(
        "(A11), coarse legs",
        "w_c = n~ (J_pc q_p' - J_bc q_b')",
        "the same divided by l_c, as in the second line",
        "kinetic energy of all legs from finite differences of the places of their parts, fine legs moving at random",
        float(np.abs(right / energy - 1.0).max()),
        float(np.abs(printed / energy - 1.0).max()),
    )


def coarse_leg_as_one_body() -> Erratum:
    """(A17)-(A25): centre of mass and inertia of a coarse leg follow from its current length."""
    manipulator = case.parameters().manipulator
    found = inverse_kinematics(manipulator.geometry, TURNED)
    pose = Pose(found.translation_B, rotation_matrix(TURNED))
    now = leg_lengths(manipulator.geometry, pose.translation_B, pose.rotation_BP)
    s = 2j * np.pi * np.geomspace(1.0, 20.0, 400)  # rad/s, about the resonance of the suspension

    def system(lengths: Array | None) -> Nominal:
        coarse = manipulator.coarse_legs
        if lengths is not None:
            coarse = tuple(map(_one_body, coarse, lengths))
        p = replace(case.parameters(), manipulator=replace(manipulator, coarse_legs=coarse))
        return Nominal(assemble_nominal(p, pose))

    parts = system(None)

    def error(lengths: Array) -> float:
        body = system(lengths)
        return max(relative_error(getattr(body, name)(s), getattr(parts, name)(s)) for name in ("G_P", "A", "C"))

    return Erratum(
        "(A17) to (A25)",
        "right, with rho_c and mu_c as constants",
        "rho_c and mu_c of the two parts at the current length of the leg",
        "G_P, A and C from 1 to 20 Hz at (0, 0, 14) deg with two parts to each leg",
        error(now[:3]),
        error(manipulator.geometry.nominal_lengths[:3]),
    )


LEG_ENTRIES = (slips, spin_of_a_leg, angular_velocity, coarse_leg_as_one_body)


def _legs() -> tuple[CoarseLeg, ...]:
    manipulator = case.parameters().manipulator
    return manipulator.coarse_legs + manipulator.fine_legs


def _one_body(leg: CoarseLeg, length: float) -> CoarseLeg:
    """The locked leg at a length (m) as one body that hangs on the base joint, as in (A3) and (A18)."""
    m, upper_at = leg.lower.mass + leg.upper.mass, length - leg.upper.com_distance
    rho = (leg.lower.mass * leg.lower.com_distance + leg.upper.mass * upper_at) / m
    mu = (
        leg.lower.radial_inertia
        + leg.lower.mass * (leg.lower.com_distance - rho) ** 2
        + leg.upper.radial_inertia
        + leg.upper.mass * (upper_at - rho) ** 2
    )
    return replace(leg, lower=LegPart(mass=m, com_distance=rho, radial_inertia=mu), upper=NOTHING)
