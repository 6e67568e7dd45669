"""Linearised dynamics of manipulator, payload and bus about a pose: coordinates, masses, stiffness, damping.

Coordinates, in this order (:data:`GROUPS`)::

    d_f  fine-leg elongation (3)            m      eq 4
    q_b  base motion (t_b, theta_b) (6)     m, rad in B axes, at the origin of B, eq 5
    x_m  bus modes (n)                      mass-normalised, eq 25
    e_c  coarse-rod stretch (3)             m      not in the paper's nominal model
    x_t  truss modes, payload modes (n)     m, sqrt(kg).m   not in the paper's nominal model

Unused places for modes behind the last one that moves have no coordinates.

The nominal model of the paper is the first three groups.  With the corrected sign of eq (8), the platform moves
by ``dq_p = J_pf dd_f + J_pc dd_c + J_pb dq_b``; a prescribed coarse-leg motion enters through the same column as
the stretch of its rod.  Centrifugal and Coriolis terms are neglected, as in the paper.

The masses are those of the mechanism in any motion (:mod:`.equations`).  **Kinetic energy of the six legs** (Appendix
A): each leg is two slender parts on one line, joined by the actuator: the upper part hangs from the platform joint, the
lower part from the base joint, and both turn with the leg.  Written for the telescoping leg, equations (A17)-(A25)
serve all six: for a coarse leg, whose actuator is locked, the expressions become the paper's for one rigid body whose
centre of mass and inertia follow from the two parts at the leg's CURRENT length (the printed, constant values are off
by 3-13 % near resonance when a coarse leg extends).
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import accumulate

import numpy as np
from numpy.typing import NDArray

from .compiled import Mechanism
from .kinematics import Jacobians, jacobians
from .parameters import Bus, Manipulator, Payload
from .quantities import Array
from .rotations import skew

#: Groups of coordinates that :func:`assemble` can leave out.
GROUPS = ("d_f", "q_b", "x_m", "e_c", "x_t")

_EYE = np.eye(3)


@dataclass(frozen=True, eq=False)
class Pose:
    """A pose of the platform relative to the base."""

    translation_B: Array  # (3,), origin of P in B, m
    rotation_BP: Array  # (3, 3), maps components in P to components in B


@dataclass(frozen=True, eq=False)
class Dynamics:
    """``M q'' + C q' + K q = E_f f_f + E_b w_b - m_c s''`` about a pose, ``q`` as in the module's text.

    ``n`` is the number of coordinates.  Coordinates of modes that are switched off (frequency or stiffness zero)
    keep their place: ``active`` is False there and their rows and columns are to be left out.
    """

    pose: Pose
    jacobians: Jacobians
    M: Array  # (n, n) kg, kg.m, ...
    C: Array  # (n, n)
    K: Array  # (n, n)
    m_c: Array  # (n, 3) inertial coupling of a prescribed coarse-leg motion s
    locked: Array  # (6, 6) mass of legs and payload as one body on the base, B axes at its origin
    active: NDArray[np.bool_]  # (n,)
    slices: dict[str, slice]  # group -> its place in q

    @classmethod
    def of(cls, mechanism: Mechanism, pose: Pose, J: Jacobians) -> Dynamics:
        """Of a mechanism at a pose, with the Jacobians there."""
        M, m_c, locked = mechanism.find_masses(pose.translation_B, pose.rotation_BP, J.J_pl)
        mechanism.damp_rods(M)
        stiffness, damping, active = mechanism.describe_coordinates()
        sizes = (3, 6, mechanism.struct.n_bus, 3, mechanism.struct.n_payload)
        slices = {
            group: slice(end - size, end) for group, size, end in zip(GROUPS, sizes, accumulate(sizes), strict=True)
        }
        return cls(pose, J, M, np.diag(damping), np.diag(stiffness), m_c, locked, active, slices)

    @property
    def n(self) -> int:
        """Number of coordinates, inactive ones included."""
        return len(self.active)

    def base_places(self) -> tuple[slice, slice]:
        """Places of the base's translation and rotation in ``q``."""
        first = self.slices["q_b"].start
        return slice(first, first + 3), slice(first + 3, first + 6)

    def platform_rows(self) -> Array:
        """Twist of the platform (t_p, theta_p), B axes, from the coordinates; eqs (8), (24) with plus signs.

        (6, n)
        """
        rows, J = np.zeros((6, self.n)), self.jacobians
        rows[:, self.slices["d_f"]], rows[:, self.slices["q_b"]], rows[:, self.slices["e_c"]] = J.J_pf, J.J_pb, J.J_pc
        return rows


def rigid_body_mass(mass: float, com: Array, inertia_com: Array) -> Array:
    """(..., 6, 6) mass matrix of a rigid body about a frame's origin, eqs (20), (23).

    ``com`` (..., 3) and ``inertia_com`` (..., 3, 3, about the centre of mass) are in the axes of the result.
    """
    rho = skew(com)
    moment = mass * rho
    M = np.empty((*com.shape[:-1], 6, 6))
    M[..., :3, :3], M[..., :3, 3:] = mass * _EYE, -moment
    M[..., 3:, :3], M[..., 3:, 3:] = moment, inertia_com - moment @ rho
    return M


def payload_mass(payload: Payload, rotation_BP: Array) -> Array:
    """M_p of eq (20), (..., 6, 6), B axes at the origin of P."""
    return rigid_body_mass(payload.mass, rotation_BP @ payload.com_P, rotation_BP @ payload.inertia_P @ rotation_BP.mT)


def bus_mass(bus: Bus) -> Array:
    """M_b of eq (23), (6, 6), B axes at the origin of B."""
    return rigid_body_mass(bus.mass, bus.com_B, bus.inertia_B)


def find_fine_mass(manipulator: Manipulator, payload: Payload, pose: Pose, J: Jacobians) -> tuple[Array, Array]:
    """Inertial forces along the fine legs by their own accelerations (3, 3), and by those of the base (3, 6).

    ``J``: the Jacobians at the pose.  All modes are held.
    """
    M, _, _ = Mechanism(manipulator, payload, None).find_masses(pose.translation_B, pose.rotation_BP, J.J_pl)
    return M[:3, :3], M[:3, 3:9]


def assemble(manipulator: Manipulator, payload: Payload, bus: Bus, pose: Pose) -> Dynamics:
    """The full model at one pose.

    Modes with frequency or stiffness zero are inactive.  Raises SingularPoseError.
    """
    J = jacobians(manipulator.geometry, pose.translation_B, pose.rotation_BP)
    return Dynamics.of(Mechanism(manipulator, payload, bus), pose, J)
