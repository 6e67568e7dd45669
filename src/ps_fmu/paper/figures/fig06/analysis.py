"""Table 1 and Fig 6: the orientations within reach, and how well the mechanism is conditioned there."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache

import numpy as np

from ....mechanism import workspace
from ....mechanism.parameters import Array, load
from ....results.report import Picture
from ....results.tables import Table
from ...command import Options
from ...result import Analysis, Finding

ANGLES = ("roll", "pitch", "yaw")
SAID = 8.5  # deg, by section 4.1 exceeded in every direction


@dataclass(frozen=True, eq=False)
class Reach:
    """How far the platform turns: angles in deg."""

    surface: workspace.Sample
    limits: Array
    """(3, 2), smallest and largest roll, pitch, yaw over the workspace."""
    pure: Array
    """(3, 2), the same with the other two angles at zero."""
    cube: float
    """Half the edge of the largest cube of roll, pitch and yaw."""
    azimuth: Array
    """(n,), towards which the boresight tilts, from x towards y of B."""
    tilt: Array
    """(n,), largest tilt there without twist."""
    cone: float
    """Half-angle of the largest cone of boresights without twist."""
    rim_azimuth: Array
    """(m,), of the boresights farthest out with the twist that suits each best, along a closed path."""
    rim_tilt: Array
    """(m,), how far they are tilted."""

    @property
    def cone_with_free_twist(self) -> float:
        """Half-angle of the largest cone of boresights if the platform may turn about its boresight."""
        return float(self.rim_tilt.min())


@cache
def compute() -> Reach:
    """The workspace of the identified geometry.  Cached: the errata ask for it too."""
    geometry = load().manipulator.geometry
    surface = workspace.sample(geometry, workspace.surface(geometry))
    azimuth = np.radians(np.arange(360.0))
    rim_azimuth, rim_tilt = workspace.rim(geometry)
    return Reach(
        surface=surface,
        limits=np.degrees(workspace.limits(surface)),
        pure=np.degrees(workspace.pure_limits(geometry)),
        cube=float(np.degrees(workspace.largest_cube(geometry))),
        azimuth=np.degrees(azimuth),
        tilt=np.degrees(workspace.cone(geometry, azimuth)),
        cone=float(np.degrees(workspace.smallest_tilt(geometry, azimuth))),
        rim_azimuth=np.degrees(rim_azimuth),
        rim_tilt=np.degrees(rim_tilt),
    )


def analyse(options: Options) -> Analysis:
    """Compute, draw and word it."""
    from .plots import cone_figure, envelope_figure

    reach = compute()
    envelope, cone = options.output / "workspace.png", options.output / "workspace_cone.png"
    envelope_figure(envelope, reach)
    cone_figure(cone, reach)
    return Analysis(
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
    found = [
        Finding(f"table1.{angle}_{end}", computed=float(reach.limits[i, column]))
        for i, angle in enumerate(ANGLES)
        for column, end in ((1, "max"), (0, "min"))
    ]
    least = float(np.abs(reach.limits).min())
    alone = float(np.abs(reach.pure).min())
    remark = f"each in some pose; alone, with the other two at zero, only {alone:.2f} deg"
    return [
        *found,
        Finding("text.cone", computed=least, remark=remark),
        Finding("text.any_orientation", reach.cube, remark="largest cube of roll, pitch and yaw that is within reach"),
    ]


def paragraphs(reach: Reach) -> list[str]:
    """What was computed, and what it says."""
    pitch = reach.pure[1]
    return [
        f"Forward kinematics with the fine legs at nominal length at {len(reach.surface.condition)} points of the "
        "surface of the joint space, 2 mm apart, as in section 4.1.",
        f"That the limits exceed {SAID:g} deg does not mean that any orientation within {SAID:g} deg can be reached: "
        f"Table 1 holds the extremes of each angle wherever they occur. Pitch alone goes from {pitch[0]:.2f} to "
        f"{pitch[1]:.2f} deg, and the largest cube of roll, pitch and yaw is +-{rounded_down(reach.cube)} deg.",
        f"The boresight can be tilted by {rounded_down(reach.cone)} deg in any direction without twist, and by "
        f"{rounded_down(reach.cone_with_free_twist)} deg if the platform may turn about the boresight as suits it: "
        f"{SAID:g} deg in every direction holds for the boresight, not for the orientation.",
    ]


def rounded_down(angle: float) -> str:
    """An angle in deg with two digits, such that what is said to be within reach is."""
    return f"{math.floor(100.0 * angle) / 100.0:.2f}"


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
