"""Paths through the workspace."""

import numpy as np
import pytest

from ps_fmu.mechanism.inverse_kinematics import inverse_kinematics
from ps_fmu.mechanism.parameters import load
from ps_fmu.mechanism.reachability import reachable, stroke_margin
from ps_fmu.paper.figures.fig07.target_paths import PLANES, quadrilateral, random_walk

GEOMETRY = load().manipulator.geometry


@pytest.mark.parametrize("plane", PLANES)
def test_quadrilaterals_are_closed_within_reach_and_go_to_the_edge(plane):
    path = quadrilateral(GEOMETRY, plane, 201)
    pose = inverse_kinematics(GEOMETRY, path)
    assert reachable(GEOMETRY, pose).all()
    assert stroke_margin(GEOMETRY, pose.coarse_displacement).min() < 1e-3  # m, of 20
    assert np.array_equal(path[0], path[-1])
    (third,) = set(range(3)) - set(PLANES[plane])
    assert not path[:, third].any()
    corners = path[[0, 50, 100, 150]]
    assert np.abs(corners).max(axis=0)[list(PLANES[plane])].min() > np.radians(4.0)


def test_a_quadrilateral_has_corners():
    with pytest.raises(ValueError, match="five points or more, got 4"):
        quadrilateral(GEOMETRY, "roll-pitch", 4)


def test_random_walk_stays_within_reach_and_depends_on_the_seed_alone():
    path = random_walk(GEOMETRY, 60, seed=3)
    assert reachable(GEOMETRY, inverse_kinematics(GEOMETRY, path)).all()
    assert np.array_equal(path, random_walk(GEOMETRY, 60, seed=3))
    assert not np.array_equal(path, random_walk(GEOMETRY, 60, seed=4))
    assert np.degrees(np.ptp(path, axis=0)).min() > 3.0
