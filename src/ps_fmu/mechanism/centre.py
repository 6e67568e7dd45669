"""What a linear model of the plant is made about: a configuration and the speeds there; how a run begins."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import accumulate

import numpy as np

from .quantities import Array, Checked, ParameterError, quantity
from .rotations import IDENTITY

_SIZES = {"coarse": 3, "fine": 3, "speeds": 9, "velocity_B": 3, "position_B": 3, "rotation_B": 3, "attitude": 4}

#: Numbers that a :class:`Centre` is kept in.
N_CENTRE = sum(_SIZES.values())
_ENDS = accumulate(_SIZES.values())
_PLACES = [slice(end - size, end) for size, end in zip(_SIZES.values(), _ENDS, strict=True)]


@dataclass(frozen=True, eq=False)
class Centre:
    """A point that the motion passes through, or rests at.

    Models about the same centre are equal to the last bit.
    """

    coarse: Array
    """(3,) m, displacements of the coarse actuators."""
    fine: Array
    """(3,) m, elongations of the fine legs."""
    speeds: Array
    """(9,) of :mod:`.convection`: rates of the fine legs, angular velocity of B, rates of the coarse legs."""
    velocity_B: Array
    """(3,) m/s, of the origin of B, in B."""
    position_B: Array
    """(3,) m, of the origin of B since the start, in B."""
    rotation_B: Array
    """(3,) rad, integral of the angular velocity of B since the start, in B."""
    attitude: Array
    """(4,) quaternion from B to inertial axes at this ``rotation_B``."""

    @classmethod
    def at_rest(cls, coarse: Array, attitude: Array = IDENTITY) -> Centre:
        """Coarse legs at given displacements (3,), m; nothing else is displaced, and nothing moves."""
        zeros = {name: np.zeros(size) for name, size in _SIZES.items()}
        return cls(**{**zeros, "coarse": np.array(coarse, dtype=float), "attitude": np.array(attitude, dtype=float)})

    @classmethod
    def stack(cls, centres: Sequence[Centre]) -> Centre:
        """Many as one whose arrays have a first dimension more."""
        numbers = np.array([centre._join() for centre in centres])
        return cls(*(numbers[:, at] for at in _PLACES))

    @classmethod
    def read(cls, numbers: Array) -> Centre:
        """From N_CENTRE numbers, as :meth:`write` leaves them."""
        return cls(*(numbers[at].copy() for at in _PLACES))

    def write(self, numbers: Array) -> None:
        """Into N_CENTRE numbers, for the FMU state."""
        numbers[:] = self._join()

    def _join(self) -> Array:
        return np.concatenate([getattr(self, name) for name in _SIZES])


#: Largest difference from 1 of the norm of a quaternion: as much as three digits leave.
_ROUGHLY_UNIT = 0.01
#: Fastest turn that is taken, rad/s: far beyond any spacecraft.
_FASTEST = 100.0


@dataclass(frozen=True, eq=False)
class InitialMotion(Checked):
    """Attitude and angular velocity of the base at the start; the common centre of mass is at rest."""

    initial_attitude: Array = quantity(
        "1", "Attitude of B at the start, unit quaternion, scalar first, to inertial axes", shape=(4,)
    )
    initial_angular_velocity_B: Array = quantity(
        "rad/s", "Angular velocity of B at the start, relative to inertial space, in B", shape=(3,)
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        norm = float(np.linalg.norm(self.initial_attitude))
        if not abs(norm - 1.0) <= _ROUGHLY_UNIT:
            raise ParameterError(
                "initial_attitude", f"expected a unit quaternion (w, x, y, z), got one of norm {norm:.6g}"
            )
        fastest = float(np.abs(self.initial_angular_velocity_B).max())
        if fastest > _FASTEST:
            raise ParameterError("initial_angular_velocity", f"must be within +-{_FASTEST:g} rad/s, got {fastest:g}")

    @property
    def unit_attitude(self) -> Array:
        """(4,) the attitude, of norm 1."""
        return np.asarray(self.initial_attitude / np.linalg.norm(self.initial_attitude))


#: At rest, with the axes of B along the inertial ones.
STILL = InitialMotion(IDENTITY, np.zeros(3))
