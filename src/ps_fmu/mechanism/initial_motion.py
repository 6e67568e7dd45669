"""How a run of the plant begins: attitude and angular velocity of the base."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .quantities import Array, Checked, ParameterError, quantity
from .rotations import IDENTITY

#: Largest difference from 1 of the norm of a quaternion: as much as three digits leave.
_ROUGHLY_UNIT = 0.01
#: Fastest turn that is taken, rad/s: far beyond any spacecraft.
_FASTEST = 100.0


@dataclass(frozen=True, eq=False)
class InitialMotion(Checked):
    """Attitude and angular velocity of the base at the start; the common centre of mass is at rest."""

    initial_attitude: Array = quantity(
        "1", "Attitude of B at the start, unit quaternion, scalar first, to inertial axes", shape=(4,)
    )
    initial_angular_velocity_B: Array = quantity(
        "rad/s", "Angular velocity of B at the start, relative to inertial space, in B", shape=(3,)
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        norm = float(np.linalg.norm(self.initial_attitude))
        if not abs(norm - 1.0) <= _ROUGHLY_UNIT:
            raise ParameterError(
                "initial_attitude", f"expected a unit quaternion (w, x, y, z), got one of norm {norm:.6g}"
            )
        fastest = float(np.abs(self.initial_angular_velocity_B).max())
        if fastest > _FASTEST:
            raise ParameterError("initial_angular_velocity", f"must be within +-{_FASTEST:g} rad/s, got {fastest:g}")

    @property
    def unit_attitude(self) -> Array:
        """(4,) the attitude, of norm 1."""
        return np.asarray(self.initial_attitude / np.linalg.norm(self.initial_attitude))


#: At rest, with the axes of B along the inertial ones.
STILL = InitialMotion(IDENTITY, np.zeros(3))
