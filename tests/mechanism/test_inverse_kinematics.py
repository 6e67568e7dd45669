"""Inverse and forward kinematics: reference poses, round trips, Algorithm 1, poses out of reach, Table 1."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.claims import verify_claim

from ps_fmu.mechanism.inverse_kinematics import (
    NotConvergedError,
    inverse_kinematics,
    make_algorithm_1,
    reachable,
    step_size_bound,
    why_unreachable,
)
from ps_fmu.mechanism.kinematics import ForwardKinematicsError, KinematicsError, forward_kinematics, leg_lengths
from ps_fmu.mechanism.parameters import load

GEOMETRY = load().manipulator.geometry
REFERENCE = json.loads((Path(__file__).parents[1] / "data" / "multibody-reference.json").read_text())["cases"]

stroke = st.floats(-0.02, 0.02)  # m
coarse_displacements = st.tuples(stroke, stroke, stroke).map(np.array)


def lengths_of(coarse_displacement):
    """Leg lengths with the fine actuators at rest."""
    d_c = np.asarray(coarse_displacement)
    return GEOMETRY.nominal_lengths + np.concatenate([d_c, np.zeros_like(d_c)], axis=-1)


def workspace(n=500, seed=4):
    """Orientations that cover the workspace: forward kinematics of displacements all over the stroke."""
    d_c = np.random.default_rng(seed).uniform(-0.02, 0.02, (n, 3))
    return d_c, forward_kinematics(GEOMETRY, lengths_of(d_c))


@pytest.mark.parametrize("case", REFERENCE, ids=lambda c: str(c["orientation_rpy_deg"]))
def test_pose_and_lengths_of_the_multibody_prototype(case):
    pose = inverse_kinematics(GEOMETRY, np.radians(case["orientation_rpy_deg"]))
    np.testing.assert_allclose(pose.translation_B, case["platform_translation_m"], rtol=0, atol=1e-12)
    lengths = GEOMETRY.nominal_lengths[:3] + pose.coarse_displacement
    verify_claim(
        "model.pose",
        claim="Position and coarse legs at an orientation",
        where="`ps-fmu analyse workspace`, `run slew`: pose of the mechanism",
        reference="constraint solution of the multibody program (Pinocchio)",
        error=np.abs(lengths - case["coarse_lengths_m"]),
        bound=1e-12,
        unit="m",
    )


@given(coarse_displacements)
def test_round_trip_over_the_workspace(d_c):
    forward = forward_kinematics(GEOMETRY, lengths_of(d_c))
    inverse = inverse_kinematics(GEOMETRY, forward.orientation)
    assert inverse.solved and reachable(GEOMETRY, inverse)
    np.testing.assert_allclose(inverse.coarse_displacement, d_c, rtol=0, atol=1e-14)
    np.testing.assert_allclose(inverse.translation_B, forward.translation_B, rtol=0, atol=1e-14)


def test_trilateration_is_exact_to_rounding():
    """Within 1e-12 deg over the workspace: command, exact legs, forward kinematics, orientation."""
    _, forward = workspace()
    command = forward.orientation
    inverse = inverse_kinematics(GEOMETRY, command)
    assert inverse.residual.max() < 3e-16
    again = forward_kinematics(GEOMETRY, lengths_of(inverse.coarse_displacement))
    verify_claim(
        "model.orientation",
        claim="The platform stands at the orientation that is commanded",
        where="`ps-fmu run slew`, `analyse trajectories`: nominal orientation less target",
        reference="forward kinematics of the exact leg lengths, over the workspace",
        error=np.degrees(np.abs(again.orientation - command)),
        bound=1e-12,
        unit="deg",
    )


def test_batches_of_any_shape_equal_single_orientations():
    orientation = workspace(12)[1].orientation.reshape(3, 4, 3)
    batch = inverse_kinematics(GEOMETRY, orientation)
    single = inverse_kinematics(GEOMETRY, orientation[1, 2])
    assert batch.translation_B.shape == (3, 4, 3) and batch.solved.shape == (3, 4)
    for name in ("translation_B", "coarse_displacement"):
        np.testing.assert_allclose(getattr(batch, name)[1, 2], getattr(single, name), rtol=0, atol=1e-15)


def test_trilateration_takes_the_nominal_side():
    """The mirror image of the root has the same fine lengths, with the platform below the base."""
    upside_down = replace(GEOMETRY, nominal_translation_B=GEOMETRY.nominal_translation_B * [1, 1, -1])
    # A mirrored mechanism: base joints at the same height, so that only the side differs.
    flat = GEOMETRY.base_joints_B * [1, 1, 0]
    above = inverse_kinematics(replace(GEOMETRY, base_joints_B=flat), np.zeros(3))
    below = inverse_kinematics(replace(upside_down, base_joints_B=flat), np.zeros(3))
    np.testing.assert_allclose(above.translation_B, GEOMETRY.nominal_translation_B, atol=1e-15)
    np.testing.assert_allclose(below.translation_B, -GEOMETRY.nominal_translation_B, atol=1e-15)


@pytest.mark.parametrize(("epsilon", "within_deg"), [(1e-6, 4.5e-4), (1e-11, 1e-8)])
def test_algorithm_1_within_its_error_limit(epsilon, within_deg):
    _, forward = workspace()
    command = forward.orientation
    solution = inverse_kinematics(GEOMETRY, command, make_algorithm_1(epsilon=epsilon))
    assert solution.residual.max() < epsilon
    assert 20 < solution.iterations < 150
    reached = forward_kinematics(GEOMETRY, lengths_of(solution.coarse_displacement)).orientation
    assert np.degrees(np.abs(reached - command)).max() < within_deg


def test_algorithm_1_refuses_a_step_size_beyond_its_bound():
    bound = step_size_bound(GEOMETRY, GEOMETRY.nominal_translation_B, np.eye(3))
    assert 0.79 < bound < 0.84
    with pytest.raises(KinematicsError, match=rf"2/lambda_max.*{bound:.4f}"):
        inverse_kinematics(GEOMETRY, np.zeros(3), make_algorithm_1(mu=0.9))
    with pytest.raises(KinematicsError, match="0 < mu"):
        inverse_kinematics(GEOMETRY, np.zeros(3), make_algorithm_1(mu=0.0))
    with pytest.raises(KinematicsError, match="epsilon > 0"):
        make_algorithm_1(epsilon=0.0)


def test_algorithm_1_reports_what_was_left_when_it_does_not_converge():
    with pytest.raises(NotConvergedError, match=r"3 iterations.*expected less than 1\.0e-06 m") as caught:
        inverse_kinematics(GEOMETRY, np.radians([8.5, 0.0, 0.0]), make_algorithm_1(max_iterations=3))
    assert 1e-4 < caught.value.residual < 2e-2


def test_no_real_solution_is_a_clear_result():
    orientation = np.radians([[0.0, 0.0, 0.0], [0.0, 0.0, 180.0]])
    pose = inverse_kinematics(GEOMETRY, orientation)
    assert pose.solved.tolist() == [True, False]
    assert reachable(GEOMETRY, pose).tolist() == [True, False]
    assert np.isnan(pose.translation_B[1]).all() and not np.isnan(pose.translation_B[0]).any()
    assert pose.gaps[0].tolist() == [0, 0, 0] and pose.gaps[1].max() > 1e-3
    text = why_unreachable(GEOMETRY, pose)
    assert text is not None and "no common point: fine leg 2 is 1.931 mm too short" in text and "180" in text


def test_centres_on_a_line_are_a_clear_result():
    joints = GEOMETRY.base_joints_B.copy()
    joints[3:] = GEOMETRY.platform_joints_P[3:]
    joints[3:, 0] += [0.1, 0.2, 0.3]  # m
    pose = inverse_kinematics(replace(GEOMETRY, base_joints_B=joints), np.zeros(3))
    assert not pose.solved
    assert "lie on a line" in str(why_unreachable(GEOMETRY, pose))


def test_stroke_names_the_leg_and_the_excess():
    pose = inverse_kinematics(GEOMETRY, np.radians([9.98, 0.0, 0.0]))
    assert pose.solved and not reachable(GEOMETRY, pose)
    text = str(why_unreachable(GEOMETRY, pose))
    assert "coarse leg 2 would need -22.9907 mm, 2.991 mm beyond its stroke of -20 to +20 mm" in text
    assert "at roll 9.9800, pitch 0.0000, yaw 0.0000 deg" in text
    assert why_unreachable(GEOMETRY, inverse_kinematics(GEOMETRY, np.zeros(3))) is None


def test_the_end_of_the_stroke_counts_as_within():
    for d_c in ([0.02, -0.02, 0.02], [-0.02, -0.02, -0.02]):
        forward = forward_kinematics(GEOMETRY, lengths_of(d_c))
        assert reachable(GEOMETRY, inverse_kinematics(GEOMETRY, forward.orientation))


@pytest.mark.parametrize("orientation", [[0.0, np.nan, 0.0], [np.inf, 0.0, 0.0], [0.0, 0.0]])
def test_bad_orientations_are_refused(orientation):
    with pytest.raises(KinematicsError, match="orientation: expected finite"):
        inverse_kinematics(GEOMETRY, np.array(orientation))


def test_forward_kinematics_converges_quadratically():
    r = np.array(forward_kinematics(GEOMETRY, lengths_of([0.02, -0.02, 0.02])).residuals)
    assert r[-1] < 3e-16
    steps = r[:-1][r[:-1] > 1e-12]
    # |error| after a step is below a constant (1/m) times its square.
    assert np.all(steps[1:] < 30.0 * steps[:-1] ** 2) and len(r) <= 8


def test_forward_kinematics_starts_where_it_is_told():
    d_c, forward = workspace(8)
    again = forward_kinematics(GEOMETRY, lengths_of(d_c), forward.translation_B, forward.R)
    assert len(again.residuals) <= 3
    np.testing.assert_allclose(again.R, forward.R, atol=1e-15)
    lengths = leg_lengths(GEOMETRY, again.translation_B, again.R)
    np.testing.assert_allclose(lengths, lengths_of(d_c), rtol=0, atol=3e-16)


def test_forward_kinematics_reports_its_residual():
    impossible = GEOMETRY.nominal_lengths.copy()
    impossible[0] += 0.5  # m; the loop of the first leg cannot close
    with pytest.raises(ForwardKinematicsError, match="did not converge") as caught:
        forward_kinematics(GEOMETRY, impossible)
    assert caught.value.residual > 1e-3
    with pytest.raises(KinematicsError, match="positive finite"):
        forward_kinematics(GEOMETRY, [np.nan] * 6)
    with pytest.raises(KinematicsError, match=r"shape \(3,\)"):
        forward_kinematics(GEOMETRY, [0.3, 0.3, 0.3])


def test_table_1():
    """Extremes of roll, pitch and yaw on the boundary of the joint space in 2 mm steps, within 0.001 %."""
    step = np.linspace(-0.02, 0.02, 21)
    grid = np.stack(np.meshgrid(step, step, step), axis=-1).reshape(-1, 3)
    boundary = grid[np.abs(grid).max(axis=1) > 0.0199]
    rpy_deg = np.degrees(forward_kinematics(GEOMETRY, lengths_of(boundary)).orientation)
    np.testing.assert_allclose(rpy_deg.max(axis=0), [9.60083, 9.7894, 16.6285], rtol=1e-5)
    np.testing.assert_allclose(rpy_deg.min(axis=0), [-8.97929, -10.6959, -14.4935], rtol=1e-5)


def test_a_pose_does_not_depend_on_what_is_solved_with_it():
    """Those that are found in fewer steps wait, and keep their bits."""
    random = np.random.default_rng(3)
    lengths = GEOMETRY.nominal_lengths + random.uniform(-0.02, 0.02, (9, 6)) * np.array([[1.0], [1e-3], [0.0]] * 3)
    together = forward_kinematics(GEOMETRY, lengths)
    alone = [forward_kinematics(GEOMETRY, each) for each in lengths]
    assert len({len(each.residuals) for each in alone}) > 2
    for k, each in enumerate(alone):
        assert together.translation_B[k].tobytes() == each.translation_B.tobytes()
        assert together.R[k].tobytes() == each.R.tobytes()
