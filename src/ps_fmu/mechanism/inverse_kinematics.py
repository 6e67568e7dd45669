"""Inverse kinematics with the fine actuators at rest, section 2.3: orientation to coarse displacement, and its limits.

The orientation alone is commanded.  The constraint ``d_f = 0`` (17) fixes the translation: it lies on three
spheres, ``|t - c_i| = l_f0i`` with centres ``c_i = r_bfi - R r_pfi``.  Two methods find it, in C that the FMUs run, too
(``native/control/poses.c``):

Trilateration, in closed form and exact to rounding.  With ``u = c_2 - c_1``, ``v = c_3 - c_1``, ``w = u x v`` and
``x = t - c_1``, sphere 1 subtracted from the others gives ``x.u = (u^2 + r_1^2 - r_2^2)/2`` and likewise for v;
sphere 1 gives the component of x along w up to its sign.  The two roots are mirror images in the plane of the centres.
The platform cannot pass from one to the other without d_f = 0 becoming singular, so that the root with the sign of the
nominal pose is the right one.

Algorithm 1 of the paper, gradient descent on the length errors of the fine legs: ``t <- t + mu J e`` with ``J = [n_f1
n_f2 n_f3]`` and ``e = l_f0 - l_f``, from the nominal translation until ``|e| < epsilon``.  It converges only for ``mu <
2/lambda_max(J J^T)``, 0.79 to 0.84 in the workspace of the identified geometry.  1e-6 m leaves up to 4e-4 deg when the
coarse lengths are realised exactly; 1e-8 deg needs about 1e-11 m.

A pose is reachable if the spheres meet, within the coarse stroke, away from singularity.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from ctypes import c_char_p, c_double, c_int64, c_void_p
from dataclasses import dataclass
from functools import cache, lru_cache

import numpy as np
from numpy.typing import NDArray

from ..numerics.library import find_address, find_library
from .kinematics import LARGEST_CONDITION, Geometry, KinematicsError, NotConvergedError, platform_joints_B
from .quantities import Array

BoolArray = NDArray[np.bool_]


class Method(ctypes.Structure):
    """``Method`` of ``native/control/mechanism.h``: trilateration, or Algorithm 1 where ``most`` is above 0."""

    _fields_ = (("mu", c_double), ("epsilon", c_double), ("most", c_int64))


TRILATERATION = Method()


def make_algorithm_1(mu: float = 0.73, epsilon: float = 1e-6, max_iterations: int = 500) -> Method:
    """Algorithm 1 with a step size mu, an error limit epsilon (m) and a bound of its iterations.

    Raises KinematicsError: a setting is out of range.
    """
    if not (epsilon > 0.0 and max_iterations >= 1):
        raise KinematicsError(
            f"Algorithm 1: expected epsilon > 0 and max_iterations >= 1, got {epsilon!r} and {max_iterations!r}"
        )
    return Method(mu, epsilon, max_iterations)


_FOUND, _FAR, _COLLINEAR, _APART, _DIVERGES, _UNFINISHED = range(6)
_POSE = np.dtype(
    [("status", "f8"), ("iterations", "f8"), ("t_B", "f8", 3), ("R", "f8", (3, 3)), ("arms_B", "f8", (6, 3)),
     ("n_B", "f8", (6, 3)), ("length", "f8", 6), ("displacement", "f8", 6), ("gap", "f8", 3), ("bound", "f8"),
     ("left", "f8")]
)  # fmt: skip
"""``Pose`` of ``native/control/mechanism.h``."""
N_GEOMETRY = 50
"""Numbers of ``Geometry`` there."""


@dataclass(frozen=True, eq=False)
class InversePose:
    """Pose and displacements for commanded orientations with the fine actuators at rest.

    The stroke is not looked at: see :func:`reachable`.
    """

    orientation: Array
    """(..., 3), roll, pitch and yaw, rad."""
    found: NDArray[np.void]
    """(...), what C found."""

    @property
    def translation_B(self) -> Array:
        """(..., 3), m; nan where not solved."""
        return np.asarray(self.found["t_B"])

    @property
    def rotation_BP(self) -> Array:
        """(..., 3, 3), P to B, eq (14)."""
        return np.asarray(self.found["R"])

    @property
    def coarse_displacement(self) -> Array:
        """(..., 3), m, from nominal; nan where not solved."""
        return np.asarray(self.found["displacement"][..., :3])

    @property
    def fine_displacement(self) -> Array:
        """(..., 3), m: what the method left of d_f = 0; nan where not solved."""
        return np.asarray(self.found["displacement"][..., 3:])

    @property
    def residual(self) -> Array:
        """(...), m: the largest ``|l_f - l_f0|``."""
        return np.asarray(np.max(np.abs(self.fine_displacement), axis=-1))

    @property
    def solved(self) -> BoolArray:
        """(...), bool: whether a pose with d_f = 0 exists."""
        return np.asarray(self.found["status"] == _FOUND)

    @property
    def gaps(self) -> Array:
        """(..., 3), m: what each fine leg lacks to reach the point in the plane of the sphere centres that has the same
        power with respect to all three; zero where solved, inf where the centres lie on a line."""
        return np.where((self.found["status"] == _COLLINEAR)[..., None], np.inf, self.found["gap"])

    @property
    def iterations(self) -> int:
        """Iterations of Algorithm 1 for the slowest orientation; 0 for the closed form."""
        return int(self.found["iterations"].max(initial=0.0))


def inverse_kinematics(geometry: Geometry, orientation: Array, method: Method = TRILATERATION) -> InversePose:
    """Pose and displacements for commanded orientations, eqs (16) and (17).

    Parameters
    ----------
    orientation: (..., 3), roll, pitch and yaw, rad.
    method: :data:`TRILATERATION`, or that of :func:`make_algorithm_1`.

    Returns
    -------
    InversePose: ``solved`` is false where no pose exists.

    Raises
    ------
    KinematicsError: the orientation is not finite or has the wrong shape; mu exceeds its bound at the first guess,
        which the text states.
    NotConvergedError: Algorithm 1 did not reach its error limit; the attribute ``residual`` is the error left, m.
    """
    orientation = np.ascontiguousarray(orientation, dtype=float)
    if orientation.shape[-1:] != (3,) or not np.all(np.isfinite(orientation)):
        raise KinematicsError(
            "orientation: expected finite roll, pitch and yaw (..., 3), rad, "
            f"got shape {orientation.shape}: {orientation}"
        )
    found = np.empty(orientation.shape[:-1], _POSE)
    _library().control_find_poses(
        find_address(pack_geometry(geometry)), method, find_address(orientation), found.size, found.ctypes.data
    )
    pose = InversePose(orientation, found)
    if method.most and (found["status"] >= _DIVERGES).any():
        k = int(np.argmax(found["status"].reshape(-1) >= _DIVERGES))
        text, left = _explain(geometry, method, pose, k), found.reshape(-1)[k]
        raise NotConvergedError(text, left["left"]) if left["status"] == _UNFINISHED else KinematicsError(text)
    return pose


def reachable(geometry: Geometry, pose: InversePose) -> BoolArray:
    """Whether a pose exists with d_f = 0, within the stroke and nonsingular; (...), bool."""
    result = np.empty(pose.found.shape, dtype=bool)
    geometry_at = find_address(pack_geometry(geometry))
    _library().control_check_poses(geometry_at, pose.found.ctypes.data, pose.found.size, result.ctypes.data)
    return result


def why_unreachable(geometry: Geometry, pose: InversePose) -> str | None:
    """The first unreachable pose of a batch in words: which leg or sphere fails, by how much and where.

    Returns
    -------
    None when every pose is reachable.
    """
    ok = reachable(geometry, pose).reshape(-1)
    return None if ok.all() else _explain(geometry, TRILATERATION, pose, int(np.argmin(ok)))


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


_SCAN = 60  # points of a curve of orientations, before bisection
_HALVINGS = 40  # of an interval of such a curve: 1e-12 of it


def pure_limits(geometry: Geometry) -> Array:
    """How far each angle alone can go, the other two at zero: (3, 2), smallest and largest, rad."""
    axes = np.concatenate([-np.eye(3), np.eye(3)])
    reach = reach_along(geometry, lambda angle: angle[..., None] * axes, 6, np.radians(40.0))
    return np.column_stack([-reach[:3], reach[3:]])


def step_size_bound(geometry: Geometry, translation_B: Array, R: Array) -> float:
    """Largest step size with which Algorithm 1 can converge, ``2/lambda_max(J J^T)``.

    Parameters
    ----------
    translation_B: (3,), m.
    R: (3, 3).
    """
    legs = translation_B - geometry.base_joints_B[3:] + platform_joints_B(geometry, R)[3:]
    return float(2.0 / np.linalg.norm(legs / np.linalg.norm(legs, axis=-1, keepdims=True), 2) ** 2)


@lru_cache(maxsize=8)
def pack_geometry(geometry: Geometry) -> Array:
    """``Geometry`` of ``native/control/mechanism.h``, (N_GEOMETRY,); read-only."""
    centres = (geometry.base_joints_B - geometry.platform_joints_P)[3:]  # of the spheres, at the nominal pose
    above = np.cross(centres[1] - centres[0], centres[2] - centres[0]) @ (geometry.nominal_translation_B - centres[0])
    packed = np.concatenate([
        geometry.base_joints_B.ravel(), geometry.platform_joints_P.ravel(), geometry.nominal_translation_B,
        geometry.nominal_lengths, geometry.coarse_stroke,
        [np.copysign(1.0, above), geometry.platform_radius, LARGEST_CONDITION],
    ])  # fmt: skip
    packed.setflags(write=False)
    return packed


def _explain(geometry: Geometry, method: Method, pose: InversePose, k: int) -> str:
    text = ctypes.create_string_buffer(512)
    orientation, found = np.ascontiguousarray(pose.orientation.reshape(-1, 3)[k]), pose.found.reshape(-1)[k : k + 1]
    _library().control_explain(
        find_address(pack_geometry(geometry)), method, find_address(orientation), found.ctypes.data, text, len(text)
    )
    return text.value.decode()


@cache
def _library() -> ctypes.CDLL:
    library, method = find_library(), ctypes.POINTER(Method)
    library.control_find_poses.argtypes = c_void_p, method, c_void_p, c_int64, c_void_p
    library.control_check_poses.argtypes = c_void_p, c_void_p, c_int64, c_void_p
    library.control_explain.argtypes = c_void_p, method, c_void_p, c_void_p, c_char_p, c_int64
    return library
