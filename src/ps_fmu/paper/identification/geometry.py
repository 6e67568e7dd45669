"""The joints, from Table 1: six numbers for the ten parameters of a mechanism, and what makes one unusable.

The mechanism is taken to have three-fold symmetry about z: legs 2 and 3 of a kind are leg 1 turned by 120 and 240 deg.
Ten numbers then describe the joints.  A number of Table 1 is the angle at one point of the joint space, where it is
largest or smallest.  Its derivative is that of the angle at this point, which the legs' closure gives exactly.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from ...mechanism.inverse_kinematics import inverse_kinematics, reachable
from ...mechanism.kinematics import (
    ForwardKinematicsError,
    KinematicsError,
    forward_kinematics,
    leg_rows,
    leg_vectors,
    list_singularities,
    platform_joints_B,
)
from ...mechanism.parameters import Array, Geometry
from ...mechanism.rotations import GimbalLockError, orientation_rate_map
from .. import workspace
from ..figures.table2.runs import ORIENTATIONS
from ..published import ANGLES
from .fit import Identifiability, Range, follow, roundings, slopes, targets, values_at

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
    height, base_c, azimuth_c, platform_c, twist_c, base_f, azimuth_f, height_f, platform_f, twist_f = values_at(
        RANGES, places
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
    reasons = list_singularities(geometry, geometry.nominal_translation_B, np.eye(3))
    if condition > LARGEST_CONDITION:
        reasons.append(f"condition number {condition:.1f} in the workspace, at most {LARGEST_CONDITION:g}")
    if (gap := clearance(geometry)) < LEAST_CLEARANCE:
        reasons.append(f"two legs {1e3 * gap:.1f} mm apart, at least {1e3 * LEAST_CLEARANCE:g} mm")
    orientations = np.radians(list(ORIENTATIONS.values()))
    if not np.all(reachable(geometry, inverse_kinematics(geometry, orientations))):
        reasons.append("an orientation of Table 2 is out of reach")
    return reasons


def clearance(geometry: Geometry) -> float:
    """Smallest distance of the axes of any two legs at the nominal pose, m, between 41 points on each.

    Too large by at most 0.1 mm for legs of 0.4 m that are 20 mm apart.
    """
    tops_B = geometry.nominal_translation_B + geometry.platform_joints_P
    along = np.linspace(0.0, 1.0, 41)[:, None]
    legs = [base + along * (top - base) for base, top in zip(geometry.base_joints_B, tops_B, strict=True)]
    pairs = ((a, b) for i, a in enumerate(legs) for b in legs[:i])
    return float(min(np.linalg.norm(a[:, None] - b, axis=-1).min() for a, b in pairs))


def _ring(radius: float, azimuth: float, height: float = 0.0) -> Array:
    """Three joints on a circle about z, (3, 3), m; azimuth of the first in deg."""
    angle = np.radians(azimuth + np.array([0.0, 120.0, 240.0]))
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), np.full(3, height)])


KEYS = tuple(f"table1.{angle}_{end}" for angle in ANGLES for end in ("min", "max"))

SEARCH_STEP = 20e-3  # m: corners, and middles of edges and faces, good to 3e-4 deg
NEAR = 0.01  # deg, of the search on that coarse surface: worth following on the surface of the paper


@dataclass(frozen=True, eq=False)
class Candidate:
    """A usable geometry that meets Table 1 in every printed digit."""

    places: Array
    """(10,), of its parameters in :data:`RANGES`."""
    stroke: Array  # (2,), m
    condition: float  # largest condition number of the Jacobian over the surface of the workspace

    @property
    def geometry(self) -> Geometry:
        """The joints."""
        return symmetric(self.places, self.stroke)

    @property
    def values(self) -> list[float]:
        """Its parameters in their units."""
        return values_at(RANGES, self.places)


def limits(geometry: Geometry, step: float = workspace.STEP) -> Array:
    """Table 1 of a geometry in the order of :data:`KEYS`, (6,), deg; the surface in steps of ``step``, m.

    Raises
    ------
    ForwardKinematicsError: no pose at some point of the surface.
    """
    return np.degrees(_extremes(geometry, step).angle)


def limits_and_slopes(places: Array, stroke: Array, step: float = workspace.STEP) -> tuple[Array, Array]:
    """Table 1 for places (10,) in the ranges, (6,), deg, and its Jacobian, (6, 10), deg; see :func:`limits`.

    With lengths held, closure of a leg from base joint b to platform joint p, ``|t + R p - b| - |t_0 + p - b|``, says
    how the pose (t, theta) follows the joints: ``n.(dt + dtheta x R p) = n_0.(dt_0 + dp - db) - n.(R dp - db)``.
    """
    geometry = symmetric(places, stroke)
    at = _extremes(geometry, step)
    change = slopes(lambda u: _coordinates(symmetric(u, stroke)), places)
    dt_0, db, dp = change[0], change[1:7], change[7:]  # (3, 10), (6, 3, 10) and (6, 3, 10)
    n = _directions(geometry, at.translation_B, at.R)
    n_0 = _directions(geometry, geometry.nominal_translation_B, np.eye(3))
    turned_dp = np.einsum("kab,ibu->kiau", at.R, dp)
    nominal = np.einsum("ia,iau->iu", n_0, dt_0 + dp - db)
    dq = np.linalg.solve(
        leg_rows(platform_joints_B(geometry, at.R), n), nominal - np.einsum("kia,kiau->kiu", n, turned_dp - db)
    )
    rates = orientation_rate_map(at.orientation) @ dq[:, 3:]
    return np.degrees(at.angle), np.degrees(rates[np.arange(len(KEYS)), at.axis])


def search(start: Array, stroke: Array) -> Candidate | None:
    """Follow Table 1 from a starting place (10,); None if that leads nowhere usable."""
    try:
        places = _follow_table_1(start, stroke, SEARCH_STEP)
        if _table_1_errors(places, stroke, SEARCH_STEP).max() > NEAR:
            return None
        places = _follow_table_1(places, stroke, workspace.STEP)
        if np.any(_table_1_errors(places, stroke, workspace.STEP) > roundings(KEYS)):
            return None
    except (KinematicsError, GimbalLockError, np.linalg.LinAlgError):
        return None
    candidate = Candidate(places, stroke, largest_condition(symmetric(places, stroke)))
    return None if list_flaws(candidate.geometry, candidate.condition) else candidate


def starts(seed: int, stroke: Array) -> Iterator[Array]:
    """Starting places (10,), drawn uniformly from the ranges, as many as wanted; all can use their whole stroke."""
    random = np.random.default_rng(seed)
    while True:
        places = random.uniform(0.05, 0.95, len(RANGES))
        try:
            limits(symmetric(places, stroke), SEARCH_STEP)
        except ForwardKinematicsError:
            continue
        yield places


def identifiability(candidate: Candidate) -> Identifiability:
    """What Table 1 fixes of the parameters in :data:`RANGES`."""
    _, slope = limits_and_slopes(candidate.places, candidate.stroke)
    return Identifiability(slope / roundings(KEYS)[:, None])


def _follow_table_1(start: Array, stroke: Array, step: float) -> Array:
    """Places (10,) that come near to Table 1 from a start, on the surface in steps of ``step``, m."""

    def error(places: Array) -> tuple[Array, Array]:
        found, slope = limits_and_slopes(places, stroke, step)
        return found - targets(KEYS), slope

    return follow(error, start)


def _table_1_errors(places: Array, stroke: Array, step: float) -> Array:
    """How far Table 1 is missed, (6,), deg."""
    return np.abs(limits(symmetric(places, stroke), step) - targets(KEYS))


@dataclass(frozen=True, eq=False)
class _Extremes:
    """The poses at which the six numbers of Table 1 are reached."""

    translation_B: Array  # (6, 3), m
    R: Array  # (6, 3, 3)
    orientation: Array  # (6, 3), rad
    axis: ClassVar[NDArray[np.intp]] = np.repeat([0, 1, 2], 2)

    @property
    def angle(self) -> Array:
        """(6,), rad."""
        return np.asarray(self.orientation[np.arange(len(self.axis)), self.axis])


def _extremes(geometry: Geometry, step: float) -> _Extremes:
    displacement = workspace.surface(geometry, step)
    pose = forward_kinematics(geometry, geometry.nominal_lengths + np.pad(displacement, ((0, 0), (0, 3))))
    orientation = pose.orientation
    at = np.column_stack([orientation.argmin(axis=0), orientation.argmax(axis=0)]).reshape(-1)
    return _Extremes(pose.translation_B[at], pose.R[at], orientation[at])


def _directions(geometry: Geometry, translation_B: Array, R: Array) -> Array:
    """Unit vectors along the legs, (..., 6, 3), in B."""
    legs_B = leg_vectors(geometry, translation_B, R)
    return np.asarray(legs_B / np.linalg.norm(legs_B, axis=-1, keepdims=True))


def _coordinates(geometry: Geometry) -> Array:
    """Nominal translation, base joints and platform joints, (13, 3), m."""
    return np.vstack([geometry.nominal_translation_B, geometry.base_joints_B, geometry.platform_joints_P])
