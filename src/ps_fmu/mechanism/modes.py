"""Flexible modes of payload and bus as parameters, and what a body can carry of them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from .quantities import Array, Checked, ParameterError, quantity


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

    @property
    def active(self) -> bool:
        """Whether it moves at all."""
        return self.frequency > 0.0 and self.mass > 0.0

    def participation_at(self, point_P: Array) -> Array:
        """Mass-normalised participation at a point of the payload (3,), m: (6,), sqrt(kg) and sqrt(kg).m, in P."""
        along_P = self.direction_P / np.linalg.norm(self.direction_P)
        arm_P = self.position_P - point_P
        return np.asarray(np.sqrt(self.mass) * np.concatenate([along_P, np.cross(arm_P, along_P)]))


@dataclass(frozen=True, eq=False)
class BusMode(Checked):
    """A mass-normalised flexible mode of the bus (solar arrays): a column of M_b12 in eq 25, M_b22 = identity."""

    frequency: float = quantity("Hz", "Natural frequency with the bus held; 0 = rigid", at_least=0.0)
    damping_ratio: float = quantity("1", "Damping ratio of the bus mode", at_least=0.0)
    participation_B: Array = quantity(
        "sqrt(kg)|sqrt(kg).m", "Participation in B at its origin: three translations, then three rotations",
        shape=(6,),
    )

    @property
    def active(self) -> bool:
        """Whether it moves at all."""
        return self.frequency > 0.0

    def participation_at(self, point_B: Array) -> Array:
        """Participation at another point of the bus (3,), m: (6,), as ``participation_B``."""
        translation, rotation = self.participation_B[:3], self.participation_B[3:]
        return np.concatenate([translation, rotation - np.cross(point_B, translation)])


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
