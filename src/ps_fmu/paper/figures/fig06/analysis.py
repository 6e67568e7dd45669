"""Table 1 and Fig 6: the orientations within reach, and how well the mechanism is conditioned there."""

from __future__ import annotations

import numpy as np

from ....results.report import Picture
from ....results.tables import Table
from ...analysis import AnalysisOptions
from ...analysis_result import AnalysisResult
from ...finding import Finding
from ...published import ANGLES
from .plots import draw_cone, draw_envelope
from .results import CLAIMED_LIMIT, Reach, compute_reach, round_down


def analyse(options: AnalysisOptions) -> AnalysisResult:
    """Compute the workspace and draw it."""
    reach = compute_reach()
    envelope, cone = options.output / "workspace.png", options.output / "workspace_cone.png"
    draw_envelope(envelope, reach)
    draw_cone(cone, reach)
    return AnalysisResult(
        name="workspace",
        title="Workspace: Table 1 and Fig 6",
        text=paragraphs(reach),
        findings=findings(reach),
        tables=tables(reach),
        pictures=[
            Picture(envelope, "The surface of the workspace, coloured by the condition number of the Jacobian."),
            Picture(cone, "How far the boresight can be tilted in each direction, with and without a twist about it."),
        ],
        data={
            "limits_deg": dict(zip(ANGLES, reach.limits, strict=True)),
            "limits_of_one_angle_alone_deg": dict(zip(ANGLES, reach.pure, strict=True)),
            "largest_cube_deg": reach.cube,
            "cone_deg": reach.cone,
            "cone_with_free_twist_deg": reach.cone_with_free_twist,
            "condition_number": [float(reach.surface.condition.min()), float(reach.surface.condition.max())],
        },
    )


def findings(reach: Reach) -> list[Finding]:
    """Table 1, and the claims that are drawn from it."""
    limits = [
        Finding(f"table1.{angle}_{end}", computed=float(reach.limits[i, column]))
        for i, angle in enumerate(ANGLES)
        for column, end in ((1, "max"), (0, "min"))
    ]
    least = float(np.abs(reach.limits).min())
    alone = float(np.abs(reach.pure).min())
    remark = f"each in some pose; alone, with the other two at zero, only {alone:.2f} deg"
    return [
        *limits,
        Finding("text.cone", computed=least, remark=remark),
        Finding("text.any_orientation", reach.cube, remark="largest cube of roll, pitch and yaw that is within reach"),
    ]


def paragraphs(reach: Reach) -> list[str]:
    """What was computed, and what follows."""
    pitch = reach.pure[1]
    return [
        f"Forward kinematics with the fine legs at nominal length at {len(reach.surface.condition)} points of the "
        "surface of the joint space, 2 mm apart, as in section 4.1.",
        f"Every limit of Table 1 exceeds {CLAIMED_LIMIT:g} deg. Yet not every orientation within {CLAIMED_LIMIT:g} deg "
        f"is within reach: each limit is reached in a pose of its own. Pitch alone goes from {pitch[0]:.2f} to "
        f"{pitch[1]:.2f} deg, and the largest cube of roll, pitch and yaw is +-{round_down(reach.cube)} deg.",
        f"The boresight can be tilted by {round_down(reach.cone)} deg in any direction without twist, and by "
        f"{round_down(reach.cone_with_free_twist)} deg if the platform may also turn about the boresight. The "
        f"claim of {CLAIMED_LIMIT:g} deg in every direction is true of the boresight, not of the orientation.",
    ]


def tables(reach: Reach) -> list[Table]:
    """All tables."""
    return [_range_table(reach), _conditioning_table(reach)]


def _range_table(reach: Reach) -> Table:
    rows = [
        (angle, *(f"{value:+.3f}" for value in (*reach.limits[i], *reach.pure[i]))) for i, angle in enumerate(ANGLES)
    ]
    header = ("angle (deg)", "smallest", "largest", "smallest alone", "largest alone")
    return Table("Range of each angle: over the workspace, and with the other two at zero", header, rows)


def _conditioning_table(reach: Reach) -> Table:
    values, condition = reach.surface.singular_values, reach.surface.condition
    rows = [
        (f"singular value {i + 1}", f"{values[:, i].min():.4f}", f"{values[:, i].max():.4f}") for i in range(6)
    ]
    rows.append(("condition number", f"{condition.min():.3f}", f"{condition.max():.3f}"))
    return Table(
        "Jacobian J_lp (6) over the surface, rotations as arc at the platform joints",
        ("", "smallest", "largest"),
        rows,
    )
