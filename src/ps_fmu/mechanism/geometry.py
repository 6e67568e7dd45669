"""The joints of the six legs and the nominal pose, as arrays for the kinematics."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from .quantities import Array, freeze


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
