"""Flexible modes of payload and bus as parameters, hinged appendages, and what a body can carry of them.

A mode has the coordinate ``x`` and the participation ``p`` (6,), with its body held where it is mounted: ``m x'' + ...
= -p . (acceleration of the body)``.  ``p`` is the momentum of the body per unit of ``x'``, linear, then angular.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple, TypeVar

import numpy as np

from .quantities import Array, Checked, ParameterError, check_inertia, check_number, freeze, quantity
from .rotations import cross

_BORESIGHT_P = np.array([0.0, 0.0, 1.0])

#: Most hinge axes of an appendage: a body on a point has no more rotations.
MOST_AXES = 3
#: Places for modes in the FMU of the plant: an FMU cannot get parameters when it is loaded.
MOST_BUS_MODES, MOST_TRUSS_MODES, MOST_PAYLOAD_MODES = 16, 2, 12


class ModeOnPayload(NamedTuple):
    """A mode of the payload as a mass that moves with the platform and along a direction of its own.

    The participation about the origin of P is the mass times ``[direction; position x direction + moment]``.
    """

    mass: float  # kg
    position_P: Array  # (3,) m
    direction_P: Array  # (3,)
    moment_P: Array  # (3,) m
    line_of_sight: Array  # (2,) turn of the line of sight about x and y of P, rad per unit of the coordinate


@dataclass(frozen=True, eq=False)
class TrussMode(Checked):
    """A point mass on the payload (secondary mirror on its truss) that moves along one direction."""

    mass: float = quantity("kg", "Moving mass, part of the payload's mass", at_least=0.0)
    position_P: Array = quantity("m", "Position of the moving mass, in P", shape=(3,))
    direction_P: Array = quantity("1", "Direction of motion, in P", shape=(3,))
    frequency: float = quantity("Hz", "Natural frequency with the platform held; 0 = rigid", at_least=0.0)
    damping_ratio: float = quantity("1", "Damping ratio of the truss mode", at_least=0.0)

    def __post_init__(self) -> None:
        super().__post_init__()
        if np.linalg.norm(self.direction_P) < 1e-9:
            raise ParameterError("direction", "must not be the zero vector")

    @classmethod
    def unused(cls) -> TrussMode:
        """A mode in an unused place."""
        return cls(0.0, np.zeros(3), np.array([0.0, 0.0, 1.0]), 0.0, 0.0)

    @property
    def active(self) -> bool:
        """Whether it moves at all."""
        return self.frequency > 0.0 and self.mass > 0.0

    def participation_at(self, point_P: Array) -> Array:
        """Mass-normalised participation at a point of the payload (3,), m: (6,), sqrt(kg) and sqrt(kg).m, in P."""
        along_P = self.direction_P / np.linalg.norm(self.direction_P)
        arm_P = self.position_P - point_P
        return np.asarray(np.sqrt(self.mass) * np.concatenate([along_P, np.cross(arm_P, along_P)]))

    def place_on_payload(self, sensitivity: float) -> ModeOnPayload:
        """The mode on the payload.  ``sensitivity``: turn of the line of sight per motion across it, rad/m."""
        along_P = self.direction_P / np.linalg.norm(self.direction_P)
        turn_P = cross(_BORESIGHT_P, along_P * self.active)
        return ModeOnPayload(self.mass, self.position_P, along_P, np.zeros(3), sensitivity * turn_P[:2])


@dataclass(frozen=True, eq=False)
class PayloadMode(Checked):
    """A mass-normalised flexible mode of the payload, of its structure with the platform held."""

    frequency: float = quantity("Hz", "Natural frequency with the platform held; 0 = rigid", at_least=0.0)
    damping_ratio: float = quantity("1", "Damping ratio of the payload mode", at_least=0.0)
    participation_P: Array = quantity(
        "sqrt(kg)|sqrt(kg).m",
        "Participation at the origin of P, in P: translations t and rotations r",
        shape=(6,),
    )
    line_of_sight_x: float = quantity(
        "rad/(sqrt(kg).m)", "Rotation of the line of sight about x of P, per unit of the mode's coordinate"
    )
    line_of_sight_y: float = quantity(
        "rad/(sqrt(kg).m)", "Rotation of the line of sight about y of P, per unit of the mode's coordinate"
    )

    @classmethod
    def unused(cls) -> PayloadMode:
        """A mode in an unused place."""
        return cls(0.0, 0.0, np.zeros(6), 0.0, 0.0)

    @property
    def active(self) -> bool:
        """Whether it moves at all."""
        return self.frequency > 0.0

    def participation_at(self, point_P: Array) -> Array:
        """Participation at another point of the payload (3,), m: (6,), as ``participation_P``."""
        return move_participation(self.participation_P, point_P)

    def place_on_payload(self, sensitivity: float) -> ModeOnPayload:
        """The mode on the payload.  ``sensitivity`` is of truss modes alone."""
        direction_P, moment_P = self.participation_P[:3], self.participation_P[3:]
        turn = self.active * np.array([self.line_of_sight_x, self.line_of_sight_y])
        return ModeOnPayload(1.0, np.zeros(3), direction_P, moment_P, turn)


@dataclass(frozen=True, eq=False)
class BusMode(Checked):
    """A mass-normalised flexible mode of the bus (solar arrays): a column of M_b12 in eq 25, M_b22 = identity."""

    frequency: float = quantity("Hz", "Natural frequency with the bus held; 0 = rigid", at_least=0.0)
    damping_ratio: float = quantity("1", "Damping ratio of the bus mode", at_least=0.0)
    participation_B: Array = quantity(
        "sqrt(kg)|sqrt(kg).m",
        "Participation at the origin of B, in B: translations t and rotations r",
        shape=(6,),
    )

    @classmethod
    def unused(cls) -> BusMode:
        """A mode in an unused place."""
        return cls(0.0, 0.0, np.zeros(6))

    @property
    def active(self) -> bool:
        """Whether it moves at all."""
        return self.frequency > 0.0

    def participation_at(self, point_B: Array) -> Array:
        """Participation at another point of the bus (3,), m: (6,), as ``participation_B``."""
        return move_participation(self.participation_B, point_B)


M = TypeVar("M", TrussMode, PayloadMode, BusMode)
A = TypeVar("A", bound=TrussMode | PayloadMode | BusMode)


def move_participation(participation: Array, point: Array) -> Array:
    """Participation (6,) about a point (3,), m, from that about the origin."""
    translation, rotation = participation[:3], participation[3:]
    return np.concatenate([translation, rotation - np.cross(point, translation)])


def fill_places(name: str, modes: tuple[M, ...], kind: type[M], most: int) -> tuple[M, ...]:
    """The modes, and unused ones in the places that are left.  Raises ParameterError for more than ``most``."""
    if len(modes) > most:
        raise ParameterError(
            name,
            f"{len(modes)} modes, but the FMU of the plant holds {most}: leave out those that matter least, "
            "for example by their participation",
        )
    return modes + tuple(kind.unused() for _ in range(most - len(modes)))


def drop_unused(modes: Sequence[A]) -> Sequence[A]:
    """The modes up to the last one that moves: places behind it have no coordinates, and cost nothing."""
    return modes[: max((i for i, mode in enumerate(modes, 1) if mode.active), default=0)]


@dataclass(frozen=True, eq=False)
class Appendage(Checked):
    """A rigid body on the bus that turns about hinges with torsional springs: a solar array, an antenna.

    Angles ``phi_i`` about axes ``n_i`` through the hinge move its centre of mass by ``sum n_i phi_i x d``, ``d`` from
    the hinge to there.  With the bus at rest, ``J phi'' + k phi = 0``; a moving bus adds the rows of the momentum that
    the angles carry, the rigid-elastic coupling (P. W. Likins, JPL TR 32-1329, 1970; P. C. Hughes, Spacecraft Attitude
    Dynamics, 1986)::

        J_ij = n_i . I_h n_j                               I_h: inertia about the hinge
        k_i  = J_ii (2 pi f_i)^2
        p_i  = [m n_i x d;  I n_i + c x (m n_i x d)]       I about the centre of mass c, moments about the origin of B

    The modes of the bus are those of (J, k); their participation is that of their angles.
    """

    mass: float = quantity("kg", "Mass of the appendage", above=0.0)
    com_B: Array = quantity("m", "Centre of mass of the appendage, in B", shape=(3,))
    inertia_B: Array = quantity("kg.m2", "Inertia of the appendage about its centre of mass, in B")
    hinge_B: Array = quantity("m", "A point of the hinge axes, in B", shape=(3,))
    axis_B: Array = quantity("1", "Direction of the hinge axis, in B; for several axes a list of up to three")
    frequency: Array = quantity("Hz", "Natural frequency about each axis, bus and other axes held; above 0")
    damping_ratio: float = quantity("1", "Damping ratio of its modes", at_least=0.0)

    def __post_init__(self) -> None:
        super().__post_init__()
        self._set("inertia_B", check_inertia(self.inertia_B, "inertia"))
        several = isinstance(self.frequency, (list, tuple, np.ndarray)) and np.ndim(self.frequency) == 1
        count = len(self.frequency) if several else 1
        if not 1 <= count <= MOST_AXES:
            raise ParameterError("frequency", f"expected one for each of up to {MOST_AXES} axes, got {count}")
        for value in self.frequency if several else (self.frequency,):
            check_number(value, "frequency", above=0.0)
        self._set("frequency", np.reshape(np.array(self.frequency, dtype=float), count))
        axes = freeze(self.axis_B, (count, 3) if several else (3,), "axis").reshape(count, 3)
        lengths = np.linalg.norm(axes, axis=1)
        if not lengths.min() > 1e-9 or np.linalg.svd(axes / lengths[:, None])[1][-1] < 1e-6:
            raise ParameterError("axis", "must not be the zero vector, nor one of several that lie in a line or plane")
        self._set("axis_B", axes / lengths[:, None])

    def make_modes(self) -> tuple[BusMode, ...]:
        """The modes of the bus that stand for it, one for each axis, lowest frequency first."""
        arm_B, n = self.com_B - self.hinge_B, self.axis_B
        inertia_hinge_B = self.inertia_B + self.mass * (arm_B @ arm_B * np.eye(3) - np.outer(arm_B, arm_B))
        J = n @ inertia_hinge_B @ n.T
        k = np.diag(J) * (2.0 * np.pi * self.frequency) ** 2
        momentum = self.mass * np.cross(n, arm_B)
        per_angle = np.hstack([momentum, n @ self.inertia_B + np.cross(self.com_B, momentum)])
        # J = L L^T; the angles of a mode with modal mass one are L^-T times an eigenvector of L^-1 k L^-T.
        inverse = np.linalg.inv(np.linalg.cholesky(J))
        squares, vectors = np.linalg.eigh(inverse @ np.diag(k) @ inverse.T)
        participations = vectors.T @ inverse @ per_angle
        return tuple(
            BusMode(
                float(f"{np.sqrt(square) / (2.0 * np.pi):.12g}"),  # without the rounding of the eigenvalues
                self.damping_ratio,
                participation * np.sign(participation[np.argmax(np.abs(participation))]),
            )
            for square, participation in zip(squares, participations, strict=True)
        )


def join_bodies(bodies: Iterable[tuple[float, Array, Array]]) -> tuple[float, Array, Array]:
    """Mass (kg), centre of mass (3,) (m) and inertia about it (3, 3) (kg.m2) of rigid bodies joined together.

    Each body is given by the same three, in the same axes.
    """
    parts = list(bodies)
    mass = sum(m for m, _, _ in parts)
    com = sum((m * c for m, c, _ in parts), np.zeros(3)) / mass
    inertia = np.zeros((3, 3))
    for m, c, own in parts:
        arm = c - com
        inertia += own + m * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    return mass, com, inertia


def check_modal_mass(mass: float, inertia_com: Array, modes: Iterable[tuple[str, Array]]) -> None:
    """Refuse modes that move more mass than the body has: its mass matrix would be indefinite, its motion explode.

    Parameters
    ----------
    mass, inertia_com: of the whole body, kg, and (3, 3) about the centre of mass, kg.m2.
    modes: name of the entry to blame and mass-normalised participation (6,) at the centre of mass, sqrt(kg) and
        sqrt(kg).m.

    Raises
    ------
    ParameterError: names the first mode that leaves the body without mass or inertia in some direction.
    """
    left = np.zeros((6, 6))
    left[:3, :3], left[3:, 3:] = mass * np.eye(3), inertia_com
    scale = 1.0 / np.sqrt(np.outer(np.diag(left), np.diag(left)))
    for name, participation in modes:
        left -= np.outer(participation, participation)
        if not np.linalg.eigvalsh(left * scale)[0] > 1e-9:
            raise ParameterError(
                name,
                "too large: the modes so far would move more mass or inertia than the whole body has in some direction "
                "(its mass and inertia include what the modes move)",
            )
