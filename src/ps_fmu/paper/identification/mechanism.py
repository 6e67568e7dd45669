"""The mechanism whose joints are sought, and what makes one unusable.

It is taken to have three-fold symmetry about z: legs 2 and 3 of a kind are leg 1 turned by 120 and 240 deg.  Ten
numbers then describe the joints, against six of Table 1.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...mechanism import workspace
from ...mechanism.inverse_kinematics import inverse_kinematics
from ...mechanism.kinematics import division_of_labour
from ...mechanism.parameters import Array, Geometry
from ...mechanism.reachability import reachable
from ..figures.table2.closed_form import ORIENTATIONS
from .fit import Range

RANGES = (
    Range("height of P above B", "m", 0.25, 0.50),
    Range("radius of the coarse joints on the base", "m", 0.15, 0.30),
    Range("azimuth of coarse leg 1 on the base", "deg", -90.0, 90.0),
    Range("radius of the coarse joints on the platform", "m", 0.08, 0.20),
    Range("twist of the coarse legs", "deg", -60.0, 60.0),
    Range("radius of the fine joints on the base", "m", 0.20, 0.35),
    Range("azimuth of fine leg 1 from coarse leg 1", "deg", -120.0, 120.0),
    Range("height of the fine joints on the base", "m", -0.05, 0.05),
    Range("radius of the fine joints on the platform", "m", 0.08, 0.20),
    Range("twist of the fine legs", "deg", -60.0, 60.0),
)

LARGEST_CONDITION = 10.0  # of the Jacobian over the workspace
LEAST_CLEARANCE = 0.02  # m, between the axes of legs: room for bodies of 20 mm


def symmetric(places: Sequence[float] | Array, stroke: Array) -> Geometry:
    """Joints for the places (10,) of the parameters in :data:`RANGES`; stroke (2,), m."""
    (height, base_c, azimuth_c, platform_c, twist_c, base_f, azimuth_f, height_f, platform_f, twist_f) = (
        r.at(u) for r, u in zip(RANGES, places, strict=True)
    )
    azimuth_f += azimuth_c
    return Geometry(
        base_joints_B=np.vstack([_ring(base_c, azimuth_c), _ring(base_f, azimuth_f, height_f)]),
        platform_joints_P=np.vstack([_ring(platform_c, azimuth_c + twist_c), _ring(platform_f, azimuth_f + twist_f)]),
        nominal_translation_B=np.array([0.0, 0.0, height]),
        coarse_stroke=stroke,
    )


def largest_condition(geometry: Geometry) -> float:
    """Largest condition number of the Jacobian over the surface of the workspace."""
    return float(workspace.sample(geometry, workspace.surface(geometry)).condition.max())


def list_flaws(geometry: Geometry, condition: float) -> list[str]:
    """What rules a geometry out although it meets Table 1; empty if nothing does.

    Parameters
    ----------
    condition: see :func:`largest_condition`.
    """
    reasons = list(division_of_labour(geometry, geometry.nominal_translation_B, np.eye(3)).reasons)
    if condition > LARGEST_CONDITION:
        reasons.append(f"condition number {condition:.1f} in the workspace, at most {LARGEST_CONDITION:g}")
    if (gap := clearance(geometry)) < LEAST_CLEARANCE:
        reasons.append(f"two legs {1e3 * gap:.1f} mm apart, at least {1e3 * LEAST_CLEARANCE:g} mm")
    orientations = np.radians(list(ORIENTATIONS.values()))
    if not np.all(reachable(geometry, inverse_kinematics(geometry, orientations))):
        reasons.append("an orientation of Table 2 is out of reach")
    return reasons


def clearance(geometry: Geometry, points: int = 41) -> float:
    """Smallest distance of the axes of any two legs at the nominal pose, m, between ``points`` points on each.

    Too large by at most 0.1 mm for legs of 0.4 m that are 20 mm apart.
    """
    tops_B = geometry.nominal_translation_B + geometry.platform_joints_P
    along = np.linspace(0.0, 1.0, points)[:, None]
    legs = [base + along * (top - base) for base, top in zip(geometry.base_joints_B, tops_B, strict=True)]
    pairs = ((a, b) for i, a in enumerate(legs) for b in legs[:i])
    return float(min(np.linalg.norm(a[:, None] - b, axis=-1).min() for a, b in pairs))


def _ring(radius: float, azimuth: float, height: float = 0.0) -> Array:
    """Three joints on a circle about z, (3, 3), m; azimuth of the first in deg."""
    angle = np.radians(azimuth + np.array([0.0, 120.0, 240.0]))
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), np.full(3, height)])
