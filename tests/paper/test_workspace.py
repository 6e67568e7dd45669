"""The orientations within reach: Table 1, and how far single angles, cubes and cones go."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize_scalar
from support.claims import verify_claim

from ps_fmu.mechanism.inverse_kinematics import (
    inverse_kinematics,
    pure_limits,
    reach_along,
    reachable,
)
from ps_fmu.mechanism.parameters import load
from ps_fmu.mechanism.rotations import rotation_from_vector
from ps_fmu.paper.published import published_numbers
from ps_fmu.paper.workspace import (
    cone,
    grid,
    largest_cube,
    limits,
    rim,
    sample,
    smallest_tilt,
    surface,
)

GEOMETRY = load().manipulator.geometry


@pytest.fixture(scope="module")
def boundary():
    return sample(GEOMETRY, surface(GEOMETRY))


def test_surface_and_volume_of_the_joint_space():
    assert grid(GEOMETRY, 2e-3).shape == (21**3, 3)
    points = surface(GEOMETRY, 2e-3)
    assert len(points) == 21**3 - 19**3
    assert np.all(np.abs(points).max(axis=1) == GEOMETRY.coarse_stroke[1])


def test_a_step_that_does_not_divide_the_stroke_still_ends_at_its_ends():
    points = grid(GEOMETRY, 7e-3)
    assert points.min() == GEOMETRY.coarse_stroke[0] and points.max() == GEOMETRY.coarse_stroke[1]
    assert len(points) == 7**3  # 40 mm in steps of 7 mm, and the rest


def test_table_1(boundary):
    found = np.degrees(limits(boundary))
    off = []
    for i, angle in enumerate(("roll", "pitch", "yaw")):
        for column, end in enumerate(("min", "max")):
            off.append(abs(found[i, column] / published_numbers()[f"table1.{angle}_{end}"].value - 1.0))
    verify_claim(
        "paper.table_1",
        claim="Limits of roll, pitch and yaw",
        where="`ps-fmu analyse workspace`: terminal, report, workspace.json",
        reference="Table 1 of the paper",
        error=off,
        bound=1e-5,
    )


def test_the_extremes_lie_on_the_surface(boundary):
    inside = limits(sample(GEOMETRY, 0.95 * surface(GEOMETRY, 5e-3)))
    assert np.all(np.abs(inside) < np.abs(limits(boundary)))


def test_samples_are_poses_with_these_displacements(boundary):
    some = slice(None, None, 97)
    found = inverse_kinematics(GEOMETRY, boundary.orientation[some])
    assert np.abs(found.coarse_displacement - boundary.coarse_displacement[some]).max() < 1e-12  # m
    assert np.abs(found.fine_displacement).max() < 1e-12  # m


def test_singular_values_give_the_condition_number(boundary):
    ratio = boundary.singular_values[:, 0] / boundary.singular_values[:, -1]
    assert ratio == pytest.approx(boundary.condition, rel=1e-12)


def test_one_angle_alone_ends_where_a_leg_is_at_its_stop():
    found = pure_limits(GEOMETRY)
    poses = [inverse_kinematics(GEOMETRY, angle * np.eye(3)[i]) for i in range(3) for angle in found[i]]
    verify_claim(
        "paper.one_angle",
        claim="Largest roll, pitch and yaw alone",
        where="`ps-fmu analyse workspace`: terminal, report, workspace.json",
        reference="inverse kinematics there: a leg is at its stop",
        error=[abs((0.02 - np.abs(pose.coarse_displacement)).min()) for pose in poses],
        bound=1e-9,
        unit="m",
    )
    assert np.degrees(found[1]) == pytest.approx([-7.9, 7.4], abs=0.05)


def test_all_of_the_largest_cube_is_within_reach_and_no_more():
    size = largest_cube(GEOMETRY, across=11)
    assert np.degrees(size) == pytest.approx(4.04, abs=0.05)
    inside = np.random.default_rng(1).uniform(-size, size, (500, 3))
    assert reachable(GEOMETRY, inverse_kinematics(GEOMETRY, inside)).all()
    corners = 1.01 * size * np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, -1).T
    assert not reachable(GEOMETRY, inverse_kinematics(GEOMETRY, corners)).all()


def test_a_tilt_towards_x_is_pitch_and_towards_minus_y_roll():
    pure = pure_limits(GEOMETRY)
    found = cone(GEOMETRY, np.radians([0.0, 90.0, 180.0, 270.0]))
    expected = [pure[1, 1], -pure[0, 0], -pure[1, 0], pure[0, 1]]
    assert found == pytest.approx(expected, rel=1e-9)


def test_a_twist_out_of_reach_has_no_cone():
    assert cone(GEOMETRY, np.zeros(1), np.radians(30.0)) == -1.0


def test_no_direction_allows_less_tilt_than_the_smallest():
    degree = np.radians(np.arange(360.0))
    found = smallest_tilt(GEOMETRY, degree)
    anywhere = np.random.default_rng(1).uniform(0.0, 2.0 * np.pi, 500)
    verify_claim(
        "paper.cone",
        claim="Tilt that is within reach in any direction, rounded down",
        where="`ps-fmu analyse workspace`: terminal, report, workspace.json",
        reference="the limit in 500 drawn directions",
        error=found - cone(GEOMETRY, anywhere),
        bound=1e-9,
        unit="rad",
    )
    assert found < cone(GEOMETRY, degree).min()  # 1.5e-4 deg below what whole degrees show
    finer = smallest_tilt(GEOMETRY, np.radians(np.arange(90.0, 150.0, 0.2)))
    assert finer == pytest.approx(found, abs=np.radians(3e-7))


@pytest.mark.parametrize("edge", range(6))
def test_the_rim_is_what_the_best_twist_reaches(edge):
    """Against the twist with the largest tilt, searched for with inverse kinematics, in the middle of each edge."""
    azimuth, tilt = (values[100 * edge + 37] for values in rim(GEOMETRY, 100))
    lowest, highest = pure_limits(GEOMETRY)[2]  # a twist alone is a yaw

    def less(twist):
        return -cone(GEOMETRY, np.array([azimuth]), twist)[0]

    best = minimize_scalar(less, bounds=(0.99 * lowest, 0.99 * highest), method="bounded", options={"xatol": 1e-9})
    assert -best.fun == pytest.approx(tilt, abs=1e-8)


def test_the_rim_goes_round_once():
    azimuth, tilt = rim(GEOMETRY, 50)
    turn = np.diff(np.unwrap(np.append(azimuth, azimuth[0])))
    assert abs(turn.sum()) == pytest.approx(2.0 * np.pi)
    assert np.all(turn > 0.0) or np.all(turn < 0.0)
    assert np.degrees(tilt.min()) == pytest.approx(8.7591, abs=1e-3)


def test_no_rim_is_claimed_where_a_twist_lengthens_one_leg_and_shortens_another():
    base = GEOMETRY.base_joints_B.copy()
    base[0] = rotation_from_vector(np.array([0.0, 0.0, np.radians(95.0)])) @ base[0]  # leans to the other side
    short = np.array([-5e-3, 5e-3])  # m
    with pytest.raises(ValueError, match="all coarse legs one way"):
        rim(replace(GEOMETRY, base_joints_B=base, coarse_stroke=short))


def test_a_curve_that_stays_within_reach_is_followed_to_its_end():
    assert reach_along(GEOMETRY, lambda angle: angle[..., None] * np.eye(3)[:1], 1, 0.01)[0] == 0.01
