"""Forward kinematics of the 6-UPS mechanism: from six leg lengths to the pose, by Newton's method.

A Newton step solves ``J_lp (dt, dtheta) = l - l(t, R)`` with the Jacobian of eq (6) and turns the platform
by the rotation vector dtheta, so that R stays a rotation whatever the step.  A 6-UPS mechanism has several
assembly modes (up to forty); Newton's method finds the one that the start is near.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite

import numpy as np

from .kinematics import Geometry, KinematicsError, LegLines, find_leg_lines, leg_rows
from .quantities import Array
from .rotations import roll_pitch_yaw, rotation_from_vector

TOLERANCE = 1e-14  # m; rounding of a leg length of 0.4 m is 5e-17 m
_ROUNDING = 2e-16  # m; where no step makes the error smaller
_NEAR = 1e-9  # m; so near, the last Jacobian is right in seven digits, and serves for what is left
_EYE = np.eye(3)


class ForwardKinematicsError(KinematicsError):
    """Newton's method did not converge; ``residual`` is the largest length error that was left, m."""

    def __init__(self, message: str, residual: float) -> None:
        super().__init__(message)
        self.residual = residual


@dataclass(frozen=True, eq=False)
class ForwardPose:
    """Pose of the platform for given leg lengths; leading dimensions as those of the lengths."""

    translation_B: Array
    """(..., 3), m: origin of P in B."""
    R: Array
    """(..., 3, 3), P to B."""
    residuals: tuple[float, ...]
    """Largest length error before each Newton step, and at the end, m."""
    legs: LegLines
    """Where the legs are."""

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
        legs = find_leg_lines(geometry, translation_B, R)
        error = lengths - legs.length
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
                present = np.asarray(np.linalg.inv(leg_rows(legs.arms_B, legs.n_B)), dtype=np.float64)
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
    return ForwardPose(np.asarray(translation_B), np.asarray(R), tuple(residuals), legs)
