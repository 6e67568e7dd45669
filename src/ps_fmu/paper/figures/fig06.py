"""The orientations within reach: Table 1 and Fig 6."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from itertools import combinations
from typing import TYPE_CHECKING, Any

import numpy as np

from ...analyses.result import AnalysisResult, Finding, paint_pictures
from ...analyses.table import AnalysisOptions
from ...mechanism.inverse_kinematics import pure_limits
from ...mechanism.parameters import Array, load
from ...results.style import ACTIVE, PASSIVE, REFERENCE
from ...results.tables import Table
from .. import workspace
from ..published import ANGLES, make_finding

if TYPE_CHECKING:
    from matplotlib.figure import Figure

CLAIMED_LIMIT = 8.5  # deg, exceeded in every direction by section 4.1


@dataclass(frozen=True, eq=False)
class Reach:
    """How far the platform turns: angles in deg."""

    surface: workspace.Sample
    limits: Array  # (3, 2), smallest and largest roll, pitch, yaw over the workspace
    pure: Array  # (3, 2), the same with the other two angles at zero
    cube: float  # half the edge of the largest cube of roll, pitch and yaw
    azimuth: Array  # (n,), direction in which the boresight tilts, from x towards y of B
    tilt: Array  # (n,), largest tilt in that direction without twist
    cone: float  # half-angle of the largest cone of boresights without twist
    rim_azimuth: Array
    """(m,), the same along the closed rim of all boresights, each with the twist that lets it tilt farthest."""
    rim_tilt: Array  # (m,), tilt of these boresights

    @property
    def cone_with_free_twist(self) -> float:
        """Half-angle of the largest cone of boresights if the platform may turn about its boresight."""
        return float(self.rim_tilt.min())


@cache
def compute_reach() -> Reach:
    """The workspace of the identified geometry.  Cached: the errata ask for it too."""
    geometry = load().manipulator.geometry
    surface = workspace.sample(geometry, workspace.surface(geometry))
    azimuth = np.radians(np.arange(360.0))
    rim_azimuth, rim_tilt = workspace.rim(geometry)
    return Reach(
        surface=surface,
        limits=np.degrees(workspace.limits(surface)),
        pure=np.degrees(pure_limits(geometry)),
        cube=float(np.degrees(workspace.largest_cube(geometry))),
        azimuth=np.degrees(azimuth),
        tilt=np.degrees(workspace.cone(geometry, azimuth)),
        cone=float(np.degrees(workspace.smallest_tilt(geometry, azimuth))),
        rim_azimuth=np.degrees(rim_azimuth),
        rim_tilt=np.degrees(rim_tilt),
    )


def round_down(angle: float) -> str:
    """An angle in deg with two digits, rounded down: a larger one would not be within reach."""
    return f"{math.floor(100.0 * angle) / 100.0:.2f}"


def analyse(options: AnalysisOptions) -> AnalysisResult:
    """Compute the workspace and draw it."""
    reach = compute_reach()
    return AnalysisResult(
        name="workspace",
        title="Workspace: Table 1 and Fig 6",
        text=paragraphs(reach),
        findings=findings(reach),
        tables=tables(reach),
        pictures=paint_pictures(
            options.output,
            "workspace",
            (
                "", "The surface of the workspace, coloured by the condition number of the Jacobian.",
                (11.0, 13.0), paint_envelope, reach,
            ),
            (
                "cone", "How far the boresight can be tilted in each direction, with and without a twist about it.",
                (8.0, 8.6), paint_cone, reach,
            ),
        ),
        data={
            "limits_deg": dict(zip(ANGLES, reach.limits, strict=True)),
            "limits_of_one_angle_alone_deg": dict(zip(ANGLES, reach.pure, strict=True)),
            "largest_cube_deg": reach.cube,
            "cone_deg": reach.cone,
            "cone_with_free_twist_deg": reach.cone_with_free_twist,
            "condition_number": [float(reach.surface.condition.min()), float(reach.surface.condition.max())],
        },
    )  # fmt: skip


def findings(reach: Reach) -> list[Finding]:
    """Table 1, and the claims that are drawn from it."""
    limits = [
        make_finding(f"table1.{angle}_{end}", computed=float(reach.limits[i, column]))
        for i, angle in enumerate(ANGLES)
        for column, end in ((1, "max"), (0, "min"))
    ]
    least = float(np.abs(reach.limits).min())
    alone = float(np.abs(reach.pure).min())
    remark = f"each in some pose; alone, with the other two at zero, only {alone:.2f} deg"
    return [
        *limits,
        make_finding("text.cone", computed=least, remark=remark),
        make_finding(
            "text.any_orientation", reach.cube, remark="largest cube of roll, pitch and yaw that is within reach"
        ),
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
    """The range of each angle, and the conditioning of the Jacobian."""
    ranges = [
        (angle, *(f"{value:+.3f}" for value in (*reach.limits[i], *reach.pure[i]))) for i, angle in enumerate(ANGLES)
    ]
    values, condition = reach.surface.singular_values, reach.surface.condition
    sizes = [(f"singular value {i + 1}", f"{values[:, i].min():.4f}", f"{values[:, i].max():.4f}") for i in range(6)]
    sizes.append(("condition number", f"{condition.min():.3f}", f"{condition.max():.3f}"))
    return [
        Table(
            "Range of each angle: over the workspace, and with the other two at zero",
            ("angle (deg)", "smallest", "largest", "smallest alone", "largest alone"),
            ranges,
        ),
        Table(
            "Jacobian J_lp (6) over the surface, rotations as arc at the platform joints",
            ("", "smallest", "largest"),
            sizes,
        ),
    ]


def paint_envelope(figure: Figure, reach: Reach) -> None:
    """The surface in three dimensions, and its three projections with the largest cube."""
    from matplotlib import colormaps
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    angles = np.degrees(reach.surface.orientation)
    condition = reach.surface.condition
    scale = Normalize(condition.min(), condition.max())
    colours = ScalarMappable(scale, colormaps["viridis"])
    parts: Any = figure.subfigures(2, 1, height_ratios=(1.9, 1.0))
    upper, lower = parts
    space = upper.add_subplot(projection="3d")
    for face in _faces(reach.surface.coarse_displacement):
        space.plot_surface(
            *np.moveaxis(angles[face], -1, 0), facecolors=colours.to_rgba(condition[face]),
            rstride=1, cstride=1, shade=False, linewidth=0.2, edgecolor="#00000040",
        )  # fmt: skip
    space.set(xlabel="roll (deg)", ylabel="pitch (deg)", zlabel="yaw (deg)")
    space.xaxis.labelpad = space.yaxis.labelpad = 12.0
    space.view_init(elev=22.0, azim=-52.0)
    space.set_box_aspect((1.0, 1.0, 1.0), zoom=0.95)
    upper.colorbar(colours, ax=space, label="condition number of the Jacobian", shrink=0.7, pad=0.08)
    a = reach.cube
    for axes, (i, j) in zip(lower.subplots(1, 3), combinations(range(3), 2), strict=True):
        axes.scatter(angles[:, i], angles[:, j], color=REFERENCE, s=1.5, label="surface")
        axes.plot([-a, a, a, -a, -a], [-a, -a, a, a, -a], color=PASSIVE, label=f"largest cube, ±{a:.1f} deg")
        axes.set(xlabel=f"{ANGLES[i]} (deg)", ylabel=f"{ANGLES[j]} (deg)", aspect="equal")
    lower.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=2, markerscale=4.0)
    figure.suptitle("Workspace with the fine legs at nominal length")


def _faces(displacement: np.ndarray) -> Iterator[np.ndarray]:
    """Places of the points of each face of the joint space, (n, n), neighbours side by side."""
    for axis in range(3):
        for end in (displacement.min(), displacement.max()):
            places = np.flatnonzero(displacement[:, axis] == end)
            n = round(places.size**0.5)
            yield places.reshape(n, n)


def paint_cone(figure: Figure, reach: Reach) -> None:
    """How far the boresight can be tilted, seen along z of B: direction and distance are those of the tilt."""
    all_round = np.linspace(0.0, 360.0, 361)
    cones = ((reach.cone, PASSIVE), (CLAIMED_LIMIT, REFERENCE), (reach.cone_with_free_twist, ACTIVE))
    labels = (
        f"any direction, no twist: {round_down(reach.cone)} deg",
        f"{CLAIMED_LIMIT:g} deg of the paper",
        f"any direction, best twist: {round_down(reach.cone_with_free_twist)} deg",
    )
    axes = figure.add_subplot()
    axes.plot(*_close_curve(reach.rim_azimuth, reach.rim_tilt), color=ACTIVE, linewidth=2.4, label="best twist")
    axes.plot(*_close_curve(reach.azimuth, reach.tilt), color=PASSIVE, linewidth=2.4, label="no twist")
    for (tilt, colour), label in zip(cones, labels, strict=True):
        circle = _close_curve(all_round, np.full_like(all_round, tilt))
        axes.plot(*circle, color=colour, linestyle="--", linewidth=1.2, label=label)
    axes.set(xlabel="tilt towards x of B (deg)", ylabel="tilt towards y of B (deg)", aspect="equal")
    axes.set_title("Largest tilt of the boresight, by direction")
    figure.legend(loc="outside lower center", ncols=2)


def _close_curve(azimuth: np.ndarray, tilt: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points (x, y), deg, of the closed curve of tilts, deg, in the directions of azimuths, deg."""
    around, out = np.radians(np.append(azimuth, azimuth[0])), np.append(tilt, tilt[0])
    return out * np.cos(around), out * np.sin(around)
