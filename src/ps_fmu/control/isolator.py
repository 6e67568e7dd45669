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
from ..mechanism.discretisation import prepare
from ..mechanism.dynamics import Pose
from ..mechanism.inverse_kinematics import N_GEOMETRY, inverse_kinematics, pack_geometry
from ..mechanism.parameters import LARGEST_ORDER, FeedforwardFilters, Manipulator, Parameters, Payload
from ..mechanism.quantities import Array, group
from ..numerics.library import Discretisation
from .feedforward import Controller, Lowpass, gains, lowpass

N_MECHANISM = N_GEOMETRY + 6 * 4 + 2 * 3 + 1 + 3 + 9 + 3
"""Numbers of ``Mechanism`` of ``native/control/mechanism.h``."""
MOST_AXIS_STATES = 2 + LARGEST_ORDER
"""Of ``native/control/axes.h``."""


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
        A, B = self.axis_matrices()
        filtering, arrays = pack_filter(A, B)
        lowpass = (c_double * LARGEST_ORDER)(*self.lowpass.c)
        words = IsolatorWords(pack_mechanism(self.manipulator, self.payload), filtering, lowpass, **places)
        words.arrays = arrays
        return words

    def axis_matrices(self) -> tuple[Array, Array]:
        """A and B of one axis: high-passed rotation of the base and its rate, and the low-pass of a force.

        Inputs are the angular acceleration of the base and the force that its acceleration demands.
        """
        low, n = self.lowpass, 2 + self.lowpass.order
        omega = 2.0 * np.pi * self.filters.highpass_frequency  # rad/s
        A, B = np.zeros((n, n)), np.zeros((n, 2))
        A[:2, :2] = [[0.0, 1.0], [-(omega**2), -2.0 * self.filters.highpass_damping_ratio * omega]]
        A[2:, 2:], B[1, 0], B[2:, 1] = low.A, 1.0, low.b
        return A, B

    def linearise(self, orientation: Array) -> tuple[Array, Array, Array]:
        """A, B, C from the acceleration of the base to the forces; states of :meth:`axis_matrices`, axis by axis.

        Raises
        ------
        UnreachableOrientationError: the three fine legs cannot meet at this orientation.
        """
        found, one = self.controller(orientation).gains, np.eye(3)
        A, B = self.axis_matrices()
        turned = np.hstack([np.zeros((3, 3)), one])
        C = np.hstack([found.displacement[:, 3:], found.velocity[:, 3:], np.kron(self.lowpass.c, one)])
        driven = np.kron(B[:, :1], turned) + np.kron(B[:, 1:], found.acceleration)
        return np.asarray(np.kron(A, one)), np.asarray(driven), C


class _AxisStep(ctypes.Structure):
    """``AxisStep`` of ``native/control/axes.h``."""

    _fields_ = (
        ("step", c_double), ("factors", c_double * (MOST_AXIS_STATES * (MOST_AXIS_STATES + 2))),
        ("spans", c_int64 * (2 * MOST_AXIS_STATES)),
    )  # fmt: skip


class AxisFilter(ctypes.Structure):
    """``AxisFilter`` of ``native/control/axes.h``."""

    _fields_ = (("work", Discretisation), ("steps", _AxisStep * 4), ("oldest", c_int64))


class IsolatorWords(ctypes.Structure):
    """``Isolator`` of ``native/control/isolator.c``: what its steps take."""

    _fields_ = (
        ("mechanism", c_double * N_MECHANISM), ("filter", AxisFilter), ("lowpass", c_double * LARGEST_ORDER),
        *((name, c_int64) for name in (
            "orientation", "kept_orientation", "acceleration", "states", "enabled", "forces",
        )),
        ("gains", c_double * (18 + 9 + 9)),
    )  # fmt: skip

    arrays: list[Array]
    """What the words point to."""


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


def pack_filter(A: Array, B: Array) -> tuple[AxisFilter, list[Array]]:
    """The filter of one axis, A (n, n) and B (n, 2), for steps in C; what it points to has to be kept as long."""
    work, arrays = prepare(A, B)
    return AxisFilter(work), arrays


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
