"""Fig 7: the errors along closed paths and a random walk, through commander and plant."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from ..pointing.report import Picture
from .command import Options
from .result import Analysis, Finding

if TYPE_CHECKING:
    from ..scenarios.trajectories import PathResult


def analyse(options: Options) -> Analysis:
    """Run the paths of the scenario ``trajectories``, and draw them."""
    from ..scenarios.options import DEFAULT_DURATION_S, DEFAULT_STEP_S
    from ..scenarios.trajectories import ALGORITHM_1, HOW, error_table, load_quiet_system, measure
    from ..scenarios.trajectory_plots import path_figure
    from .cosimulation import run_options

    name = "trajectories"
    run = run_options(options, name, DEFAULT_DURATION_S[name], DEFAULT_STEP_S[name])
    results = measure(load_quiet_system(run), run)
    pictures = []
    for path in dict.fromkeys(result.path for result in results):
        file = options.output / f"trajectory_{path.replace(' ', '_').replace('-', '_')}.png"
        path_figure(file, [result for result in results if result.path == path])
        pictures.append(Picture(file, f"Target, response and error along the path: {path}."))
    return Analysis(
        name=name,
        title="Trajectories: Fig 7",
        text=[HOW, ALGORITHM_1],
        findings=findings(results),
        tables=[error_table(results)],
        pictures=pictures,
        data={
            "largest_error_deg": {f"{r.path}, {r.solver}": float(np.degrees(r.error.max())) for r in results},
        },
    )


def findings(results: Sequence[PathResult]) -> list[Finding]:
    """The largest error of the closed-form inverse kinematics; what Algorithm 1 leaves is in the remark."""
    largest = {
        solver: max(float(np.degrees(r.error.max())) for r in results if r.solver == solver)
        for solver in dict.fromkeys(r.solver for r in results)
    }
    (exact, iterative) = largest.values()
    remark = f"trilateration; Algorithm 1 with 1e-6 m leaves {iterative:.1e} deg"
    return [Finding("fig7.error", cosimulated=exact, remark=remark)]
