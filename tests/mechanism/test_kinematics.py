"""Legs and Jacobians against finite differences and rigid motions; the conditions of section 2.2."""

from dataclasses import replace

import numpy as np
import pytest

from ps_fmu.mechanism.inverse_kinematics import inverse_kinematics
from ps_fmu.mechanism.kinematics import (
    SingularPoseError,
    condition_number,
    displacements,
    jacobians,
    leg_lengths,
    leg_vectors,
    list_singularities,
    platform_jacobian,
)
from ps_fmu.mechanism.parameters import load
from ps_fmu.mechanism.rotations import rotation_from_vector, rotation_matrix

GEOMETRY = load().manipulator.geometry
NOMINAL = (GEOMETRY.nominal_translation_B, np.eye(3))
# The four orientations of Table 2, deg.
ORIENTATIONS = np.radians([[0.0, 0.0, 0.0], [8.5, 0.0, 0.0], [0.0, -7.0, 0.0], [0.0, 0.0, 14.0]])


def poses():
    pose = inverse_kinematics(GEOMETRY, ORIENTATIONS)
    return list(zip(pose.translation_B, rotation_matrix(ORIENTATIONS), strict=True))


def lengths_after(translation_B, R, dq_p, dq_b):
    """Leg lengths after small motions of platform and base, both in axes of the undisturbed B."""
    platform = translation_B + dq_p[:3] + GEOMETRY.platform_joints_P @ (rotation_from_vector(dq_p[3:]) @ R).T
    base = dq_b[:3] + GEOMETRY.base_joints_B @ rotation_from_vector(dq_b[3:]).T
    return np.linalg.norm(platform - base, axis=1)


def test_displacements_vanish_at_the_nominal_pose():
    np.testing.assert_array_equal(displacements(GEOMETRY, *NOMINAL), np.zeros(6))


def test_leg_vectors_join_the_joints():
    t, R = poses()[1]
    for i, leg in enumerate(leg_vectors(GEOMETRY, t, R)):
        expected = t + R @ GEOMETRY.platform_joints_P[i] - GEOMETRY.base_joints_B[i]
        np.testing.assert_allclose(leg, expected, atol=1e-16)


@pytest.mark.parametrize("pose", poses())
def test_jacobians_are_derivatives_of_the_lengths(pose):
    """Eqs (3), (6), (7): dd = J_lp dq_p - J_lb dq_b, central differences."""
    h, zero = 1e-6, np.zeros(6)
    unit = np.eye(6) * h
    d_p = np.array([lengths_after(*pose, e, zero) - lengths_after(*pose, -e, zero) for e in unit]).T / (2 * h)
    d_b = np.array([lengths_after(*pose, zero, e) - lengths_after(*pose, zero, -e) for e in unit]).T / (2 * h)
    np.testing.assert_allclose(platform_jacobian(GEOMETRY, *pose), d_p, atol=1e-9)
    np.testing.assert_allclose(-jacobians(GEOMETRY, *pose).J_lb, d_b, atol=1e-9)


@pytest.mark.parametrize("pose", poses())
def test_platform_follows_legs_and_base_with_the_corrected_sign(pose):
    """Eqs (8), (11) as corrected: dq_p = J_pl dd + J_pb dq_b; the lengths change by exactly dd."""
    J = jacobians(GEOMETRY, *pose)
    rng = np.random.default_rng(3)
    dd, dq_b = 1e-8 * rng.normal(size=(2, 6))
    change = lengths_after(*pose, J.J_pl @ dd + J.J_pb @ dq_b, dq_b) - leg_lengths(GEOMETRY, *pose)
    np.testing.assert_allclose(change, dd, rtol=0, atol=2e-14)  # second order in the motion
    wrong = lengths_after(*pose, J.J_pl @ dd - J.J_pb @ dq_b, dq_b) - leg_lengths(GEOMETRY, *pose)
    assert np.abs(wrong - dd).max() > 1e-9


@pytest.mark.parametrize("pose", poses())
def test_with_held_legs_the_platform_moves_with_the_base_as_one_body(pose):
    """J_pb of eq (10) is the rigid transfer: [E, -skew(t)] above J_theta_b = [0 E]."""
    t = pose[0]
    J = jacobians(GEOMETRY, *pose)
    np.testing.assert_allclose(J.J_theta_b, np.hstack([np.zeros((3, 3)), np.eye(3)]), atol=1e-13)
    np.testing.assert_allclose(J.J_pb[:3] @ [0, 0, 0, 1, 2, 3], np.cross([1, 2, 3], t), atol=1e-13)


def test_blocks_tile_the_matrices_and_batches_equal_single_poses():
    t, R = (np.array(x) for x in zip(*poses(), strict=True))
    batch = jacobians(GEOMETRY, t, R)
    np.testing.assert_array_equal(np.concatenate([batch.J_pc, batch.J_pf], axis=-1), batch.J_pl)
    turns = np.concatenate([batch.J_theta_c, batch.J_theta_f], axis=-1)
    np.testing.assert_array_equal(turns, batch.J_pl[:, 3:])
    single = jacobians(GEOMETRY, t[2], R[2])
    for name in ("J_lp", "J_lb", "J_pl", "J_pb"):
        np.testing.assert_allclose(getattr(batch, name)[2], getattr(single, name), rtol=0, atol=1e-14)


@pytest.mark.parametrize("pose", poses())
def test_the_workspace_is_far_from_singular(pose):
    assert list_singularities(GEOMETRY, *pose) == []
    assert 4.0 < condition_number(GEOMETRY, platform_jacobian(GEOMETRY, *pose)) < 5.0


def test_dependent_coarse_directions_are_named():
    """Parallel coarse legs turn nothing without the fine ones: N_c singular."""
    base = GEOMETRY.base_joints_B.copy()
    base[:3] = GEOMETRY.platform_joints_P[:3]
    found = list_singularities(replace(GEOMETRY, base_joints_B=base), *NOMINAL)
    assert any("N_c" in reason for reason in found)


def test_singular_legs_are_named_and_refused():
    """Fine legs on top of the coarse legs: J_lp has rank 3."""
    geometry = replace(
        GEOMETRY,
        base_joints_B=np.vstack([GEOMETRY.base_joints_B[:3]] * 2),
        platform_joints_P=np.vstack([GEOMETRY.platform_joints_P[:3]] * 2),
    )
    assert any("J_lp" in reason for reason in list_singularities(geometry, *NOMINAL))
    with pytest.raises(SingularPoseError, match="condition number"):
        jacobians(geometry, *NOMINAL)


def test_condition_number_does_not_depend_on_the_unit_of_length():
    mm = replace(
        GEOMETRY,
        base_joints_B=1e3 * GEOMETRY.base_joints_B,
        platform_joints_P=1e3 * GEOMETRY.platform_joints_P,
        nominal_translation_B=1e3 * GEOMETRY.nominal_translation_B,
    )
    t, R = NOMINAL
    in_mm = condition_number(mm, platform_jacobian(mm, 1e3 * t, R))
    in_m = condition_number(GEOMETRY, platform_jacobian(GEOMETRY, t, R))
    np.testing.assert_allclose(in_mm, in_m, rtol=1e-10)
