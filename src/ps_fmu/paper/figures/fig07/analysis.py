"""Fig 7 and Table 1 through commander and plant: errors along closed paths and a random walk, and the limits."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ....analyses.finding import Finding
from ....analyses.options import AnalysisOptions
from ....analyses.result import AnalysisResult
from ....mechanism.parameters import Array
from ....results.tables import Table
from ....runs.run import Run
from ....runs.scenario import Scenario
from ...cosimulation import hold_run
from ...published import ANGLES, make_finding, published_numbers
from ..fig06 import compute_reach
from . import SCENARIO
from .results import EXACT, FINE, PRINTED, PathResult, largest_error_deg, smallest_error_deg
from .scenario import (
    BEYOND_DEG,
    HOW,
    algorithm_1_text,
    error_table,
    load_quiet_system,
    measure,
    measure_limits,
    path_pictures,
)

#: Keys of Table 1, in the order of :func:`extremes`.
LIMITS = tuple(f"table1.{angle}_{end}" for angle in ANGLES for end in ("max", "min"))


def analyse(options: AnalysisOptions, scenario: Scenario = SCENARIO) -> AnalysisResult:
    """Run the paths of the scenario ``trajectories`` and the limits of the workspace, and draw the paths."""
    with hold_run(options, scenario) as run:
        system = load_quiet_system(Run(run))
        results = measure(system, run)
        limits, beyond = measure_limits(system, run, *extremes())
    return AnalysisResult(
        name="trajectories",
        title="Trajectories: Fig 7, and the limits of Table 1",
        text=paragraphs(results, beyond),
        findings=[*limit_findings(limits), *findings(results)],
        tables=[error_table(results), limit_table(limits, beyond)],
        pictures=path_pictures(options.output, results),
        data={
            "largest_error_deg": {f"{r.path}, {r.method}": float(np.degrees(r.error.max())) for r in results},
            "largest_expected_error_deg": {
                f"{r.path}, {r.method}": float(np.degrees(r.expected_error.max())) for r in results
            },
            "limits_reached_deg": np.degrees(limits.response),
            "beyond_refused": beyond.refused.tolist(),
        },
    )


def extremes() -> tuple[Array, Array]:
    """The orientations in which each angle is largest and smallest, and others beyond, (6, 3), rad, each."""
    orientation = compute_reach().surface.orientation
    rows = [int(pick(orientation[:, i])) for i in range(3) for pick in (np.argmax, np.argmin)]
    outwards = np.kron(np.eye(3), [[1.0], [-1.0]])
    return orientation[rows], orientation[rows] + np.radians(BEYOND_DEG) * outwards


def findings(results: Sequence[PathResult]) -> list[Finding]:
    """The numbers of Fig 7, by Algorithm 1 with the error limit that leaves them."""
    ours = [result for result in results if result.method == FINE]
    expected = np.degrees(np.concatenate([result.expected_error for result in ours]))
    largest = largest_error_deg(results, FINE)
    others = (
        f"{PRINTED} leaves {largest_error_deg(results, PRINTED):.1e} deg, {EXACT} "
        f"{largest_error_deg(results, EXACT):.0e} deg"
    )
    return [
        make_finding(
            "fig7.smallest_error", float(expected[expected > 0.0].min()), smallest_error_deg(results, FINE), FINE
        ),
        make_finding("fig7.error", float(expected.max()), largest, f"{FINE}; {others}"),
        make_finding("text.error", float(expected.max()), largest, FINE),
    ]


def limit_findings(limits: PathResult) -> list[Finding]:
    """Table 1 as the plant reached it."""
    reached = np.degrees(_pick_extremes(limits.response))
    return [
        *(make_finding(key, cosimulated=float(angle)) for key, angle in zip(LIMITS, reached, strict=True)),
        make_finding("text.cone", cosimulated=float(np.abs(reached).min())),
    ]


def paragraphs(results: Sequence[PathResult], beyond: PathResult) -> list[str]:
    """What was done, and what follows."""
    return [HOW, algorithm_1_text(results), limits_text(beyond)]


def limits_text(beyond: PathResult) -> str:
    """How the limits were reached and passed."""
    refused = int(beyond.refused.sum())
    return (
        "Table 1: the six orientations in which an angle is largest or smallest (analysis workspace) are commanded one "
        f"after the other, and the plant turns there. Of six targets {BEYOND_DEG:g} deg beyond, {refused} are refused."
    )


def limit_table(limits: PathResult, beyond: PathResult) -> Table:
    """Each limit: published, as computed from the stroke, as reached."""
    targets, reached = (np.degrees(_pick_extremes(values)) for values in (limits.target, limits.response))
    rows = [
        (
            published_numbers()[key].what,
            f"{published_numbers()[key].value:.5f}",
            f"{target:.5f}",
            f"{angle:.5f}",
            f"{error:.0e}",
            "refused" if refused else "taken",
        )
        for key, target, angle, error, refused in zip(
            LIMITS, targets, reached, np.degrees(limits.error), beyond.refused, strict=True
        )
    ]
    header = (
        "limit", "published (deg)", "forward kinematics (deg)", "reached by the FMUs (deg)",
        "error of the orientation (deg)", f"{BEYOND_DEG:g} deg beyond",
    )  # fmt: skip
    return Table("Table 1 through commander and plant", header, rows)


def _pick_extremes(orientation: Array) -> Array:
    """Roll of the first two orientations, pitch of the next two, yaw of the last two, (6,), of (6, 3)."""
    return np.asarray(orientation[np.arange(6), np.repeat(np.arange(3), 2)])
