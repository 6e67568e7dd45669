"""Pointing control: fine forces from the line-of-sight error, gains that follow the orientation of the platform.

With e the rotation (rad, axes of P) that takes the payload to its target, the command w of the payload's rotation and
the forces of the fine actuators are::

    w(s)   = k(s) e(s)
    k(s)   = w_c (s + w_i) / s^2  *  w_r^2 / (s^2 + 2 z w_r s + w_r^2)
    f_f(s) = (M s^2 + C s + K) J^-1 w(s)

k(s) integrates once above the frequency w_i and twice below it, so that neither a constant rate of the bus nor the
force that holds a turned payload leaves an error; the second factor rolls off.  M, C and K are mass, damping and
stiffness of the fine legs with the payload (M = J_pf^T (M_p + M_alpha) J_pf of eq (28)), J maps their elongations to
the payload's rotation.  The factor in front of w is a **notch** for all three suspension modes at once, as a matrix: on
a base that does not move, payload rotation over f_f is J (M s^2 + C s + K)^-1 (eq 46), so that the loop is k(s) times
the unit matrix.  Rotations of one axis do not move the others.  As k(s) rolls off, no derivative of e is formed.
"""

from __future__ import annotations

import ctypes
from ctypes import c_double, c_int64
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from ..mechanism.discretisation import zero_order_hold
from ..mechanism.dynamics import Pose, find_fine_mass
from ..mechanism.kinematics import jacobians
from ..mechanism.parameters import Manipulator, Parameters, Payload
from ..mechanism.quantities import Array, Checked, Complex, group, quantity
from .isolator import N_MECHANISM, AxisFilter, known_payload, nominal_pose, pack_filter, pack_mechanism

#: States of a controller: for each axis the first and second integral of the error, the command and its rate.
N_STATES = 12


def is_known(name: str) -> bool:
    """Whether the control law needs a parameter of manipulator or payload: not stroke and rod flexibility."""
    return not name.startswith(("coarse_stroke", "coarse_rods"))


@dataclass(frozen=True)
class LoopDesign(Checked):
    """What shapes k(s)."""

    crossover_frequency: float = quantity("Hz", "Frequency w_c at which the loop gain is one", above=0.0)
    integral_frequency: float = quantity(
        "Hz", "Frequency w_i below which the loop integrates twice; 0 = one integrator only", at_least=0.0
    )
    rolloff_frequency: float = quantity("Hz", "Frequency w_r of the second-order roll-off", above=0.0)
    rolloff_damping_ratio: float = quantity("1", "Damping ratio z of the roll-off", above=0.0)

    def response(self, s: ArrayLike) -> Complex:
        """k(s), (...), of complex frequencies in rad/s."""
        wc, wi, wr = 2.0 * np.pi * np.array(
            [self.crossover_frequency, self.integral_frequency, self.rolloff_frequency]
        )  # rad/s
        s = np.asarray(s, dtype=complex)
        return np.asarray(wc * (s + wi) / s**2 * wr**2 / (s**2 + 2.0 * self.rolloff_damping_ratio * wr * s + wr**2))

    def matrices(self) -> tuple[Array, Array]:
        """A (4, 4) and B (4, 1) of ``x' = A x + B e`` of one axis, x = [i, j, w, w'] of :class:`PointingFilter`."""
        wc, wi, wr = 2.0 * np.pi * np.array(
            [self.crossover_frequency, self.integral_frequency, self.rolloff_frequency]
        )  # rad/s
        A = np.zeros((4, 4))
        A[1, 0] = A[2, 3] = 1.0
        A[3] = wr**2 * wc, wr**2 * wc * wi, -(wr**2), -2.0 * self.rolloff_damping_ratio * wr
        return A, np.eye(4, 1)


#: A quarter of the suspension's 5 Hz.  With a tracker of 100 Hz and 10 ms it keeps 9.6 dB of one axis, 7.5 dB of all
#: axes alike, and 50 deg; a payload that the controller knows 9.5 mm off is in that.
DEFAULT_DESIGN = LoopDesign(
    crossover_frequency=1.25, integral_frequency=0.4, rolloff_frequency=7.0, rolloff_damping_ratio=0.7
)


@dataclass(frozen=True, eq=False)
class Notch:
    """The matrix notch ``(M s^2 + C s + K) J^-1``, from rotation of the payload (rad, P) to fine forces (N)."""

    mass: Array  # (3, 3), N.s2/rad
    damping: Array  # (3, 3), N.s/rad
    stiffness: Array  # (3, 3), N/rad

    def response(self, s: ArrayLike) -> Complex:
        """(..., 3, 3)."""
        s = np.asarray(s, dtype=complex)[..., None, None]
        return np.asarray(s * s * self.mass + s * self.damping + self.stiffness)


