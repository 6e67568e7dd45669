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

**Kinetic energy of the six legs** in terms of platform and base motion (Appendix A).  Each leg is two slender parts on
one line, joined by the actuator: the upper part hangs from the platform joint, the lower part from the base joint, and
both turn with the leg.  Written for the telescoping leg, equations (A17)-(A25) serve all six: for a coarse leg, whose
actuator is locked, the velocities of its ends along the leg are equal, and the expressions become the paper's for one
rigid body whose centre of mass and inertia follow from the two parts at the leg's CURRENT length (the printed, constant
values are off by 3-13 % near resonance when a coarse leg extends).  The same expressions stay right when a coarse rod
stretches.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray

from .compiled import Mechanism, leg_moments
from .kinematics import Geometry, Jacobians, LegLines, find_leg_lines, jacobians, leg_rows
from .modes import BusMode, PayloadMode, TrussMode, drop_unused
from .parameters import Bus, CoarseLeg, Manipulator, Payload
from .quantities import Array
from .rotations import skew

#: Groups of coordinates that :func:`assemble` can leave out.
GROUPS = ("d_f", "q_b", "x_m", "e_c", "x_t")

Legs = tuple[CoarseLeg, ...]

TWO_PI = 2.0 * np.pi
_EYE = np.eye(3)
_SIGNS = np.array([[1.0, -1.0], [-1.0, 1.0]])


@dataclass(frozen=True, eq=False)
class LegMass:
    """The blocks of eq (21) and (A16), each (..., 6, 6), for twists (translation, rotation) in B axes.

    Twice the kinetic energy of the legs is ``vp' alpha vp + 2 vp' alpha_beta vb + vb' beta vb`` with ``vp`` the
    twist of P at its origin and ``vb`` that of B at its origin.
    """

    alpha: Array
    alpha_beta: Array
    beta: Array
    points: Array
    """(..., 36, 12): velocities of both ends of each leg, platform joint first, from ``[vp, vb]``; eq (A5)."""
    forces: Array
    """(..., 36, 12): generalised forces by accelerations of these points that leave the legs' directions at rest.

    ``points' @ forces`` are the blocks together.
    """

    def __getitem__(self, k: int) -> LegMass:
        """At one pose of many."""
        return LegMass(self.alpha[k], self.alpha_beta[k], self.beta[k], self.points[k], self.forces[k])


def leg_mass(legs: Legs, geometry: Geometry, translation_B: Array, rotation_BP: Array) -> LegMass:
    """Mass blocks of the legs at a pose, eqs (A17)-(A25).

    Parameters
    ----------
    legs: the six legs, coarse 1..3 then fine 1..3.
    geometry: their joints.
    translation_B, rotation_BP: the pose, (3,) m and (3, 3).
    """
    lines = find_leg_lines(geometry, translation_B, rotation_BP)
    rows = leg_rows(lines.arms_B, lines.n_B), leg_rows(geometry.base_joints_B, lines.n_B)
    return _leg_mass(legs, geometry, lines, *rows)


def leg_mass_on(legs: Legs, geometry: Geometry, J: Jacobians) -> LegMass:
    """As :func:`leg_mass`, at the pose of Jacobians."""
    return _leg_mass(legs, geometry, J.legs, J.J_lp, J.J_lb)


def _leg_mass(legs: Legs, geometry: Geometry, lines: LegLines, J_lp: Array, J_lb: Array) -> LegMass:
    """The projection at right angles to a leg (A8) is the identity without ``n n'``; ``n' J_p`` is a row of J_lp."""
    _, _, second = leg_moments(legs)
    length, batch = lines.length, lines.length.shape[:-1]
    turning = (second[:, 0] / length**2)[..., None, None]
    # Masses of the two ends, what is at right angles to the leg alone: (A19), (A22), and minus (A25) beside them.
    across = _SIGNS * (turning - _add_moments(legs) / length[..., None, None])
    whole = across + _place_masses(legs)
    points, along = np.zeros((*batch, 6, 2, 3, 12)), np.zeros((*batch, 6, 2, 12))
    points[..., 0, :, :6] = lines.platform_points.reshape(*batch, 6, 3, 6)  # J_p and J_b of (A5)
    points[..., 1, :, 6:] = geometry.base_points.reshape(6, 3, 6)
    along[..., 0, :6], along[..., 1, 6:] = J_lp, J_lb
    forces = (whole @ points.reshape(*batch, 6, 2, 36)).reshape(points.shape)
    forces -= lines.n_B[..., None, :, None] * (across @ along)[..., None, :]
    points, forces = points.reshape(*batch, 36, 12), forces.reshape(*batch, 36, 12)
    blocks = points.mT @ forces
    return LegMass(blocks[..., :6, :6], blocks[..., :6, 6:], blocks[..., 6:, 6:], points, forces)  # (A17), (A23), (A20)


@lru_cache(maxsize=8)
def _add_moments(legs: Legs) -> Array:
    """(legs, 2, 2) kg.m: sums of the first moments of the parts at two ends, the upper one first."""
    _, first, _ = leg_moments(legs)
    upper, lower = (moment[:, 0] for moment in first)
    return np.array([[2.0 * upper, upper + lower], [upper + lower, 2.0 * lower]]).transpose(2, 0, 1)


