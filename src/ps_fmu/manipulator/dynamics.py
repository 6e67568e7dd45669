"""Linearised dynamics of manipulator, payload and bus about a pose: coordinates, masses, stiffness, damping.

Coordinates, in this order (:data:`GROUPS`)::

    d_f  fine-leg elongation (3)            m      eq 4
    q_b  base motion (t_b, theta_b) (6)     m, rad in B axes, at the origin of B, eq 5
    x_m  bus modes (n)                      mass-normalised, eq 25
    e_c  coarse-rod stretch (3)             m      not in the paper's nominal model
    x_t  truss modes (n)                    m      not in the paper's nominal model

The nominal model of the paper is the first three groups.  With the corrected sign of eq (8), the platform moves
by ``dq_p = J_pf dd_f + J_pc dd_c + J_pb dq_b``; a prescribed coarse-leg motion enters through the same column as
the stretch of its rod.  Centrifugal and Coriolis terms are neglected, as in the paper.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .kinematics import Jacobians, jacobians
from .legs import LegMass, leg_mass
from .parameters import Bus, Manipulator, Payload
from .rotations import skew

Array = NDArray[np.float64]

TWO_PI = 2.0 * np.pi

#: Groups of coordinates that :func:`assemble` can leave out.
GROUPS = ("d_f", "q_b", "x_m", "e_c", "x_t")


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
    legs: LegMass
    M: Array  # (n, n) kg, kg.m, ...
    C: Array  # (n, n)
    K: Array  # (n, n)
    m_c: Array  # (n, 3) inertial coupling of a prescribed coarse-leg motion s
    active: NDArray[np.bool_]  # (n,)
    slices: dict[str, slice]  # group -> its place in q

    @property
    def n(self) -> int:
        """Number of coordinates, inactive ones included."""
        return len(self.active)

    def platform_rows(self) -> Array:
        """(6, n): twist of the platform (t_p, theta_p), B axes, from the coordinates; eqs (8), (24) with plus signs."""
        rows = np.zeros((6, self.n))
        rows[:, self.slices["d_f"]] = self.jacobians.J_pf
        rows[:, self.slices["q_b"]] = self.jacobians.J_pb
        rows[:, self.slices["e_c"]] = self.jacobians.J_pc
        return rows


def rigid_body_mass(mass: float, com: Array, inertia_com: Array) -> Array:
    """(6, 6) mass matrix of a rigid body about a frame's origin, eqs (20), (23).

    ``com`` (3,) and ``inertia_com`` (3, 3, about the centre of mass) are in the axes of the result.
    """
    rho = skew(com)
    return np.block([[mass * np.eye(3), -mass * rho], [mass * rho, inertia_com - mass * rho @ rho]])


def payload_mass(payload: Payload, rotation_BP: Array) -> Array:
    """M_p of eq (20), (6, 6), B axes at the origin of P."""
    return rigid_body_mass(payload.mass, rotation_BP @ payload.com_P, rotation_BP @ payload.inertia_P @ rotation_BP.T)


def bus_mass(bus: Bus) -> Array:
    """M_b of eq (23), (6, 6), B axes at the origin of B."""
    return rigid_body_mass(bus.mass, bus.com_B, bus.inertia_B)


def assemble(manipulator: Manipulator, payload: Payload, bus: Bus, pose: Pose) -> Dynamics:
    """The full model at a pose; modes with frequency or stiffness zero are inactive."""
    J = jacobians(manipulator.geometry, pose.translation_B, pose.rotation_BP)
    legs = leg_mass(
        manipulator.coarse_legs + manipulator.fine_legs,
        manipulator.geometry,
        pose.translation_B,
        pose.rotation_BP,
    )
    n_bus, n_truss = len(bus.modes), len(payload.truss_modes)
    slices = _places({"d_f": 3, "q_b": 6, "x_m": n_bus, "e_c": 3, "x_t": n_truss})
    n = slices["x_t"].stop
    d_f, q_b, x_m, e_c, x_t = (slices[group] for group in GROUPS)

    # Platform and base twist from q, then the quadratic forms of eqs (20)-(23).
    platform, base = np.zeros((6, n)), np.zeros((6, n))
    platform[:, d_f], platform[:, q_b], platform[:, e_c] = J.J_pf, J.J_pb, J.J_pc
    base[:, q_b] = np.eye(6)
    M_p = payload_mass(payload, pose.rotation_BP)
    cross = platform.T @ legs.alpha_beta @ base
    M = platform.T @ (M_p + legs.alpha) @ platform + cross + cross.T + base.T @ (bus_mass(bus) + legs.beta) @ base
    C, K = np.zeros((n, n)), np.zeros((n, n))
    active = np.ones(n, dtype=bool)

    for i, leg in enumerate(manipulator.fine_legs):
        K[i, i], C[i, i] = leg.stiffness, leg.damping
    for i, mode in enumerate(bus.modes):
        k = x_m.start + i
        omega = TWO_PI * mode.frequency
        M[q_b, k] = M[k, q_b] = mode.participation_B  # M_b12
        M[k, k], C[k, k], K[k, k] = 1.0, 2.0 * mode.damping_ratio * omega, omega**2
        active[k] = mode.active
    for i, truss in enumerate(payload.truss_modes):
        k = x_t.start + i
        omega = TWO_PI * truss.frequency
        # The mass moves with the platform and along its own direction: a point mass in the quadratic form.
        arm_B = pose.rotation_BP @ truss.position_P
        along_B = pose.rotation_BP @ (truss.direction_P / np.linalg.norm(truss.direction_P))
        M[:, k] += truss.mass * (np.hstack([along_B, np.cross(arm_B, along_B)]) @ platform)
        M[k, :] = M[:, k]
        M[k, k], C[k, k], K[k, k] = (
            truss.mass,
            2.0 * truss.damping_ratio * omega * truss.mass,
            omega**2 * truss.mass,
        )
        active[k] = truss.active
    m_c = M[:, e_c].copy()
    rods = manipulator.coarse_rods
    for k in range(e_c.start, e_c.stop):
        K[k, k] = rods.axial_stiffness
        C[k, k] = 2.0 * rods.damping_ratio * np.sqrt(rods.axial_stiffness * M[k, k])
        active[k] = rods.axial_stiffness > 0.0
    return Dynamics(pose, J, legs, M, C, K, m_c, active, slices)


def _places(sizes: dict[str, int]) -> dict[str, slice]:
    places, start = {}, 0
    for group, size in sizes.items():
        places[group] = slice(start, start + size)
        start += size
    return places
