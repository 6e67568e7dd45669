"""Fig 7: closed quadrilaterals and a random walk, the methods of inverse kinematics, and what a path comes to."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from ....control.commander import DEFAULT_ALGORITHM_1
from ....cosim import Value
from ....mechanism.forward_kinematics import forward_kinematics
from ....mechanism.inverse_kinematics import Solver, inverse_kinematics, reachable, trilaterate
from ....mechanism.parameters import Array, Geometry, load
from ....runs.cases import Outcome
from ...workspace import reach_along

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


EPSILON_AS_PUBLISHED = 2e-11  # m: with this error limit Algorithm 1 leaves 1e-9 to 1e-8 deg, as in Fig 7


@dataclass(frozen=True)
class Method:
    """Inverse kinematics: the function, and the commander's parameters with which the FMU uses it."""

    solver: Solver
    values: Mapping[str, Value]


def _algorithm_1(epsilon: float) -> Method:
    """Algorithm 1 with an error limit, m."""
    values: dict[str, Value] = {"commander.use_algorithm_1": True, "commander.algorithm_1.epsilon": epsilon}
    return Method(replace(DEFAULT_ALGORITHM_1, epsilon=epsilon).solver(), values)


EXACT, PRINTED, FINE = (
    "trilateration", f"Algorithm 1, {DEFAULT_ALGORITHM_1.epsilon:g} m", f"Algorithm 1, {EPSILON_AS_PUBLISHED:g} m",
)  # fmt: skip
#: The methods that each path is run with, by their names in tables.
METHODS = {
    EXACT: Method(trilaterate, {"commander.use_algorithm_1": False}),
    PRINTED: _algorithm_1(DEFAULT_ALGORITHM_1.epsilon),
    FINE: _algorithm_1(EPSILON_AS_PUBLISHED),
}


@dataclass(frozen=True, eq=False)
class PathResult:
    """One path with one method of inverse kinematics; angles in rad."""

    path: str
    method: str
    """A key of :data:`METHODS`."""
    outcome: Outcome
    target: Array
    """(n, 3)."""
    response: Array
    """(n, 3), at the end of each dwell."""
    residual: Array
    """(n,), m, largest fine displacement that the commander left."""
    motion: Array
    """(m, 3), response along the way."""
    refused: NDArray[np.bool_]
    """(n,), targets that the commander did not take."""
    time: Array
    """(m,), s, of ``motion``."""
    held: Array
    """(m, 3), target along the way."""

    @property
    def error(self) -> Array:
        """Largest angle error at each target, (n,), rad."""
        return np.asarray(np.abs(self.response - self.target).max(axis=1))

    @property
    def expected_error(self) -> Array:
        """The same by inverse and forward kinematics without FMUs, (n,), rad."""
        geometry = load().manipulator.geometry
        solver = METHODS[self.method].solver
        # One by one: together, the fast ones would be iterated as often as the slowest.
        coarse = np.array([inverse_kinematics(geometry, rpy, solver).coarse_displacement for rpy in self.target])
        pose = forward_kinematics(geometry, geometry.nominal_lengths + np.pad(coarse, ((0, 0), (0, 3))))
        return np.asarray(np.abs(pose.orientation - self.target).max(axis=1))


def largest_error_deg(results: Sequence[PathResult], method: str) -> float:
    """Over all paths with a method, deg."""
    return max(float(np.degrees(r.error.max())) for r in results if r.method == method)


def smallest_error_deg(results: Sequence[PathResult], method: str) -> float:
    """Over all paths with a method, deg, without errors that are exactly zero: those of the nominal pose."""
    return min(float(np.degrees(r.error[r.error > 0.0].min())) for r in results if r.method == method)
