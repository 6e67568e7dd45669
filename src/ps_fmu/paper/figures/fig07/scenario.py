"""Fig 7: three closed quadrilaterals and a random walk, from the commander to the plant.

Orientations are commanded one after the other and held until the coarse legs have come to rest; then the platform's
orientation is compared with the target.  Each path is run three times: with the closed-form inverse kinematics, with
Algorithm 1 at the error limit that the paper names, and with one that leaves the errors which it publishes.
"""

from __future__ import annotations

import logging
import math
import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import numpy as np

from ....control.commander import DEFAULT_ALGORITHM_1
from ....cosim import Value
from ....mechanism.inverse_kinematics import inverse_kinematics
from ....mechanism.parameters import Array, load
from ....results.report import Picture, draw_pictures
from ....results.tables import Table
from ....runs.cases import Case, run_case
from ....runs.options import OptionError, RunOptions
from ....runs.publish import Findings
from ....runs.run import Run
from ....runs.setup import RunSystem
from ....scenarios.comparison import TARGET
from ....scenarios.jitter_record import ORIENTATION, REACHABLE
from ...cosimulation import SampleRecord
from .plots import draw_path, explore_paths
from .results import (
    EPSILON_AS_PUBLISHED,
    EXACT,
    FINE,
    METHODS,
    PLANES,
    PRINTED,
    PathResult,
    largest_error_deg,
    quadrilateral,
    random_walk,
    smallest_error_deg,
)

SETTLE_S = 1.0  # at rest before an error is taken: the servo of 5 Hz leaves 1e-12 of what it lagged behind
COUNTS = range(41, 4, -4)  # of targets along a path
RATE_LIMIT = "plant.servo.rate_limit"
#: In motion the plant's linear model (m) and the idle isolator's gains (rad) may be a little old; at rest they never
#: are.  Half of the time of a run.
COARSE_MODEL: dict[str, Value] = {"plant.relinearisation_distance": 5e-4, "isolator.orientation_resolution": 1e-2}
WALK = "random walk"
RESIDUAL = "commander.residual"
BEYOND_DEG = 0.01  # beyond a limit, where targets must be refused

HOW = (
    "The commander turns each target at once into coarse commands; the plant's coarse legs follow them at their rate "
    "limit. Target and response are compared at the end of each dwell, when the legs are at rest: while they move, "
    "the servo adds an error, which the paper's prototype does not have. The response is the orientation that the "
    "plant computes from its coarse legs by forward kinematics; the error is the largest of the three angles."
)


def find(run: Run) -> Findings:
    """Run all paths by all methods; the errors of the orientation."""
    results = measure(load_quiet_system(run), run.options)
    table = error_table(results)
    refused = [
        f"{result.path}, {result.method}: {result.refused.sum()} of {len(result.target)} targets are out of reach: the "
        "platform stayed where it was."
        for result in results
        if result.refused.any()
    ]
    text = [*refused, HOW, algorithm_1_text(results)]
    return Findings(
        title="Trajectories: Fig 7",
        printed="\n".join([table.to_text(), *text]),
        text=text,
        tables=[table],
        outcomes=[result.outcome for result in results],
        orientation_deg=np.degrees(results[-1].response[-1]).tolist(),
        more={"paths": [_entry(result) for result in results]},
        draw=lambda folder: path_pictures(folder, results),
        explore=lambda _path: explore_paths(results),
        refused="\n".join(refused),
    )


def list_cases() -> tuple[str, ...]:
    """Names of the runs."""
    return tuple(_name_case(path, method) for path in (*PLANES, WALK) for method in METHODS)


def path_pictures(folder: Path, results: Sequence[PathResult]) -> list[Picture]:
    """Draw each path, by all methods, into a folder."""
    figures = [
        (
            path.replace(" ", "_").replace("-", "_"),
            f"Target, response and error along the path: {path}.",
            partial(draw_path, results=[result for result in results if result.path == path]),
        )
        for path in dict.fromkeys(result.path for result in results)
    ]
    return draw_pictures(folder, "trajectory", figures)


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


def algorithm_1_text(results: Sequence[PathResult]) -> str:
    """What the error limit of Algorithm 1 does."""
    return (
        f"Algorithm 1 stops at an error of {DEFAULT_ALGORITHM_1.epsilon:g} m of the fine legs, which the paper gives "
        f"as an example; that leaves up to {largest_error_deg(results, PRINTED):.1e} deg. The published errors of 1e-9 "
        f"to 1e-8 deg are those of a limit of {EPSILON_AS_PUBLISHED:g} m: {smallest_error_deg(results, FINE):.1e} to "
        f"{largest_error_deg(results, FINE):.1e} deg. Closed form: {largest_error_deg(results, EXACT):.0e} deg."
    )


def error_table(results: Sequence[PathResult]) -> Table:
    """Largest and median error of each path."""
    rows = [
        (
            result.path,
            result.method,
            f"{len(result.target)}",
            f"{np.degrees(np.median(result.error)):.1e}",
            f"{np.degrees(result.error.max()):.1e}",
            f"{result.residual.max():.1e}",
        )
        for result in results
    ]
    header = ("path", "inverse kinematics", "targets", "median error (deg)", "largest error (deg)", "residual (m)")
    return Table("Error of the orientation at rest; published: 1e-9 to 1e-8 deg", header, rows)


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


def _entry(result: PathResult) -> dict[str, object]:
    return {
        "path": result.path,
        "inverse_kinematics": result.method,
        "targets_deg": np.degrees(result.target),
        "response_deg": np.degrees(result.response),
        "largest_error_deg": float(np.degrees(result.error.max())),
        "largest_residual_m": float(result.residual.max()),
        "refused": int(result.refused.sum()),
    }
