"""Joints, legs and Jacobians of the 6-UPS manipulator: eqs (2)-(13) and (16) of the paper.

Frame B is the manipulator base, P the payload platform.  A pose is the position of the origin of P in B
(``translation_B``, the paper's t_Delta, m) and the matrix ``R`` that maps P to B (:mod:`.rotations`).  Rows
of six are the coarse legs 1..3, then the fine legs 1..3 (eq 4).  Small motions are ``q = (t, theta)`` of
the platform and of the base, all in axes of B at the pose considered.

Two signs of the paper are corrected here.  By (3) the base term of (8) and (11) is positive, as (24) has it:
``dq_p = J_pl dd + J_pb dq_b``.  The first line of (16) lacks ``- l_f0``.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import isfinite

import numpy as np

from .quantities import Array, freeze
from .rotations import cross, lengths, roll_pitch_yaw, rotation_from_vector

_EYE = np.eye(3)


@dataclass(frozen=True, eq=False)
class Geometry:
    """Joints and nominal pose, as the kinematics needs them; rows are coarse legs 1..3, then fine legs 1..3 (eq 4)."""

    base_joints_B: Array
    platform_joints_P: Array
    nominal_translation_B: Array
    coarse_stroke: Array

    @cached_property
    def nominal_lengths(self) -> Array:
        """Joint-to-joint lengths at the nominal pose (zero roll, pitch and yaw), shape (6,), m."""
        legs_B = self.nominal_translation_B + self.platform_joints_P - self.base_joints_B
        return freeze(np.linalg.norm(legs_B, axis=1), (6,), "nominal_lengths")

    @cached_property
    def platform_radius(self) -> float:
        """Root-mean-square distance of the platform joints from the origin of P, m."""
        return float(np.sqrt(np.mean(np.sum(self.platform_joints_P**2, axis=1))))

    @cached_property
    def twist_scale(self) -> Array:
        """(6,) what makes a twist of the platform one of lengths: 1, and the :attr:`platform_radius`, m."""
        return np.repeat([1.0, self.platform_radius], 3)


# Condition number of the length-scaled J_lp beyond which a pose counts as singular.  It is 4.2 to 4.7 in
# the whole workspace of the identified geometry; at 1e6 a leg error of 1 um can move the platform joints by
# half a metre.
LARGEST_CONDITION = 1e6


class KinematicsError(ValueError):
    """A pose that the mechanism or the method cannot handle."""


class SingularPoseError(KinematicsError):
    """The legs do not determine the motion of the platform (eq 12)."""


@dataclass(frozen=True, eq=False)
class Jacobians:
    """First-order kinematics at a pose, eqs (3)-(11); leading dimensions are allowed in every array.

    ``dd = J_lp dq_p - J_lb dq_b`` and ``dq_p = J_pl dd + J_pb dq_b``.  Names of blocks follow the paper:
    rows t (translation) and theta (rotation), columns c (coarse) and f (fine).
    """

    J_lp: Array
    """(..., 6, 6), eq (6): platform motion to leg displacement."""
    J_lb: Array
    """(..., 6, 6), eq (7): base motion to (minus) leg displacement."""
    J_pl: Array
    """(..., 6, 6), eq (9): the inverse of J_lp."""
    J_pb: Array
    """(..., 6, 6), eq (10): base motion to platform motion with all legs held."""

    @property
    def J_pc(self) -> Array:
        """(..., 6, 3): coarse displacement to platform motion."""
        return self.J_pl[..., :, :3]

    @property
    def J_pf(self) -> Array:
        """(..., 6, 3): fine displacement to platform motion."""
        return self.J_pl[..., :, 3:]

    @property
    def J_theta_c(self) -> Array:
        """(..., 3, 3), rad/m: coarse displacement to platform rotation."""
        return self.J_pl[..., 3:, :3]

    @property
    def J_theta_f(self) -> Array:
        """(..., 3, 3), rad/m, eq (13): fine displacement to platform rotation."""
        return self.J_pl[..., 3:, 3:]

    @property
    def J_theta_b(self) -> Array:
        """(..., 3, 6): base motion to platform rotation; [0 E], a rigid turn (eq 39 in axes of B)."""
        return self.J_pb[..., 3:, :]


def leg_vectors(geometry: Geometry, translation_B: Array, R: Array) -> Array:
    """Vectors from base joint to platform joint, eq (16): ``l_i = t + R r_pi - r_bi``.

    Parameters
    ----------
    translation_B: (..., 3), m.
    R: (..., 3, 3).

    Returns
    -------
    (..., 6, 3), m, in B.
    """
    return translation_B[..., None, :] + platform_joints_B(geometry, R) - geometry.base_joints_B


def leg_lengths(geometry: Geometry, translation_B: Array, R: Array) -> Array:
    """Distances of the two joints of each leg, (..., 6), m; arguments as :func:`leg_vectors`."""
    return lengths(leg_vectors(geometry, translation_B, R))


def displacements(geometry: Geometry, translation_B: Array, R: Array) -> Array:
    """Displacements of all actuators from nominal, eqs (2) and (16), (..., 6), m; as :func:`leg_lengths`."""
    return leg_lengths(geometry, translation_B, R) - geometry.nominal_lengths


def platform_joints_B(geometry: Geometry, R: Array) -> Array:
    """``R r_pi``: platform joints from the origin of P in axes of B; (..., 3, 3) to (..., 6, 3), m."""
    return geometry.platform_joints_P @ np.swapaxes(R, -1, -2)


def platform_jacobian(geometry: Geometry, translation_B: Array, R: Array) -> Array:
    """J_lp, eq (6): rows ``[n_i, (R r_pi) x n_i]``; (..., 6, 6), in axes of B."""
    vectors_B = leg_vectors(geometry, translation_B, R)
    length = np.sqrt(np.vecdot(vectors_B, vectors_B))
    return leg_rows(platform_joints_B(geometry, R), vectors_B / length[..., None])


def jacobians(geometry: Geometry, translation_B: Array, R: Array) -> Jacobians:
    """All Jacobians at a pose, or at many.

    Parameters
    ----------
    translation_B: (..., 3), m.
    R: (..., 3, 3).

    Raises
    ------
    SingularPoseError: J_lp is singular, or nearly so, at one of the poses.
    """
    J_lp = platform_jacobian(geometry, translation_B, R)
    J_lb = leg_rows(geometry.base_joints_B, J_lp[..., :3])
    try:
        J_pl = np.asarray(np.linalg.inv(J_lp), dtype=np.float64)
    except np.linalg.LinAlgError:
        J_pl = np.full_like(J_lp, np.inf)
    if not _is_surely_regular(geometry, J_lp, J_pl):
        _refuse_singular_poses(geometry, J_lp)
    return Jacobians(J_lp=J_lp, J_lb=J_lb, J_pl=J_pl, J_pb=J_pl @ J_lb)


def _is_surely_regular(geometry: Geometry, J_lp: Array, J_pl: Array) -> bool:
    """Whether the product of Frobenius norms, which bounds the condition number, is small; 7 us instead of 24."""
    scale = geometry.twist_scale
    squares = np.add.reduce((J_lp / scale) ** 2, axis=(-2, -1)), np.add.reduce((J_pl.mT * scale) ** 2, axis=(-2, -1))
    return bool((squares[0] * squares[1] <= LARGEST_CONDITION**2).all())


def _refuse_singular_poses(geometry: Geometry, J_lp: Array) -> None:
    worst = float(np.max(condition_number(geometry, J_lp), initial=0.0))
    if not worst <= LARGEST_CONDITION:
        raise SingularPoseError(
            f"the six legs are singular at this pose: condition number of J_lp {worst:.2e}, "
            f"at most {LARGEST_CONDITION:.0e} is usable (eq 12)"
        )


def condition_number(geometry: Geometry, J_lp: Array) -> Array:
    """Condition number of J_lp with rotations measured as arc at the platform joints; (..., 6, 6) to (...).

    J_lp mixes 1 and m.  Its last three columns are divided by the root-mean-square radius of the platform
    joints, so that the number depends on the shape of the mechanism and not on the unit of length.
    """
    scaled = np.array(J_lp)
    scaled[..., 3:] /= geometry.platform_radius
    return np.asarray(np.linalg.cond(scaled))


def list_singularities(geometry: Geometry, translation_B: Array, R: Array) -> list[str]:
    """Which conditions of section 2.2 a pose violates, in words: N_c, N_f and J_lp nonsingular.

    By (12) and (13) they hold exactly when fine and coarse actuators can each control the rotation alone;
    the other three then act as fixed struts.

    Parameters
    ----------
    translation_B: (3,), m.
    R: (3, 3).
    """
    J_lp = platform_jacobian(geometry, translation_B, R)
    conditions = {
        "N_c (directions of the coarse legs)": float(np.linalg.cond(J_lp[:3, :3])),
        "N_f (directions of the fine legs)": float(np.linalg.cond(J_lp[3:, :3])),
        "J_lp (the six legs)": float(condition_number(geometry, J_lp)),
    }
    return [
        f"{name} is singular: condition number {value:.2e}, at most {LARGEST_CONDITION:.0e} is usable"
        for name, value in conditions.items()
        if not value <= LARGEST_CONDITION
    ]


def leg_rows(joints_B: Array, n_B: Array) -> Array:
    """Rows ``[n_i, r_i x n_i]`` of eqs (6) and (7), (..., 6, 6): joints r_i (m) and leg directions n_i, (..., 6, 3)."""
    return np.concatenate([n_B, cross(joints_B, n_B)], axis=-1)


# --- Forward: from six leg lengths to the pose ------------------------------------------------------------------------
#
# A Newton step solves ``J_lp (dt, dtheta) = l - l(t, R)`` with the Jacobian of eq (6) and turns the platform
# by the rotation vector dtheta, so that R stays a rotation whatever the step.  A 6-UPS mechanism has several
# assembly modes (up to forty); Newton's method finds the one that the start is near.

TOLERANCE = 1e-14  # m; rounding of a leg length of 0.4 m is 5e-17 m
_ROUNDING = 2e-16  # m; where no step makes the error smaller
_NEAR = 1e-9  # m; so near, the last Jacobian is right in seven digits, and serves for what is left
_EYE = np.eye(3)


class NotConvergedError(KinematicsError):
    """A method did not reach its error limit; ``residual`` is what was left, m."""

    def __init__(self, message: str, residual: float) -> None:
        super().__init__(message)
        self.residual = residual


class ForwardKinematicsError(NotConvergedError):
    """Newton's method did not converge; ``residual`` is the largest length error that was left, m."""


