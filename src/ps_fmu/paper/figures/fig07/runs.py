"""Fig 7 on the running FMUs: three closed quadrilaterals and a random walk, from the commander to the plant.

Orientations are commanded one after the other and held until the coarse legs have come to rest; then the platform's
orientation is compared with the target.  Each path is run three times: with the closed-form inverse kinematics, with
Algorithm 1 at the error limit that the paper names, and with one that leaves the errors which it publishes.
"""

from __future__ import annotations

import logging
import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from ....control.commander import DEFAULT_ALGORITHM_1
from ....cosim import Value
from ....mechanism import inverse_kinematics as kinematics
from ....mechanism.inverse_kinematics import inverse_kinematics, reach_along, reachable
from ....mechanism.kinematics import forward_kinematics
from ....mechanism.parameters import Array, Geometry, load
from ....runs.cases import Case, Outcome, run_case
from ....runs.options import OptionError, RunOptions
from ....runs.run import Run
from ....runs.system import RunSystem
from ....scenarios.comparison import TARGET
from ....scenarios.jitter_record import ORIENTATION, REACHABLE
from ...cosimulation import SampleRecord

PLANES = {"roll-pitch": (0, 1), "roll-yaw": (0, 2), "pitch-yaw": (1, 2)}
_MARGIN = 0.98  # of the way to the end of a stroke
_DIRECTIONS = 36  # in which corners are looked for
SETTLE_S = 1.0  # at rest before an error is taken: the servo of 5 Hz leaves 1e-12 of what it lagged behind
COUNTS = range(41, 4, -4)  # of targets along a path
RATE_LIMIT = "plant.servo.rate_limit"
#: In motion the plant's linear model (m) may be a little old; at rest it never is.  Half of the time of a run.
COARSE_MODEL: dict[str, Value] = {"plant.relinearisation_distance": 5e-4}
WALK = "random walk"
RESIDUAL = "commander.residual"
EPSILON_AS_PUBLISHED = 2e-11  # m: with this error limit Algorithm 1 leaves 1e-9 to 1e-8 deg, as in Fig 7


@dataclass(frozen=True)
class Method:
    """Inverse kinematics: the method, and the commander's parameters with which the FMU uses it."""

    method: kinematics.Method
    values: Mapping[str, Value]


def _algorithm_1(epsilon: float) -> Method:
    """Algorithm 1 with an error limit, m."""
    values: dict[str, Value] = {"commander.use_algorithm_1": True, "commander.algorithm_1.epsilon": epsilon}
    return Method(replace(DEFAULT_ALGORITHM_1, epsilon=epsilon).method(), values)