@lru_cache(maxsize=8)
def _place_masses(legs: Legs) -> Array:
    """(legs, 2, 2) kg: the parts as points at their joints, the upper one first."""
    return np.array([np.diag(masses) for masses in np.hstack(leg_moments(legs)[0])])


@dataclass(frozen=True, eq=False)
class Pose:
    """A pose of the platform relative to the base, or many."""

    translation_B: Array  # (..., 3), origin of P in B, m
    rotation_BP: Array  # (..., 3, 3), maps components in P to components in B

    def __getitem__(self, k: int) -> Pose:
        """One pose of many."""
        return Pose(self.translation_B[k], self.rotation_BP[k])


@dataclass(frozen=True, eq=False)
class Dynamics:
    """``M q'' + C q' + K q = E_f f_f + E_b w_b - m_c s''`` about a pose, ``q`` as in the module's text.

    ``n`` is the number of coordinates.  Coordinates of modes that are switched off (frequency or stiffness zero)
    keep their place: ``active`` is False there and their rows and columns are to be left out.  Many poses at once give
    leading dimensions to what depends on the pose.
    """

    pose: Pose
    jacobians: Jacobians
    system: FlexibleSystem
    M: Array  # (..., n, n) kg, kg.m, ...
    C: Array  # (..., n, n)
    K: Array  # (n, n)
    m_c: Array  # (..., n, 3) inertial coupling of a prescribed coarse-leg motion s
    locked: Array  # (..., 6, 6) mass of legs and payload as one body on the base, B axes at its origin
    active: NDArray[np.bool_]  # (n,)
    slices: dict[str, slice]  # group -> its place in q

    def __getitem__(self, k: int) -> Dynamics:
        """At one pose of many."""
        by_pose = self.pose[k], self.jacobians[k], self.system, self.M[k], self.C[k], self.K
        return Dynamics(*by_pose, self.m_c[k], self.locked[k], self.active, self.slices)

    @cached_property
    def legs(self) -> LegMass:
        """Of the legs alone."""
        manipulator = self.system.manipulator
        return leg_mass_on(manipulator.coarse_legs + manipulator.fine_legs, manipulator.geometry, self.jacobians)

    @property
    def n(self) -> int:
        """Number of coordinates, inactive ones included."""
        return len(self.active)

    @property
    def moving_modes(self) -> NDArray[np.bool_]:
        """(n,) which coordinates are active modes of bus or payload."""
        return _find_modes(self.active.tobytes(), *(self.slices[group].start for group in ("x_m", "e_c", "x_t")))

    def base_places(self) -> tuple[slice, slice]:
        """Places of the base's translation and rotation in ``q``."""
        first = self.slices["q_b"].start
        return slice(first, first + 3), slice(first + 3, first + 6)

    def platform_rows(self) -> Array:
        """Twist of the platform (t_p, theta_p), B axes, from the coordinates; eqs (8), (24) with plus signs.

        (..., 6, n)
        """
        return self._platform_rows

    @cached_property
    def _platform_rows(self) -> Array:
        return _make_platform_rows(self.jacobians, self.slices)


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
    """The full model at one pose, see :class:`FlexibleSystem`."""
    return FlexibleSystem(manipulator, payload, bus).at(pose)