@dataclass(frozen=True, eq=False)
class ForwardPose:
    """Pose of the platform for given leg lengths; leading dimensions as those of the lengths."""

    translation_B: Array
    """(..., 3), m: origin of P in B."""
    R: Array
    """(..., 3, 3), P to B."""
    residuals: tuple[float, ...]
    """Largest length error before each Newton step, and at the end, m."""

    @property
    def orientation(self) -> Array:
        """(..., 3), roll, pitch and yaw, rad."""
        return roll_pitch_yaw(self.R)

    @property
    def residual(self) -> float:
        """Largest length error of the result, m."""
        return self.residuals[-1]


def forward_kinematics(
    geometry: Geometry,
    lengths: Array,
    start_translation_B: Array | None = None,
    start_R: Array | None = None,
    max_steps: int = 20,
) -> ForwardPose:
    """Pose of the platform from the six leg lengths.

    Parameters
    ----------
    lengths: (..., 6), m, coarse 1..3 then fine 1..3; a batch is solved at once, each pose to the bits that it has by
        itself.
    start_translation_B, start_R: (..., 3), m, and (..., 3, 3), broadcast against the batch; default: the
        nominal pose, from which the whole stroke range converges in four to six steps.
    max_steps: Newton steps after which to give up.

    Raises
    ------
    ForwardKinematicsError: no convergence to 1e-14 m (lengths that do not fit together, a singular pose on
        the way, or a start too far away); the text and the attribute ``residual`` say what was left.
    """
    lengths = np.asarray(lengths, dtype=float)
    if lengths.shape[-1:] != (6,) or not ((lengths > 0.0) & (lengths < np.inf)).all():
        raise KinematicsError(
            f"leg lengths: expected positive finite numbers of shape (..., 6), m, "
            f"got shape {lengths.shape}: {lengths}"
        )
    batch = lengths.shape[:-1]
    start = geometry.nominal_translation_B if start_translation_B is None else start_translation_B
    translation_B = np.zeros((*batch, 3)) + start
    R = np.zeros((*batch, 3, 3)) + (_EYE if start_R is None else start_R)
    residuals: list[float] = []
    converged = np.zeros(batch, dtype=bool)
    inverse: Array | None = None
    for _ in range(max_steps + 1):
        vectors_B = leg_vectors(geometry, translation_B, R)
        error = lengths - np.sqrt(np.vecdot(vectors_B, vectors_B))
        largest = np.abs(error).max(axis=-1)
        residuals.append(float(largest.max(initial=0.0)))
        # One step after the tolerance is met takes what is left of the error down to rounding.
        done = converged | (largest <= _ROUNDING)
        if done.all() or not isfinite(residuals[-1]):
            break
        converged = done | (largest <= TOLERANCE)
        error[done] = 0.0  # no further step
        near = largest <= _NEAR
        if inverse is None or not near.all():
            try:
                present = np.asarray(np.linalg.inv(platform_jacobian(geometry, translation_B, R)), dtype=np.float64)
            except np.linalg.LinAlgError:
                break
            inverse = present if inverse is None else np.asarray(np.where(near[..., None, None], inverse, present))
        step = np.asarray(inverse @ error[..., None])[..., 0]
        translation_B = translation_B + step[..., :3]
        R = rotation_from_vector(step[..., 3:]) @ R
    if not residuals[-1] <= TOLERANCE:
        raise ForwardKinematicsError(
            f"forward kinematics did not converge in {len(residuals) - 1} Newton steps: largest length error "
            f"{residuals[-1]:.3e} m, expected at most {TOLERANCE:.0e} m; check that the six lengths fit "
            "together, or start nearer to the pose",
            residuals[-1],
        )
    return ForwardPose(np.asarray(translation_B), np.asarray(R), tuple(residuals))