EXACT, PRINTED, FINE = (
    "trilateration", f"Algorithm 1, {DEFAULT_ALGORITHM_1.epsilon:g} m", f"Algorithm 1, {EPSILON_AS_PUBLISHED:g} m",
)  # fmt: skip
#: The methods that each path is run with, by their names in tables.
METHODS = {
    EXACT: Method(kinematics.TRILATERATION, {"commander.use_algorithm_1": False}),
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
    target: Array  # (n, 3)
    response: Array  # (n, 3), at the end of each dwell
    residual: Array  # (n,), m, largest fine displacement that the commander left
    motion: Array  # (m, 3), response along the way
    refused: NDArray[np.bool_]  # (n,), targets that the commander did not take
    time: Array  # (m,), s, of ``motion``
    held: Array  # (m, 3), target along the way

    @property
    def error(self) -> Array:
        """Largest angle error at each target, (n,), rad."""
        return np.asarray(np.abs(self.response - self.target).max(axis=1))

    @property
    def expected_error(self) -> Array:
        """The same by inverse and forward kinematics without FMUs, (n,), rad."""
        geometry = load().manipulator.geometry
        method = METHODS[self.method].method
        # One by one: together, the fast ones would be iterated as often as the slowest.
        coarse = np.array([inverse_kinematics(geometry, rpy, method).coarse_displacement for rpy in self.target])
        pose = forward_kinematics(geometry, geometry.nominal_lengths + np.pad(coarse, ((0, 0), (0, 3))))
        return np.asarray(np.abs(pose.orientation - self.target).max(axis=1))


def largest_error_deg(results: Sequence[PathResult], method: str) -> float:
    """Over all paths with a method, deg."""
    return max(float(np.degrees(r.error.max())) for r in results if r.method == method)


def smallest_error_deg(results: Sequence[PathResult], method: str) -> float:
    """Over all paths with a method, deg, without errors that are exactly zero: those of the nominal pose."""
    return min(float(np.degrees(r.error[r.error > 0.0].min())) for r in results if r.method == method)


def quadrilateral(geometry: Geometry, plane: str, count: int) -> Array:
    """``count`` orientations, (count, 3), rad, evenly along a closed quadrilateral in a plane of two angles.

    It encloses as much area as possible: of all quadrilaterals with corners at the edge of what is within reach, in
    directions 10 deg apart, the largest; then all is shrunk until every point of its sides is within reach as well.
    """
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


def list_cases() -> tuple[str, ...]:
    """Names of the runs."""
    return tuple(_name_case(path, method) for path in (*PLANES, WALK) for method in METHODS)


def load_quiet_system(run: Run) -> RunSystem:
    """The system without disturbance and with the isolator off."""
    return run.load({"disturbance.noise.enabled": False, "isolator.enabled": False})


def measure(system: RunSystem, options: RunOptions) -> list[PathResult]:
    """Run every path with every method.

    The duration of the options is what a path may take: it has as many targets as fit into it with the time to get
    from one to the next.
    """
    return [
        _follow(system, options, path, method, targets, dwell_steps)
        for path, (targets, dwell_steps) in paths(system.get_number(RATE_LIMIT), options).items()
        for method in METHODS
    ]


def paths(rate: float, options: RunOptions) -> dict[str, tuple[Array, int]]:
    """Targets of each path, (n, 3), rad, and the steps at each; ``rate`` of the coarse legs, m/s."""
    geometry = load().manipulator.geometry
    makers: dict[str, Callable[[int], Array]] = {plane: partial(quadrilateral, geometry, plane) for plane in PLANES}
    makers[WALK] = lambda count: random_walk(geometry, count, options.seed or 0)
    return {path: _fit_targets(path, make, rate, options) for path, make in makers.items()}


def _fit_targets(path: str, make: Callable[[int], Array], rate: float, options: RunOptions) -> tuple[Array, int]:
    """As many targets of a path as fit into the duration, and the steps at each; ``rate`` of the coarse legs, m/s."""
    needed = 0.0
    for count in COUNTS:
        targets = make(count)
        dwell_steps = _dwell_steps(targets, rate, options)
        needed = count * dwell_steps * options.step_s
        if needed <= options.duration_s:
            return targets, dwell_steps
    raise OptionError(f"--duration: the path {path} takes {needed:.1f} s at least, got {options.duration_s:g} s")


def _dwell_steps(targets: Array, rate: float, options: RunOptions) -> int:
    """Steps at each target: the coarse legs get there at ``rate``, m/s, and come to rest."""
    coarse = inverse_kinematics(load().manipulator.geometry, targets).coarse_displacement
    dwell_s = float(np.abs(np.diff(coarse, axis=0)).max()) / rate + SETTLE_S
    return math.ceil(dwell_s / options.step_s)


def measure_limits(
    system: RunSystem, options: RunOptions, targets: Array, beyond: Array
) -> tuple[PathResult, PathResult]:
    """Run through orientations at the edge of the workspace, and through others beyond it; (n, 3), rad, each.

    The commander must refuse the latter, which takes no time.
    """
    dwell_steps = _dwell_steps(targets, system.get_number(RATE_LIMIT), options)
    reached = _follow(system, options, "limits", EXACT, targets, dwell_steps)
    with _mute_warnings():  # this run is made to see the refusals
        return reached, _follow(system, options, "beyond the limits", EXACT, beyond, dwell_steps=2)


@contextmanager
def _mute_warnings() -> Iterator[None]:
    logger = logging.getLogger("ps_fmu.cosim")
    level = logger.level
    logger.setLevel(logging.ERROR)
    try:
        yield
    finally:
        logger.setLevel(level)


def _follow(
    system: RunSystem, options: RunOptions, path: str, method: str, targets: Array, dwell_steps: int
) -> PathResult:
    values = {
        **COARSE_MODEL,
        **METHODS[method].values,
        "commander.follow": True,
        **{port: float(angle) for port, angle in zip(TARGET, targets[0], strict=True)},
    }
    events = [
        (k * dwell_steps * options.step_s, port, float(angle))
        for k in range(1, len(targets))
        for port, angle in zip(TARGET, targets[k], strict=True)
    ]
    steps = len(targets) * dwell_steps
    ends = range(dwell_steps, steps + 1, dwell_steps)
    along_the_way = np.arange(0, steps + 1, max(dwell_steps // 50, 1))
    record = SampleRecord(((*ORIENTATION, RESIDUAL, REACHABLE), ends), (ORIENTATION, along_the_way.tolist()))
    case = Case(_name_case(path, method), values, events)
    outcome, _ = run_case(system, options, case, record, duration_s=steps * options.step_s)
    at_rest, motion = record.observers
    return PathResult(
        path,
        method,
        outcome,
        targets,
        at_rest.values(*ORIENTATION),
        at_rest.values(RESIDUAL)[:, 0],
        motion.values(*ORIENTATION),
        at_rest.values(REACHABLE)[:, 0] < 0.5,
        time=np.asarray(along_the_way * options.step_s),
        held=targets[np.minimum(along_the_way // dwell_steps, len(targets) - 1)],
    )


def _name_case(path: str, method: str) -> str:
    return re.sub(r"[^a-z0-9]+", "_", f"{path} {method}".lower())
