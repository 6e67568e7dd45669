"""Kinematics: (5) to (17), Algorithm 1, and the kinetic energy of the legs: Appendix A."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from ...control.commander import DEFAULT_ALGORITHM_1
from ...mechanism.dynamics import Pose, payload_mass
from ...mechanism.inverse_kinematics import TRILATERATION, Method, inverse_kinematics, make_algorithm_1, step_size_bound
from ...mechanism.kinematics import displacements, forward_kinematics, leg_lengths, leg_vectors
from ...mechanism.parameters import Array, CoarseLeg, LegPart
from ...mechanism.rotations import roll_pitch_yaw, rotation_from_vector, rotation_matrix
from ...theory.transfer_matrices import Nominal
from ..bus_cases import assemble_nominal
from ..figures.fig06 import compute_reach
from ..figures.fig07.runs import EPSILON_AS_PUBLISHED
from ..figures.table2.runs import ORIENTATIONS
from ..published import published_numbers
from . import case
from .case import Erratum, make_erratum, rate, relative_error

EPSILON = DEFAULT_ALGORITHM_1.epsilon  # m, of Algorithm 1 as printed


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
    return make_erratum("(8), (11)", relative_error(by_legs + by_base, moved), relative_error(by_legs - by_base, moved))


def rotation() -> Erratum:
    """(14): which way the matrix maps."""
    geometry = case.parameters().manipulator.geometry
    of_table_2 = np.radians(list(ORIENTATIONS.values()))
    angles = np.vstack([of_table_2, np.random.default_rng(case.SEED).uniform(-0.2, 0.2, (8, 3))])  # rad
    roll, pitch, yaw = (rotation_from_vector(angles[:, [i]] * np.eye(3)[i]) for i in range(3))
    one_by_one, R = yaw @ pitch @ roll, rotation_matrix(angles)
    transposed = np.swapaxes(R, -1, -2)
    coarse, wrong = (
        inverse_kinematics(geometry, roll_pitch_yaw(matrix)).coarse_displacement[: len(of_table_2)]
        for matrix in (R, transposed)
    )
    off_mm = 1e3 * np.abs(wrong - coarse).max()
    return make_erratum("(14)", relative_error(R, one_by_one), relative_error(transposed, one_by_one), off_mm=off_mm)


def fine_displacement() -> Erratum:
    """(16), first line."""
    geometry = case.parameters().manipulator.geometry
    d = np.random.default_rng(case.SEED).uniform(-1e-3, 1e-3, (8, 6))  # m
    pose = forward_kinematics(geometry, geometry.nominal_lengths + d)
    found = displacements(geometry, pose.translation_B, pose.R)[:, 3:]
    printed = np.linalg.norm(leg_vectors(geometry, pose.translation_B, pose.R), axis=-1)[:, 3:]
    return make_erratum("(16), first line", relative_error(found, d[:, 3:]), relative_error(printed, d[:, 3:]))


def algorithm_1() -> Erratum:
    """Algorithm 1: step size and error limit, and the closed form beside them."""
    geometry, surface = case.parameters().manipulator.geometry, compute_reach().surface
    some = slice(None, None, 20)
    orientation, pose = surface.orientation[some], surface.pose
    bounds = [step_size_bound(geometry, t, R) for t, R in zip(pose.translation_B[some], pose.R[some], strict=True)]
    smallest, largest = (published_numbers()[f"fig7.{name}"].value for name in ("smallest_error", "error"))
    needed = _orientation_error(orientation, make_algorithm_1(epsilon=EPSILON_AS_PUBLISHED))
    return make_erratum(
        "Algorithm 1",
        _orientation_error(orientation, TRILATERATION),
        _orientation_error(orientation, make_algorithm_1(epsilon=EPSILON)),
        epsilon=EPSILON, orientations=len(orientation), fine=EPSILON_AS_PUBLISHED, needed=needed, smallest=smallest,
        largest=largest, lowest_bound=min(bounds), highest_bound=max(bounds), below=_contraction(0.95),
        above=_contraction(1.05),
    )  # fmt: skip


ENTRIES = (partial(make_erratum, "(5)"), base_term, rotation, fine_displacement, algorithm_1)


def _orientation_error(orientation: Array, method: Method) -> float:
    """Largest error, deg, if the coarse legs have the lengths found and the fine legs their nominal ones."""
    geometry = case.parameters().manipulator.geometry
    found = inverse_kinematics(geometry, orientation, method)
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
    return make_erratum("(A6)", error_printed=max(errors), radius_mm=1e3 * ROD_RADIUS)


def angular_velocity() -> Erratum:
    """(A11): kinetic energy of the legs while the fine legs move, base and coarse legs at rest."""
    geometry, pose, legs = case.parameters().manipulator.geometry, case.pose(), _legs()
    d, rates = case.dynamics(), np.random.default_rng(case.SEED).normal(size=(8, 3))
    J, twist = d.jacobians, rates @ d.jacobians.J_pf.T
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

    of_payload = J.J_pf.T @ payload_mass(case.parameters().payload, pose.rotation_BP) @ J.J_pf
    right = 0.5 * np.sum(rates @ (d.M[d.slices["d_f"], d.slices["d_f"]] - of_payload) * rates, axis=1)
    printed = right.copy()
    for k, length in enumerate(leg_lengths(geometry, pose.translation_B, pose.rotation_BP)[:3]):
        body = _one_body(legs[k], length).lower
        about_joint = body.radial_inertia + body.mass * body.com_distance**2
        printed += 0.5 * about_joint * (length**2 - 1.0) * turning[:, k]  # w_c without 1 / l_c
    off_right, off_printed = (float(np.abs(found / energy - 1.0).max()) for found in (right, printed))
    return make_erratum("(A11), coarse legs", off_right, off_printed)


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

    return make_erratum("(A17) to (A25)", error(now[:3]), error(manipulator.geometry.nominal_lengths[:3]))


LEG_ENTRIES = (
    partial(make_erratum, "(A4), (A8), (A10), (A13), (A14), (A16)"), spin_of_a_leg, angular_velocity,
    coarse_leg_as_one_body,
)  # fmt: skip


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
