"""Paths of orientations through the workspace, as for Fig 7: closed quadrilaterals, and a random walk."""

from __future__ import annotations

from functools import lru_cache
from itertools import combinations

import numpy as np

from ....mechanism.inverse_kinematics import inverse_kinematics
from ....mechanism.parameters import Array, Geometry
from ....mechanism.reachability import reachable
from ....mechanism.workspace import reach_along

PLANES = {"roll-pitch": (0, 1), "roll-yaw": (0, 2), "pitch-yaw": (1, 2)}
_MARGIN = 0.98  # of the way to the end of a stroke
_DIRECTIONS = 36  # in which corners are looked for


def quadrilateral(geometry: Geometry, plane: str, count: int) -> Array:
    """``count`` orientations, (count, 3), rad, evenly along a closed quadrilateral in a plane of two angles.

    It encloses as much area as possible: of all quadrilaterals with corners at the edge of what is within reach, in
    directions 10 deg apart, the largest; then all is shrunk until every point of its sides is within reach as well.

    Raises
    ------
    ValueError: fewer than five points.
    """
    if count < 5:
        raise ValueError(f"a quadrilateral needs five points or more, got {count}")
    return _interpolate(_corners(geometry, plane), count)


@lru_cache(maxsize=8)
def _corners(geometry: Geometry, plane: str) -> Array:
    """Corners of the quadrilateral, (4, 3), rad."""
    direction = np.linspace(0.0, 2.0 * np.pi, _DIRECTIONS, endpoint=False)
    rays = np.zeros((_DIRECTIONS, 3))
    rays[:, PLANES[plane]] = np.column_stack([np.cos(direction), np.sin(direction)])
    edge = rays * reach_along(geometry, lambda size: size[..., None] * rays, _DIRECTIONS, np.radians(40.0))[:, None]
    corners = edge[_largest_quadrilateral(edge[:, PLANES[plane]])]
    sides = _interpolate(corners, 401)
    scale = reach_along(geometry, lambda size: size[..., None] * sides, len(sides), 1.0).min()
    return np.asarray(_MARGIN * scale * corners)


def _interpolate(corners: Array, count: int) -> Array:
    """Points along the closed line through the corners, (count, 3), as many on each side."""
    way = np.linspace(0.0, 4.0, count)
    return np.stack([np.interp(way, np.arange(5.0), np.append(side, side[0])) for side in corners.T], axis=1)


def _largest_quadrilateral(edge: Array) -> list[int]:
    """Which four of the points (n, 2), ordered about the origin, enclose most; by the cross product of diagonals."""
    a, b, c, d = np.array(list(combinations(range(len(edge)), 4))).T
    first, second = edge[c] - edge[a], edge[d] - edge[b]
    best = np.argmax(first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0])
    return [int(corner[best]) for corner in (a, b, c, d)]


def random_walk(geometry: Geometry, count: int, seed: int, step: float = np.radians(1.5)) -> Array:
    """``count`` orientations, (count, 3), rad, from zero on.

    Normally distributed steps of ``step`` (rad); one that leaves the workspace is drawn anew.
    """
    random = np.random.default_rng(seed)
    points = np.zeros((count, 3))
    for k in range(1, count):
        while True:
            points[k] = points[k - 1] + step * random.standard_normal(3)
            if reachable(geometry, inverse_kinematics(geometry, points[k])):
                break
    return points
