"""Fig 7, and Table 1 through commander and plant: errors along closed paths and a random walk, and the limits."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ....analyses.result import AnalysisResult, Finding, paint_pictures, tabulate
from ....analyses.table import AnalysisOptions
from ....control.commander import DEFAULT_ALGORITHM_1
from ....mechanism.parameters import Array
from ....results.page.content import Axis, Chart, ChartGroup, Curve, Exploration
from ....results.report import Picture
from ....results.style import ACTIVE, AXES, PASSIVE, REFERENCE
from ....results.tables import Table, format_tables
from ....runs.publish import Findings
from ....runs.run import Run
from ....runs.scenario import SCENARIOS, Scenario
from ....runs.system import DISTURBED
from ...cosimulation import hold_run
from ...published import ANGLES, make_finding, published_numbers
from ..fig06 import compute_reach
from . import runs
from .runs import EXACT, FINE, PLANES, PRINTED, PathResult, list_cases

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["NEEDS", "analyse", "find", "list_cases"]

NEEDS = DISTURBED

#: Keys of Table 1, in the order of :func:`extremes`.
LIMITS = tuple(f"table1.{angle}_{end}" for angle in ANGLES for end in ("max", "min"))
BEYOND_DEG = 0.01  # beyond a limit, where targets must be refused
HOW = (
    "The commander turns each target at once into coarse commands; the plant's coarse legs follow them at their rate "
    "limit. Target and response are compared at the end of each dwell, when the legs are at rest: while they move, "
    "the servo adds an error, which the paper's prototype does not have. The response is the orientation that the "
    "plant computes from its coarse legs by forward kinematics; the error is the largest of the three angles."
)
COLOURS = (ACTIVE, PASSIVE, AXES[2])


def find(run: Run) -> Findings:
    """Run all paths by all methods; the errors of the orientation."""
    results = runs.measure(runs.load_quiet_system(run), run.options)
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
        printed=format_tables([table], text),
        text=text,
        tables=[table],
        outcomes=[result.outcome for result in results],
        orientation_deg=np.degrees(results[-1].response[-1]).tolist(),
        more={
            "paths": [
                {
                    "path": r.path,
                    "inverse_kinematics": r.method,
                    "targets_deg": np.degrees(r.target),
                    "response_deg": np.degrees(r.response),
                    "largest_error_deg": float(np.degrees(r.error.max())),
                    "largest_residual_m": float(r.residual.max()),
                    "refused": int(r.refused.sum()),
                }
                for r in results
            ]
        },
        draw=lambda folder: path_pictures(folder, results),
        explore=lambda _path: explore_paths(results),
        refused="\n".join(refused),
    )


def analyse(options: AnalysisOptions, scenario: Scenario = SCENARIOS["trajectories"]) -> AnalysisResult:
    """Run the paths of the scenario ``trajectories`` and the limits of the workspace, and draw the paths."""
    with hold_run(options, scenario) as run:
        system = runs.load_quiet_system(run)
        results = runs.measure(system, run.options)
        limits, beyond = runs.measure_limits(system, run.options, *extremes())
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
    largest = runs.largest_error_deg(results, FINE)
    others = (
        f"{PRINTED} leaves {runs.largest_error_deg(results, PRINTED):.1e} deg, {EXACT} "
        f"{runs.largest_error_deg(results, EXACT):.0e} deg"
    )
    return [
        make_finding(
            "fig7.smallest_error", float(expected[expected > 0.0].min()), runs.smallest_error_deg(results, FINE), FINE
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
    return [
        HOW,
        algorithm_1_text(results),
        "Table 1: the six orientations in which an angle is largest or smallest (analysis workspace) are commanded one "
        f"after the other, and the plant turns there. Of six targets {BEYOND_DEG:g} deg beyond, {beyond.refused.sum()} "
        "are refused.",
    ]


def algorithm_1_text(results: Sequence[PathResult]) -> str:
    """What the error limit of Algorithm 1 does."""
    printed, fine, exact = (runs.largest_error_deg(results, method) for method in (PRINTED, FINE, EXACT))
    return (
        f"Algorithm 1 stops at an error of {DEFAULT_ALGORITHM_1.epsilon:g} m of the fine legs, which the paper gives "
        f"as an example; that leaves up to {printed:.1e} deg. The published errors of 1e-9 to 1e-8 deg are those of a "
        f"limit of {runs.EPSILON_AS_PUBLISHED:g} m: {runs.smallest_error_deg(results, FINE):.1e} to {fine:.1e} deg. "
        f"Closed form: {exact:.0e} deg."
    )


def error_table(results: Sequence[PathResult]) -> Table:
    """Largest and median error of each path."""
    return tabulate(
        "Error of the orientation at rest; published: 1e-9 to 1e-8 deg",
        results,
        (
            ("path", lambda r: r.path),
            ("inverse kinematics", lambda r: r.method),
            ("targets", lambda r: f"{len(r.target)}"),
            ("median error (deg)", lambda r: f"{np.degrees(np.median(r.error)):.1e}"),
            ("largest error (deg)", lambda r: f"{np.degrees(r.error.max()):.1e}"),
            ("residual (m)", lambda r: f"{r.residual.max():.1e}"),
        ),
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


def path_pictures(folder: Path, results: Sequence[PathResult]) -> list[Picture]:
    """Paint each path, by all methods, into a folder."""
    figures = [
        (
            path.replace(" ", "_").replace("-", "_"), f"Target, response and error along the path: {path}.",
            (7.5 if path in PLANES else 14.0, 9.5), paint_path, [r for r in results if r.path == path],
        )
        for path in dict.fromkeys(result.path for result in results)
    ]  # fmt: skip
    return paint_pictures(folder, "trajectory", *figures)


def paint_path(figure: Figure, results: Sequence[PathResult]) -> None:
    """One path with several methods: targets and response in each plane that the path uses; below the errors."""
    first = results[0]
    planes = [PLANES[first.path]] if first.path in PLANES else list(PLANES.values())
    grid = figure.add_gridspec(2, len(planes), height_ratios=(2.0, 1.0))
    for column, (i, j) in enumerate(planes):
        axes = figure.add_subplot(grid[0, column])
        motion, target = np.degrees(first.motion), np.degrees(first.target)
        axes.plot(motion[:, i], motion[:, j], color=ACTIVE, label="response")
        axes.plot(target[:, i], target[:, j], "o", color=REFERENCE, fillstyle="none", label="target")
        axes.set(xlabel=f"{ANGLES[i]} (deg)", ylabel=f"{ANGLES[j]} (deg)", aspect="equal")
        if column == 0:
            axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2)
    errors = figure.add_subplot(grid[1, :])
    for result, colour in zip(results, COLOURS, strict=False):
        number = np.arange(1, len(result.error) + 1)
        shown = result.error > 0.0  # none at all at the nominal pose, which a logarithm cannot show
        error = np.degrees(result.error[shown])
        errors.semilogy(number[shown], error, "o-", color=colour, markersize=4.0, label=result.method)
    errors.axhspan(1e-9, 1e-8, color=REFERENCE, alpha=0.25, label="published")
    errors.set(xlabel="number of the target", ylabel="error at rest (deg)", ylim=(1e-15, 1e-2))
    errors.legend(ncols=4 if len(planes) > 1 else 2, loc="lower center", bbox_to_anchor=(0.5, 1.0))
    figure.suptitle(f"Path: {first.path}")


def explore_paths(results: Sequence[PathResult]) -> Exploration:
    """Charts of target and response along each path, deg; by trilateration, which the others do not differ from."""
    return Exploration([_chart_path(result) for result in results if result.method == EXACT])


def _chart_path(result: PathResult) -> ChartGroup:
    charts = [
        Chart(
            angle,
            "deg",
            [
                Curve("target", "reference", np.degrees(result.held[:, k])),
                Curve("response", "active", np.degrees(result.motion[:, k])),
            ],
        )
        for k, angle in enumerate(ANGLES)
    ]
    caption = "The coarse legs follow each target at their rate limit, and rest at it."
    return ChartGroup(f"Path: {result.path}", caption, Axis("time", "s", result.time), charts)
