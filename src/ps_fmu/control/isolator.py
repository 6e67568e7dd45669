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
from ..mechanism.kinematics import KinematicsError
from ..mechanism.parameters import FeedforwardFilters, Manipulator, Parameters, Payload
from ..mechanism.quantities import Array, group
from ..mechanism.rotations import rotation_matrix
from .feedforward import Controller, Lowpass, TurningController, gains, lowpass


def known_payload(p: Parameters) -> Payload:
    """The payload as the controller knows it: its centre of mass is some millimetres off, and it is rigid."""
    return replace(p.payload, com_P=p.known_com_P, truss_modes=(), modes=())


def is_known(name: str) -> bool:
    """Whether the gains (52)-(54) need a parameter of manipulator or payload: not stroke, rod flexibility, inertia."""
    return not name.startswith(("coarse_stroke", "coarse_rods", "payload.inertia"))


class UnreachableOrientationError(ValueError):
    """No pose with ``d_f = 0`` has this orientation."""


@dataclass(frozen=True, eq=False)
class Turn:
    """A straight way from one orientation to another, (3,) each, roll, pitch, yaw, rad; without length at rest."""

    start: Array
    end: Array

    @classmethod
    def ahead(cls, orientation: Array, previous: Array, resolution: float) -> Turn:
        """The way on which the platform goes on as it has turned since the ``previous`` orientation.

        Its length is the square root of ``resolution`` (rad): gains that are linear on it are then less wrong than
        gains that stay until the platform has turned by ``resolution``.  At 1e-4 rad they are off by at most 7e-5 of
        the largest gain within 7.5 deg, the others by 2e-4.
        """
        direction = orientation - previous
        direction = direction / np.abs(direction).max()  # whose square is no longer too small for a number
        return cls(orientation, orientation + np.sqrt(resolution) / np.linalg.norm(direction) * direction)

    @property
    def length(self) -> float:
        """Rad."""
        return float(np.linalg.norm(self.end - self.start))

    @property
    def progress(self) -> Array:
        """(4, 6): from [orientation; start], how far it is on the way, 0 to 1, and how far from it (3,), rad."""
        unit = (self.end - self.start) / self.length
        from_start = np.vstack([unit / self.length, np.eye(3) - np.outer(unit, unit)])
        return np.hstack([from_start, -from_start])

    def is_left(self, orientation: Array, resolution: float) -> bool:
        """Whether an orientation is further than ``resolution`` (rad) away from it."""
        if not self.length:
            return bool(np.abs(orientation - self.start).max() > resolution)
        progress = self.progress @ np.concatenate([orientation, self.start])
        return bool((np.abs(progress - HALF_WAY) > self.allowed(resolution)).any())

    def allowed(self, resolution: float) -> Array:
        """(4,) how far the progress may be from HALF_WAY."""
        return np.array([0.5 + resolution / self.length, resolution, resolution, resolution])


#: The middle of a :class:`Turn` in its progress.
HALF_WAY = np.array([0.5, 0.0, 0.0, 0.0])


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

    def turning_controller(self, turn: Turn) -> TurningController | None:
        """The controller on a way; None if the mechanism cannot take up its end.  Raises as :meth:`controller`."""
        first = self.controller(turn.start)
        try:
            return TurningController(first, self.controller(turn.end))
        except (UnreachableOrientationError, KinematicsError):
            return None


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
