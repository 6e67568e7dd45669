"""Kinetic energy of the legs: Appendix A."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...mechanism.dynamics import Pose
from ...mechanism.inverse_kinematics import inverse_kinematics
from ...mechanism.kinematics import leg_lengths, leg_vectors
from ...mechanism.legs import leg_mass
from ...mechanism.parameters import Array, CoarseLeg, LegPart
from ...mechanism.rotations import rotation_from_vector, rotation_matrix
from ...theory.transfer_matrices import Nominal
from ..nominal_system import assemble_nominal
from . import case
from .erratum import BY_READING, Erratum, rate, relative_error

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


ENTRIES = (slips, spin_of_a_leg, angular_velocity, coarse_leg_as_one_body)


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