@dataclass(frozen=True, eq=False)
class PointingFilter:
    """The control law at an orientation as a state-space system from line-of-sight error (3) to fine force (3).

    State ``x = [i (3), j (3), w (3), w' (3)]``: first and second integral of the error (rad.s, rad.s2), command of the
    payload's rotation and its rate (rad, rad/s).  A new orientation changes the gains only; the states keep their
    meaning.
    """

    notch: Notch
    design: LoopDesign

    @property
    def integrators(self) -> int:
        """Poles at zero, of each axis."""
        return 2 if self.design.integral_frequency else 1

    def matrices(self) -> tuple[Array, Array, Array]:
        """A, B, C of ``x' = A x + B [e; g]``, ``f = C x``, for e (3, rad) and the excess g of the forces (3, N).

        The excess is what a limit cut off.  It goes back to the first integral (back-calculation) through the static
        gain of the notch, at the rate w_c.
        """
        return *self._spread(*self.design.matrices()), self.output_map()

    def output_map(self) -> Array:
        """C: force from the state, (3, 12)."""
        C = np.kron(self.design.matrices()[0][3], self.notch.mass)
        C[:, 6:9] += self.notch.stiffness
        C[:, 9:12] += self.notch.damping
        return np.asarray(C)

    def hold(self, h: float) -> tuple[Array, Array]:
        """Ad (12, 12) and Bd (12, 6) of a step of ``h`` (s), for error and excess held over it; exact."""
        return self._spread(*zero_order_hold(*self.design.matrices(), h))

    def _spread(self, A: Array, B: Array) -> tuple[Array, Array]:
        """From one axis to all, and from the excess of the forces, which the static gain of the notch turns."""
        one, back = np.eye(3), np.linalg.inv(self.notch.stiffness)  # N to rad
        return np.asarray(np.kron(A, one)), np.asarray(np.hstack([np.kron(B, one), -np.kron(B, back)]))

    def response(self, s: ArrayLike) -> Complex:
        """From error (rad, P) to fine force (N), (..., 3, 3)."""
        return np.asarray(self.notch.response(s) * self.design.response(s)[..., None, None])


@dataclass(frozen=True, eq=False)
class PointingLaw:
    """What the controller knows of mechanism and payload, which may differ from the plant's, and its design.

    Its scalars are parameters of the FMU.
    """

    manipulator: Manipulator = group(flat=True, keep=is_known)
    payload: Payload = group()
    loop: LoopDesign = group()

    @classmethod
    def from_parameters(cls, p: Parameters, design: LoopDesign = DEFAULT_DESIGN) -> PointingLaw:
        """The law of a parameter set; it knows the payload as the isolator does."""
        return cls(p.manipulator, known_payload(p), design)

    def with_design(self, design: LoopDesign) -> PointingLaw:
        """The same mechanism with another design."""
        return replace(self, loop=design)

    def controller(self, orientation: Array) -> PointingFilter:
        """The controller for a nominal orientation (3,), roll, pitch, yaw, rad.

        Raises
        ------
        UnreachableOrientationError: the three fine legs cannot meet at this orientation.
        """
        return PointingFilter(self.notch(nominal_pose(self.manipulator, orientation)), self.loop)

    def notch(self, pose: Pose) -> Notch:
        """The notch at a pose."""
        m = self.manipulator
        J = jacobians(m.geometry, pose.translation_B, pose.rotation_BP)
        mass, _ = find_fine_mass(m, self.payload, pose, J)
        to_elongation = np.linalg.inv(pose.rotation_BP.T @ J.J_theta_f)  # from rotation in P
        damping, stiffness = (
            np.array([[getattr(leg, name)] for leg in m.fine_legs]) for name in ("damping", "stiffness")
        )
        return Notch(mass @ to_elongation, damping * to_elongation, stiffness * to_elongation)

    def pack(self, limit: float, **places: int) -> PointingWords:
        """What the steps in C take: the force limit, N, and places in the buffer; no gains are kept yet."""
        A, B = self.loop.matrices()
        filtering, arrays = pack_filter(A, np.hstack([B, A[:, :1] * np.eye(4)[:, 3:]]))
        mechanism = pack_mechanism(self.manipulator, self.payload)
        words = PointingWords(mechanism, filtering, (c_double * 4)(*A[3]), limit, **places)
        words.arrays = arrays
        return words


class PointingWords(ctypes.Structure):
    """``Pointing`` of ``native/control/pointing.c``."""

    _fields_ = (
        ("mechanism", c_double * N_MECHANISM), ("filter", AxisFilter), ("acceleration", c_double * 4),
        ("limit", c_double),
        *((name, c_int64) for name in (
            "orientation", "kept_orientation", "error", "states", "unlimited", "locked", "enabled", "forces",
        )),
        ("gains", c_double * 27),
    )  # fmt: skip

    arrays: list[Array]
    """What the words point to."""
