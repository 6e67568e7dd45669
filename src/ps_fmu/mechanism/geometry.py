"""The joints of the six legs and the nominal pose, as arrays for the kinematics."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from .quantities import Array, freeze
from .rotations import skew

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

    @cached_property
    def base_points(self) -> Array:
        """(18, 6): velocities of the base joints, one below the other, from the twist of B; eq (A5)."""
        return point_rows(self.base_joints_B)


def point_rows(arms: Array) -> Array:
    """Velocities of points at ``arms``, one below the other, from the twist of their body, eq (A5).

    (..., n, 3) to (..., 3 n, 6).  The transpose maps forces on the points to force and torque about the body's origin.
    """
    rows = np.zeros((*arms.shape, 6))
    rows[..., :3] = _EYE
    rows[..., 3:] = -skew(arms)
    return rows.reshape(*arms.shape[:-2], -1, 6)
