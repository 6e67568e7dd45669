"""Which poses the manipulator can take up: spheres that meet, coarse stroke, distance from singularity."""

from __future__ import annotations

import numpy as np

from .geometry import Geometry
from .inverse_kinematics import BoolArray, InversePose
from .kinematics import LARGEST_CONDITION, condition_number, platform_jacobian
from .quantities import Array
from .rotations import rotation_matrix

# A pose computed to lie on the limit of the stroke still counts as within: rounding of a length is far
# smaller.
STROKE_TOLERANCE = 1e-12  # m


def stroke_margin(geometry: Geometry, coarse_displacement: Array) -> Array:
    """Distance of each coarse leg from the nearer end of its stroke, negative beyond it; (..., 3), m."""
    low, high = geometry.coarse_stroke
    return np.minimum(coarse_displacement - low, high - coarse_displacement)


def within_stroke(geometry: Geometry, coarse_displacement: Array) -> BoolArray:
    """Whether all three coarse legs are within their stroke; (..., 3), m, to (...), bool.  False for nan."""
    return np.asarray(np.all(stroke_margin(geometry, coarse_displacement) >= -STROKE_TOLERANCE, axis=-1))


def reachable(geometry: Geometry, pose: InversePose) -> BoolArray:
    """Whether a pose exists with d_f = 0, within the stroke and nonsingular; (...), bool."""
    nonsingular = _conditions(geometry, pose) <= LARGEST_CONDITION
    return np.asarray(pose.solved & within_stroke(geometry, pose.coarse_displacement) & nonsingular)


def why_unreachable(geometry: Geometry, pose: InversePose) -> str | None:
    """The first unreachable pose of a batch in words: which leg or sphere fails, by how much and where.

    Returns
    -------
    None when every pose is reachable.
    """
    ok = np.atleast_1d(reachable(geometry, pose))
    if np.all(ok):
        return None
    i = int(np.argmin(ok.reshape(-1)))
    roll, pitch, yaw = np.degrees(pose.orientation.reshape(-1, 3)[i])
    return f"{_reason(geometry, pose, i)} at roll {roll:.4f}, pitch {pitch:.4f}, yaw {yaw:.4f} deg"


def _reason(geometry: Geometry, pose: InversePose, i: int) -> str:
    if not pose.solved.reshape(-1)[i]:
        gaps = pose.gaps.reshape(-1, 3)[i]
        if np.isinf(gaps).any():
            return "the centres of the three spheres of the fine legs lie on a line"
        leg = int(np.argmax(gaps))
        return (
            "the three spheres of the fine legs have no common point: "
            f"fine leg {leg + 1} is {1e3 * gaps[leg]:.4g} mm too short"
        )
    margins = stroke_margin(geometry, pose.coarse_displacement).reshape(-1, 3)[i]
    leg = int(np.argmin(margins))
    if margins[leg] < -STROKE_TOLERANCE:
        low, high = 1e3 * geometry.coarse_stroke
        d = 1e3 * pose.coarse_displacement.reshape(-1, 3)[i, leg]
        return (
            f"coarse leg {leg + 1} would need {d:+.4f} mm, {-1e3 * margins[leg]:.4g} mm beyond its stroke of "
            f"{low:+g} to {high:+g} mm,"
        )
    return f"the six legs are singular (condition number {_conditions(geometry, pose).reshape(-1)[i]:.2e})"


def _conditions(geometry: Geometry, pose: InversePose) -> Array:
    """Condition number of J_lp, nan where there is no pose."""
    solved = np.atleast_1d(pose.solved)
    result = np.full(solved.shape, np.nan)
    t, R = np.atleast_2d(pose.translation_B)[solved], rotation_matrix(np.atleast_2d(pose.orientation))[solved]
    result[solved] = condition_number(geometry, platform_jacobian(geometry, t, R))
    return result.reshape(pose.solved.shape)
