"""The feedforward controller as the FMU has it: its gains follow the orientation of the platform, in C.

The isolator knows the centre of mass of the payload with an error, as ``paper.toml`` states it; set it apart from the
plant's on purpose.
"""

from __future__ import annotations

import ctypes
from ctypes import c_double, c_int64
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..mechanism.compiled import leg_moments
from ..mechanism.dynamics import Pose
from ..mechanism.inverse_kinematics import N_GEOMETRY, inverse_kinematics, pack_geometry
from ..mechanism.parameters import FeedforwardFilters, Manipulator, Parameters, Payload
from ..mechanism.quantities import Array, group
from .feedforward import Controller, Lowpass, gains, lowpass

N_MECHANISM = N_GEOMETRY + 6 * 4 + 2 * 3 + 1 + 3 + 9 + 3
"""Numbers of ``Mechanism`` of ``native/control/mechanism.h``."""


def known_payload(p: Parameters) -> Payload:
    """The payload as the controller knows it: its centre of mass is some millimetres off, and it is rigid."""
    return replace(p.payload, com_P=p.known_com_P, truss_modes=(), modes=())


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

    def pack(self, **places: int) -> IsolatorWords:
        """What the steps in C take: places in the buffer; no gains are kept yet."""
        return IsolatorWords(pack_mechanism(self.manipulator, self.payload), **places)


class IsolatorWords(ctypes.Structure):
    """``Isolator`` of ``native/control/isolator.c``: what its steps take."""

    _fields_ = (
        ("mechanism", c_double * N_MECHANISM),
        *((name, c_int64) for name in (
            "orientation", "kept_orientation", "acceleration", "driven", "filtered", "forces", "enabled",
        )),
        ("gains", c_double * (18 + 9 + 9)),
    )  # fmt: skip


def nominal_pose(manipulator: Manipulator, orientation: Array) -> Pose:
    """The pose with the fine legs at rest at a nominal orientation (3,), roll, pitch, yaw, rad.

    Raises
    ------
    UnreachableOrientationError: the three fine legs cannot meet at this orientation.
    """
    found = inverse_kinematics(manipulator.geometry, orientation)
    if not found.solved:
        degrees = ", ".join(f"{angle:.4g}" for angle in np.degrees(orientation))
        raise UnreachableOrientationError(
            f"orientation ({degrees}) deg: no pose with the fine legs at rest; "
            f"they miss each other by {np.max(np.abs(found.gaps)):.3g} m"
        )
    return Pose(found.translation_B, found.rotation_BP)


def pack_mechanism(manipulator: Manipulator, payload: Payload) -> ctypes.Array[c_double]:
    """``Mechanism`` of ``native/control/mechanism.h``; no gains are kept yet."""
    legs = manipulator.fine_legs
    (upper, _), first, second = leg_moments(manipulator.coarse_legs + legs)
    suspension = [[getattr(leg, name) for leg in legs] for name in ("stiffness", "damping")]
    numbers = (
        pack_geometry(manipulator.geometry), np.hstack([upper, *first, second]), suspension, payload.mass,
        payload.com_P, payload.inertia_P, np.full(3, np.nan),
    )  # fmt: skip
    return (c_double * N_MECHANISM)(*np.concatenate([np.ravel(part) for part in numbers]))
