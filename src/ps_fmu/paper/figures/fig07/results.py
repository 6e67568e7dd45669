"""Fig 7: the methods of inverse kinematics, and the result of a path with one of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ....control.commander import DEFAULT_ALGORITHM_1
from ....cosim import Value
from ....mechanism.forward_kinematics import forward_kinematics
from ....mechanism.inverse_kinematics import Solver, inverse_kinematics, trilaterate
from ....mechanism.parameters import Array, load
from ....runs.cases import Outcome

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
