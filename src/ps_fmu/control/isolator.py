"""The feedforward controller over a slew: its gains follow the orientation of the platform.

The isolator knows the centre of mass of the payload with an error, as ``paper.toml`` states it; set it apart from the
plant's on purpose.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..mechanism.dynamics import Pose
from ..mechanism.inverse_kinematics import trilaterate
from ..mechanism.parameters import FeedforwardFilters, Manipulator, Parameters, Payload
from ..mechanism.quantities import Array, group
from ..mechanism.rotations import rotation_matrix
from .feedforward import Controller, Lowpass, gains, lowpass


def known_payload(p: Parameters) -> Payload:
    """The payload as the controller knows it: its centre of mass is some millimetres off, and the truss is rigid."""
    return replace(p.payload, com_P=p.known_com_P, truss_modes=())


def is_known(name: str) -> bool:
    """Whether the gains (52)-(54) need a parameter of manipulator or payload: not stroke, rod flexibility, inertia."""
    return not name.startswith(("coarse_stroke", "coarse_rods", "payload.inertia"))


class UnreachableOrientationError(ValueError):
    """No pose with ``d_f = 0`` has this orientation."""


@dataclass(frozen=True, eq=False)
class Isolator:
    """What the controller knows of mechanism and payload, which may differ from the plant's.

    Its scalars are parameters of the FMU.
    """

    manipulator: Manipulator = group(flat=True, keep=is_known)
    payload: Payload = group(keep=is_known)
    filters: FeedforwardFilters = group()

    @classmethod
    def from_parameters(cls, p: Parameters) -> Isolator:
        """The isolator of a parameter set."""
        return cls(p.manipulator, known_payload(p), p.filters)

    @cached_property
    def lowpass(self) -> Lowpass:
        """The low-pass M(s) of its filters."""
        return lowpass(self.filters)

    def controller(self, orientation: Array) -> Controller:
        """The controller (55) for a nominal orientation (3,), roll, pitch, yaw, rad.

        Raises
        ------
        UnreachableOrientationError: the three fine legs cannot meet at this orientation.
        """
        pose = nominal_pose(self.manipulator, orientation)
        return Controller(gains(self.manipulator, self.payload, pose), self.lowpass, self.filters)


def nominal_pose(manipulator: Manipulator, orientation: Array) -> Pose:
    """The pose with the fine legs at rest at a nominal orientation (3,), roll, pitch, yaw, rad.

    Raises
    ------
    UnreachableOrientationError: the three fine legs cannot meet at this orientation.
    """
    R = rotation_matrix(orientation)
    found = trilaterate(manipulator.geometry, R)
    if not found.solved:
        degrees = ", ".join(f"{angle:.4g}" for angle in np.degrees(orientation))
        raise UnreachableOrientationError(
            f"orientation ({degrees}) deg: no pose with the fine legs at rest; "
            f"they miss each other by {np.max(np.abs(found.gaps)):.3g} m"
        )
    return Pose(found.translation_B, R)
