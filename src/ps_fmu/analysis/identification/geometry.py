"""The joints, from Table 1.

The mechanism is taken to have three-fold symmetry about z: legs 2 and 3 of a kind are leg 1 turned by 120 and 240 deg.
Ten numbers then describe the joints, against six of Table 1.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...manipulator import workspace
from ...manipulator.forward import ForwardKinematicsError, forward_kinematics
from ...manipulator.inverse import inverse_kinematics
from ...manipulator.kinematics import division_of_labour
from ...manipulator.parameters import Array, Geometry
from ...manipulator.reach import reachable
from .fit import Identifiability, Range, roundings, slopes, targets

KEYS = tuple(f"table1.{angle}_{end}" for angle in ("roll", "pitch", "yaw") for end in ("min", "max"))

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

SEARCH_STEP = 20e-3  # m: corners, and middles of edges and faces, good to 3e-4 deg
FAR = 50.0  # deg: error of a geometry that cannot take up all poses of its stroke
NEAR = 1e-4  # deg: the search has found a geometry
LARGEST_CONDITION = 10.0  # of the Jacobian over the workspace
LEAST_CLEARANCE = 0.02  # m, between the axes of legs: room for bodies of 20 mm
ORIENTATIONS = ((0.0, 0.0, 0.0), (8.5, 0.0, 0.0), (0.0, -7.0, 0.0), (0.0, 0.0, 14.0))  # deg, of Table 2


@dataclass(frozen=True, eq=False)
class Candidate:
    """A geometry that meets Table 1 within :data:`NEAR`."""

    places: Array
    """(10,), of its parameters in :data:`RANGES`."""
    stroke: Array
    """(2,), m."""
    condition: float
    """Largest condition number of the Jacobian over the surface of the workspace."""

    @property
    def geometry(self) -> Geometry:
        """The joints."""
        return symmetric(self.places, self.stroke)

    @property
    def values(self) -> list[float]:
        """Its parameters in their units."""
        return [r.at(u) for r, u in zip(RANGES, self.places, strict=True)]


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


def limits(geometry: Geometry, step: float = workspace.STEP) -> Array:
    """Table 1 of a geometry in the order of :data:`KEYS`, (6,), deg; the surface in steps of ``step``, m.

    Raises
    ------
    ForwardKinematicsError: no pose at some point of the surface.
    """
    displacement = workspace.surface(geometry, step)
    lengths = geometry.nominal_lengths + np.pad(displacement, ((0, 0), (0, 3)))
    orientation = forward_kinematics(geometry, lengths).orientation
    return np.degrees(np.column_stack([orientation.min(axis=0), orientation.max(axis=0)])).reshape(-1)


def search(start: Array, stroke: Array, evaluations: int = 100) -> Candidate | None:
    """Follow Table 1 from a starting place (10,) on a coarse surface; None if that leads nowhere usable."""
    places, error = _least_squares(start, stroke, SEARCH_STEP, evaluations)
    if error > NEAR:
        return None
    geometry = symmetric(places, stroke)
    surface = workspace.sample(geometry, workspace.surface(geometry, SEARCH_STEP))
    candidate = Candidate(places, stroke, float(surface.condition.max()))
    return candidate if not why_unusable(candidate) else None


def refine(candidate: Candidate, evaluations: int = 10) -> Candidate:
    """The same on the surface of the paper, in steps of 2 mm."""
    places, _ = _least_squares(candidate.places, candidate.stroke, workspace.STEP, evaluations)
    return Candidate(places, candidate.stroke, candidate.condition)


def starts(seed: int, stroke: Array, count: int) -> list[Array]:
    """Starting places, drawn uniformly from the ranges until ``count`` of them can use their whole stroke."""
    random = np.random.default_rng(seed)
    found: list[Array] = []
    while len(found) < count:
        places = random.uniform(0.05, 0.95, len(RANGES))
        if _reaches_all(places, stroke):
            found.append(places)
    return found


def why_unusable(candidate: Candidate) -> list[str]:
    """What rules a geometry out although it meets Table 1; empty if nothing does."""
    geometry = candidate.geometry
    reasons = list(division_of_labour(geometry, geometry.nominal_translation_B, np.eye(3)).reasons)
    if candidate.condition > LARGEST_CONDITION:
        reasons.append(f"condition number {candidate.condition:.1f} in the workspace, at most {LARGEST_CONDITION:g}")
    if (gap := clearance(geometry)) < LEAST_CLEARANCE:
        reasons.append(f"two legs {1e3 * gap:.1f} mm apart, at least {1e3 * LEAST_CLEARANCE:g} mm")
    if not np.all(reachable(geometry, inverse_kinematics(geometry, np.radians(ORIENTATIONS)))):
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


def identifiability(candidate: Candidate) -> Identifiability:
    """What Table 1 fixes of the parameters in :data:`RANGES`."""
    jacobian = slopes(lambda u: limits(symmetric(u, candidate.stroke), SEARCH_STEP), candidate.places)
    return Identifiability(jacobian / roundings(KEYS)[:, None])


def _least_squares(start: Array, stroke: Array, step: float, evaluations: int) -> tuple[Array, float]:
    """Places (10,) that come nearest to Table 1 from a start, and the largest error that is left, deg."""
    from scipy.optimize import least_squares

    wanted = targets(KEYS)

    def error(places: Array) -> Array:
        try:
            return limits(symmetric(places, stroke), step) - wanted
        except ForwardKinematicsError:
            return np.full(wanted.size, FAR)

    found = least_squares(error, start, bounds=(0.0, 1.0), max_nfev=evaluations, xtol=1e-10, ftol=1e-10, gtol=1e-10)
    return np.asarray(found.x), float(np.abs(found.fun).max())


def _reaches_all(places: Array, stroke: Array) -> bool:
    try:
        limits(symmetric(places, stroke), SEARCH_STEP)
    except ForwardKinematicsError:
        return False
    return True


def _ring(radius: float, azimuth: float, height: float = 0.0) -> Array:
    """Three joints on a circle about z, (3, 3), m; azimuth of the first in deg."""
    angle = np.radians(azimuth + np.array([0.0, 120.0, 240.0]))
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), np.full(3, height)])
