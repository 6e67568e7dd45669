"""Kinematics: (5) to (17) and Algorithm 1."""

from __future__ import annotations

from functools import partial

import numpy as np

from ...control.commander import DEFAULT_ALGORITHM_1
from ...mechanism.forward_kinematics import forward_kinematics
from ...mechanism.inverse_kinematics import Solver, descend, inverse_kinematics, step_size_bound, trilaterate
from ...mechanism.kinematics import displacements, leg_lengths, leg_vectors
from ...mechanism.parameters import Array
from ...mechanism.rotations import rotation_from_vector, rotation_matrix
from ..figures.fig06.results import compute_reach
from ..figures.fig07.results import EPSILON_AS_PUBLISHED
from ..figures.table2.closed_form import ORIENTATIONS
from ..published import published_numbers
from . import case
from .erratum import BY_READING, Erratum, rate, relative_error

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
