"""The orientations within reach: Table 1 and Fig 6."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache

import numpy as np

from ....mechanism import workspace
from ....mechanism.parameters import Array, load

CLAIMED_LIMIT = 8.5  # deg, exceeded in every direction by section 4.1


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
    """(n,), direction in which the boresight tilts, from x towards y of B."""
    tilt: Array
    """(n,), largest tilt in that direction without twist."""
    cone: float
    """Half-angle of the largest cone of boresights without twist."""
    rim_azimuth: Array
    """(m,), the same along the closed rim of all boresights, each with the twist that lets it tilt farthest."""
    rim_tilt: Array
    """(m,), tilt of these boresights."""

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
        pure=np.degrees(workspace.pure_limits(geometry)),
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