@dataclass(frozen=True, eq=False)
class FlexibleSystem:
    """Manipulator, payload and bus; what does not depend on the pose is made once.

    Modes with frequency or stiffness zero are inactive.
    """

    manipulator: Manipulator
    payload: Payload
    bus: Bus

    def at(self, pose: Pose, J: Jacobians | None = None) -> Dynamics:
        """The full model at a pose, or at many at once; ``J``: the Jacobians there, if they are known."""
        if J is None:
            J = jacobians(self.manipulator.geometry, pose.translation_B, pose.rotation_BP)
        C_fixed, K, active = self._fixed
        n, e_c, batch = self.n, self._slices["e_c"], J.J_pl.shape[:-2]
        M, m_c, locked = np.empty((*batch, n, n)), np.empty((*batch, n, 3)), np.empty((*batch, 6, 6))
        C = np.empty_like(M)
        C[:] = C_fixed
        for k in np.ndindex(batch):
            M[k], m_c[k], locked[k] = self._mechanism.find_masses(
                pose.translation_B[k], pose.rotation_BP[k], J.J_pl[k]
            )
            C[(*k, e_c, e_c)] = np.diag(self._mechanism.damp_rods(M[k]))
        return Dynamics(pose, J, self, M, C, K, m_c, locked, active, self._slices)

    @cached_property
    def _mechanism(self) -> Mechanism:
        return Mechanism(self.manipulator, self.payload, self.bus)

    @property
    def n(self) -> int:
        """Number of coordinates, inactive ones included."""
        return self._slices[GROUPS[-1]].stop

    @property
    def leg_moments(self) -> tuple[tuple[Array, Array], tuple[Array, Array], Array]:
        """See :func:`.dynamics.leg_moments`."""
        return self._leg_moments

    @cached_property
    def _leg_moments(self) -> tuple[tuple[Array, Array], tuple[Array, Array], Array]:
        return leg_moments(self._legs)

    @cached_property
    def legs_mass(self) -> float:
        """Mass of the six legs, kg."""
        upper, lower = self.leg_moments[0]
        return float(np.sum(upper) + np.sum(lower))

    @cached_property
    def _legs(self) -> Legs:
        return self.manipulator.coarse_legs + self.manipulator.fine_legs

    @property
    def bus_mass(self) -> Array:
        """(6, 6) mass matrix of the bus, see :func:`bus_mass`."""
        return bus_mass(self.bus)

    def modes_at(self, rotation_BP: Array) -> tuple[Array, Array, Array, Array]:
        """Masses (n,) of the modes of the payload, kg; places from the origin of P, directions, moments.

        (..., n, 3) each, m, 1 and m, axes of B; see :class:`.modes.ModeOnPayload`.
        """
        mass, position_P, direction_P, moment_P = self._on_payload
        R_PB = rotation_BP.mT
        return mass, position_P @ R_PB, direction_P @ R_PB, moment_P @ R_PB

    def find_turns(self, sensitivity: float) -> Array:
        """(2, n) turn of the line of sight about x and y of P, rad per unit of each coordinate of ``x_t``.

        ``sensitivity``: of the truss modes, see :class:`.parameters.Optics`.
        """
        turns = [mode.place_on_payload(sensitivity).line_of_sight for mode in self._payload_modes]
        return np.reshape(turns, (-1, 2)).T

    @cached_property
    def _slices(self) -> dict[str, slice]:
        n_bus, n_payload = len(self._bus_modes), len(self._payload_modes)
        return _places({"d_f": 3, "q_b": 6, "x_m": n_bus, "e_c": 3, "x_t": n_payload})

    @cached_property
    def _bus_modes(self) -> Sequence[BusMode]:
        return drop_unused(self.bus.modes)

    @cached_property
    def _payload_modes(self) -> Sequence[TrussMode | PayloadMode]:
        return drop_unused((*self.payload.truss_modes, *self.payload.modes))

    @cached_property
    def _on_payload(self) -> tuple[Array, Array, Array, Array]:
        """Mass (n,) kg, position (n, 3) m, direction (n, 3) and moment (n, 3) m of the payload's modes, in P."""
        modes = [mode.place_on_payload(0.0) for mode in self._payload_modes]
        position, direction, moment = (
            np.reshape([getattr(mode, name) for mode in modes], (-1, 3))
            for name in ("position_P", "direction_P", "moment_P")
        )
        return np.array([mode.mass for mode in modes]), position, direction, moment

    @cached_property
    def _fixed(self) -> tuple[Array, Array, NDArray[np.bool_]]:
        """C without the rods, K, and which coordinates are active."""
        d_f, _, x_m, e_c, x_t = (self._slices[group] for group in GROUPS)
        n = x_t.stop
        C, K, active = np.zeros((n, n)), np.zeros((n, n)), np.ones(n, dtype=bool)
        for k, leg in enumerate(self.manipulator.fine_legs, d_f.start):
            K[k, k], C[k, k] = leg.stiffness, leg.damping
        masses = self._on_payload[0].tolist()
        modes = [*zip(self._bus_modes, len(self._bus_modes) * [1.0], strict=True)]
        for first, own in ((x_m.start, modes), (x_t.start, [*zip(self._payload_modes, masses, strict=True)])):
            for k, (mode, mass) in enumerate(own, first):
                omega = TWO_PI * mode.frequency
                C[k, k], K[k, k] = 2.0 * mode.damping_ratio * omega * mass, omega**2 * mass
                active[k] = mode.active
        stiffness = self.manipulator.coarse_rods.axial_stiffness
        for k in range(e_c.start, e_c.stop):
            K[k, k] = stiffness
        active[e_c] = stiffness > 0.0
        for shared in (K, active):
            shared.setflags(write=False)
        return C, K, active


@lru_cache(maxsize=8)
def _find_modes(active: bytes, bus: int, rods: int, truss: int) -> NDArray[np.bool_]:
    """Of :attr:`Dynamics.moving_modes`, by the first places of the groups of coordinates."""
    moving = np.frombuffer(active, dtype=bool).copy()
    moving[:bus] = moving[rods:truss] = False
    return moving


def _make_platform_rows(J: Jacobians, slices: dict[str, slice]) -> Array:
    """See :meth:`Dynamics.platform_rows`."""
    rows = np.zeros((*J.J_pl.shape[:-1], slices[GROUPS[-1]].stop))
    rows[..., slices["d_f"]], rows[..., slices["q_b"]], rows[..., slices["e_c"]] = J.J_pf, J.J_pb, J.J_pc
    return rows


def _places(sizes: dict[str, int]) -> dict[str, slice]:
    places, start = {}, 0
    for group, size in sizes.items():
        places[group] = slice(start, start + size)
        start += size
    return places
