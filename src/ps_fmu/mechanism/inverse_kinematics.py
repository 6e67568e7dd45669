"""Inverse kinematics with the fine actuators at rest, section 2.3: orientation to coarse displacement, and its limits.

The orientation alone is commanded.  The constraint ``d_f = 0`` (17) fixes the translation: it lies on three
spheres, ``|t - c_i| = l_f0i`` with centres ``c_i = r_bfi - R r_pfi``.  Two methods find it, each a function
of the geometry and of rotation matrices: :func:`trilaterate`, closed form and exact to rounding, and
:func:`descend`, the paper's Algorithm 1.  :func:`inverse_kinematics` takes either and adds the
displacements of eq (16).  A pose is reachable if the spheres meet, within the coarse stroke, away from singularity.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from .kinematics import (
    LARGEST_CONDITION,
    Geometry,
    KinematicsError,
    NotConvergedError,
    condition_number,
    displacements,
    platform_jacobian,
    platform_joints_B,
)
from .quantities import Array
from .rotations import cross, dot, rotation_matrix

BoolArray = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Translation:
    """Translation of the platform that keeps the fine legs at their nominal length."""

    translation_B: Array
    """(..., 3), m; nan where ``solved`` is false."""
    solved: BoolArray
    """(...), bool: whether the three spheres have a common point."""
    gaps: Array
    """(..., 3), m: what each fine leg lacks to reach the point in the plane of the sphere centres that has
    the same power with respect to all three; zero where solved, inf where the centres lie on a line."""
    iterations: int = 0
    """Iterations of Algorithm 1 for the slowest orientation; 0 for the closed form."""


Solver = Callable[[Geometry, Array], Translation]


@dataclass(frozen=True, eq=False)
class InversePose:
    """Pose and displacements for commanded orientations with the fine actuators at rest."""

    orientation: Array
    """(..., 3), roll, pitch and yaw, rad."""
    translation_B: Array
    """(..., 3), m; nan where not solved."""
    coarse_displacement: Array
    """(..., 3), m, from nominal; nan where not solved."""
    fine_displacement: Array
    """(..., 3), m: what the method left of d_f = 0; nan where not solved."""
    solved: BoolArray
    """(...), bool: whether a pose with d_f = 0 exists."""
    gaps: Array
    """(..., 3), m: see :class:`Translation`."""
    iterations: int

    @property
    def residual(self) -> Array:
        """(...), m: the largest ``|l_f - l_f0|``."""
        return np.asarray(np.max(np.abs(self.fine_displacement), axis=-1))


def trilaterate(geometry: Geometry, R: Array) -> Translation:
    """Closed-form solution of ``d_f = 0``: the common point of three spheres, on the nominal side.

    With ``u = c_2 - c_1``, ``v = c_3 - c_1``, ``w = u x v`` and ``x = t - c_1``, subtracting sphere 1 from
    the others gives ``x.u = (u^2 + r_1^2 - r_2^2)/2`` and likewise for v; sphere 1 gives the component of x
    along w up to its sign.  The two roots are mirror images in the plane of the centres.  The platform
    cannot pass from one to the other without d_f = 0 becoming singular, so that the root with the sign of
    the nominal pose is the right one.

    Parameters
    ----------
    R: (..., 3, 3), P to B.

    Returns
    -------
    Translation: orientations without a real solution are marked, never raised.
    """
    c1, u, v, w = _sphere_triangle(geometry, R)
    r1, r2, r3 = geometry.nominal_lengths[3:]
    a = 0.5 * (dot(u, u) + (r1 - r2) * (r1 + r2))[..., None]
    b = 0.5 * (dot(v, v) + (r1 - r3) * (r1 + r3))[..., None]
    ww = dot(w, w)[..., None]
    # The height of the triangle against its longest side: below rounding, the centres lie on a line.
    collinear = ww[..., 0] <= 1e-24 * np.maximum(dot(u, u), dot(v, v)) ** 2
    with np.errstate(divide="ignore", invalid="ignore"):
        in_plane = (a * cross(v, w) + b * cross(w, u)) / ww  # radical centre, from c1
        height_squared = r1**2 - dot(in_plane, in_plane)
        solved = ~collinear & (height_squared >= 0.0)
        height = np.where(solved, np.sqrt(height_squared), np.nan)[..., None]
        x = in_plane + _nominal_side(geometry) * height * w / np.sqrt(ww)
    gaps = np.zeros(x.shape)
    if not np.all(solved):
        centres = np.stack([np.zeros_like(u), u, v], axis=-2)
        short = np.linalg.norm(in_plane[..., None, :] - centres, axis=-1) - geometry.nominal_lengths[3:]
        gaps = np.where(solved[..., None], 0.0, np.where(collinear[..., None], np.inf, short))
    return Translation(translation_B=c1 + x, solved=solved, gaps=gaps)


def descend(
    geometry: Geometry,
    R: Array,
    mu: float = 0.73,
    epsilon: float = 1e-6,
    max_iterations: int = 500,
    start_B: Array | None = None,
) -> Translation:
    """Algorithm 1 of the paper: gradient descent on the length errors of the fine legs.

    ``t <- t + mu J e`` with ``J = [n_f1 n_f2 n_f3]`` and ``e = l_f0 - l_f``, until ``|e| < epsilon``.  It
    converges only for ``mu < 2/lambda_max(J J^T)``, 0.79 to 0.84 in the workspace of the identified
    geometry.  Each orientation of a batch stops on its own, so that its result does not depend on the
    others.

    Parameters
    ----------
    R: (..., 3, 3), P to B.
    mu: step size.
    epsilon: m, limit of the Euclidean norm of the three length errors.  1e-6 m leaves up to 4e-4 deg when
        the coarse lengths are realised exactly; 1e-8 deg needs about 1e-11 m.
    max_iterations: give up after so many.
    start_B: (..., 3), m, first guess; default: the nominal translation.

    Raises
    ------
    KinematicsError: a setting is out of range, or mu exceeds its bound at the first guess; the text has the
        bound.
    NotConvergedError: the error limit was not reached; the attribute ``residual`` is the largest error
        left, m.
    """
    if not (epsilon > 0.0 and max_iterations >= 1):
        raise KinematicsError(
            f"Algorithm 1: expected epsilon > 0 and max_iterations >= 1, "
            f"got {epsilon!r} and {max_iterations!r}"
        )
    batch = R.shape[:-2]
    centres = (geometry.base_joints_B[3:] - platform_joints_B(geometry, R)[..., 3:, :]).reshape(-1, 3, 3)
    start = geometry.nominal_translation_B if start_B is None else start_B
    t = np.array(np.broadcast_to(start, (*batch, 3)), dtype=float).reshape(-1, 3)
    _check_step_size(t[:, None, :] - centres, mu)

    radii = geometry.nominal_lengths[3:]
    active = np.arange(len(t))
    error = np.zeros(0)
    for iteration in range(1, max_iterations + 1):
        legs = t[active, None, :] - centres[active]
        lengths = np.linalg.norm(legs, axis=-1)
        e = radii - lengths
        t[active] += mu * np.sum((e / lengths)[..., None] * legs, axis=-2)
        error = np.linalg.norm(e, axis=-1)
        # The paper tests the error before the update, and returns the point after it.
        active = active[~(error < epsilon)]
        if not len(active):
            solved = np.ones(batch, dtype=bool)
            return Translation(t.reshape(*batch, 3), solved, np.zeros((*batch, 3)), iteration)
    residual = float(np.max(error))
    raise NotConvergedError(
        f"Algorithm 1 stopped after {max_iterations} iterations with a length error of {residual:.3e} m, "
        f"expected less than {epsilon:.1e} m ({len(active)} of {len(t)} orientations); the "
        "fine legs may be unable to reach the orientation, or allow more iterations",
        residual,
    )


def step_size_bound(geometry: Geometry, translation_B: Array, R: Array) -> float:
    """Largest step size with which Algorithm 1 can converge, ``2/lambda_max(J J^T)``, smallest over a batch.

    Parameters
    ----------
    translation_B: (..., 3), m.
    R: (..., 3, 3).
    """
    centres = geometry.base_joints_B[3:] - platform_joints_B(geometry, R)[..., 3:, :]
    return _bound(translation_B[..., None, :] - centres)


def inverse_kinematics(geometry: Geometry, orientation: Array, solver: Solver = trilaterate) -> InversePose:
    """Pose and displacements for commanded orientations, eqs (16) and (17).

    Parameters
    ----------
    orientation: (..., 3), roll, pitch and yaw, rad.
    solver: :func:`trilaterate`, or :func:`descend` (with ``functools.partial`` for other settings).

    Returns
    -------
    InversePose: ``solved`` is false where no pose exists.  The stroke is not looked at: see :mod:`.inverse_kinematics`.

    Raises
    ------
    KinematicsError: the orientation is not finite or has the wrong shape; or what the solver raises.
    """
    orientation = np.asarray(orientation, dtype=float)
    if orientation.shape[-1:] != (3,) or not np.all(np.isfinite(orientation)):
        raise KinematicsError(
            "orientation: expected finite roll, pitch and yaw (..., 3), rad, "
            f"got shape {orientation.shape}: {orientation}"
        )
    R = rotation_matrix(orientation)
    solution = solver(geometry, R)
    d = displacements(geometry, solution.translation_B, R)
    return InversePose(
        orientation=orientation,
        translation_B=solution.translation_B,
        coarse_displacement=d[..., :3],
        fine_displacement=d[..., 3:],
        solved=solution.solved,
        gaps=solution.gaps,
        iterations=solution.iterations,
    )


def _sphere_triangle(geometry: Geometry, R: Array) -> tuple[Array, Array, Array, Array]:
    """First sphere centre, the edges u and v from it to the others, and w = u x v; (..., 3) each, in B."""
    centres = geometry.base_joints_B[3:] - platform_joints_B(geometry, R)[..., 3:, :]
    c1 = centres[..., 0, :]
    u, v = centres[..., 1, :] - c1, centres[..., 2, :] - c1
    return c1, u, v, cross(u, v)


@lru_cache(maxsize=8)
def _nominal_side(geometry: Geometry) -> float:
    """On which side of the plane of the sphere centres the nominal pose lies: +1 along w, or -1."""
    c1, _, _, w = _sphere_triangle(geometry, np.eye(3))
    return float(np.copysign(1.0, np.dot(geometry.nominal_translation_B - c1, w)))


def _check_step_size(legs: Array, mu: float) -> None:
    bound = _bound(legs)
    if not 0.0 < mu < bound:
        raise KinematicsError(
            f"Algorithm 1 diverges with mu = {mu:g}: expected 0 < mu < 2/lambda_max(J J^T) = {bound:.4f} "
            "at the first guess"
        )


def _bound(legs: Array) -> float:
    n = legs / np.linalg.norm(legs, axis=-1, keepdims=True)
    # J^T J has the eigenvalues of J J^T that are not zero.
    largest = np.linalg.eigvalsh(n @ np.swapaxes(n, -1, -2))[..., -1]
    return float(2.0 / np.max(largest))


# A pose computed to lie on the limit of the stroke still counts as within: rounding of a length is far
# smaller.
STROKE_TOLERANCE = 1e-12  # m
_SCAN = 60  # points of a curve of orientations, before bisection
_HALVINGS = 40  # of an interval of such a curve: 1e-12 of it


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


def reach_along(geometry: Geometry, orientation_at: Callable[[Array], Array], n: int, longest: float) -> Array:
    """How far n curves of orientations can be followed from where they start, (n,), before one is out of reach.

    Parameters
    ----------
    orientation_at: parameters (m, n) of the curves -> orientations (m, n, 3), roll, pitch, yaw, rad.
    longest: parameter at which the search ends; the result is that where everything is within reach.

    A first look in steps of ``longest / 60`` finds where a curve leaves the workspace, bisection the place.  A curve
    that does not even start within reach has -1.
    """
    steps = np.linspace(0.0, longest, _SCAN + 1)[:, None] * np.ones(n)
    within = reachable(geometry, inverse_kinematics(geometry, orientation_at(steps)))
    left = ~within.all(axis=0)
    first = np.argmin(within, axis=0)  # out of reach, where ``left``
    low = np.where(left, np.maximum(first - 1, 0), _SCAN) * (longest / _SCAN)
    high = np.where(left, low + longest / _SCAN, longest)
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        inside = reachable(geometry, inverse_kinematics(geometry, orientation_at(middle[None])))[0]
        low, high = np.where(inside, middle, low), np.where(inside, high, middle)
    return np.where(within[0], np.where(left, low, longest), -1.0)


def pure_limits(geometry: Geometry) -> Array:
    """How far each angle alone can go, the other two at zero: (3, 2), smallest and largest, rad."""
    axes = np.concatenate([-np.eye(3), np.eye(3)])
    reach = reach_along(geometry, lambda angle: angle[..., None] * axes, 6, np.radians(40.0))
    return np.column_stack([-reach[:3], reach[3:]])


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
