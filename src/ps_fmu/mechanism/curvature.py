"""What a linear model leaves out along the way that is expected, as parabolas in time.

A model about a centre is exact there.  At both ends of the expected way (:class:`.slews.Way`) the models about these
two points are exact, too.  So the difference is known at three instants ``-T, 0, T`` from the centre, and the parabola
through them is added to rates and outputs, with ``z`` on the way::

    x' = A x + B u + b1 t + b2 t**2        b1 T = (r(T) - r(-T)) / 2,    b2 T**2 = (r(T) + r(-T)) / 2
    r(t) = (A_t - A) z(t) + (B_t - B) u

and for y alike.  This is exponential quadrature with three nodes for what is not linear (M. Hochbruck and A. Ostermann,
Exponential integrators, Acta Numerica 19, 2010, section 2).  Ways are some ten times as long as without.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from .centre import Centre
from .convection import COARSE
from .linear_model import Matrices, PlantModel, find_state
from .quantities import Array
from .signals import N_OUTPUTS, TIME, count_states, servo_slices
from .slews import Way, find_attitude, find_centre

#: Positions and rates that are watched on the way.
N_PATH = 12


@dataclass(frozen=True, eq=False)
class Curve:
    """What is expected of a linear model, and what time adds to it."""

    half: Array
    """(1,) s, from the start of the way to its middle, the centre; zero: there is no way, the centre is the place."""
    path: Array
    """(N_PATH, 3): fine elongations (m), rotation of B (rad), displacements and rates of the coarse legs (m, m/s);
    factors of 1, time (s) from the centre and its square."""
    added: Array
    """(states and outputs, 2) to ``x'`` and ``y``: factors of time and its square."""

    @classmethod
    def read(cls, numbers: Array, n: int) -> Curve:
        """From :func:`count_curve` numbers, as :meth:`write` leaves them; ``n`` coordinates."""
        half, path, added = np.split(numbers.copy(), np.cumsum([1, 3 * N_PATH]))
        return cls(half, path.reshape(N_PATH, 3), added.reshape(count_states(n) + N_OUTPUTS, 2))

    def write(self, numbers: Array) -> None:
        """Into :func:`count_curve` numbers, for the FMU state."""
        numbers[:1], numbers[1 : 1 + 3 * N_PATH] = self.half, self.path.ravel()
        numbers[1 + 3 * N_PATH :] = self.added.ravel()


def count_curve(n: int) -> int:
    """Numbers that a :class:`Curve` is kept in, for ``n`` coordinates."""
    return 1 + 3 * N_PATH + 2 * (count_states(n) + N_OUTPUTS)


def places_on_path(model: PlantModel) -> NDArray[np.intp]:
    """(N_PATH,) places in the state of what :attr:`Curve.path` follows."""
    return _find_places(model.dynamics.n, model.dynamics.slices["d_f"].start, model.dynamics.base_places()[1].start)


@lru_cache(maxsize=8)
def _find_places(n: int, fine: int, rotation: int) -> NDArray[np.intp]:
    s, ds, _ = servo_slices(n)
    places = np.concatenate([np.arange(first, first + 3) for first in (fine, rotation, s.start, ds.start)])
    places.setflags(write=False)
    return places


def stay(model: PlantModel, half: float = 0.0) -> Curve:
    """Of a model that serves near its centre; after twice ``half``, s, unless that is zero, it is looked at again."""
    path = np.zeros((N_PATH, 3))
    path[:, 0] = find_state(model.centre, model.dynamics)[places_on_path(model)]
    path[9:, 0] = model.centre.speeds[COARSE]
    return Curve(np.array([half]), path, np.zeros((model.n_states + N_OUTPUTS, 2)))


def find_ends(model: PlantModel, centre: Centre, way: Way) -> tuple[Centre, Centre]:
    """Centres at the start and at the end of the way with the middle ``centre``; ``model``: any of the same plant."""
    at_start, at_end = (
        find_centre(model, z, find_attitude(model, z, time, centre))
        for z, time in ((way.start, -way.half), (way.end, way.half))
    )
    return at_start, at_end


def find_curve(model: PlantModel, ends: Sequence[Matrices], way: Way, u: Array) -> Curve:
    """Of a model about the middle of the way, with those about its two ends, see :func:`find_ends`.

    ``u``: inputs while the way is gone, whatever they say of time.
    """
    u, half = u.copy(), way.half
    u[TIME] = 0.0
    about, places = model.matrices(), places_on_path(model)
    at_start, at_end = (_find_rest(about, there, z, u) for there, z in zip(ends, (way.start, way.end), strict=True))
    start, middle, end = way.start[places], way.middle[places], way.end[places]
    path, added = np.empty((N_PATH, 3)), np.empty((len(at_start), 2))
    path[:, 0] = middle
    _fit(start - middle, end - middle, half, path[:, 1:])
    _fit(at_start, at_end, half, added)
    return Curve(np.array([half]), path, added)


def _fit(at_start: Array, at_end: Array, half: float, factors: Array) -> None:
    """Factors of time and its square, (n, 2), from values at -half and half, s."""
    factors[:, 0] = 0.5 * (at_end - at_start) / half
    factors[:, 1] = 0.5 * (at_end + at_start) / half**2


def _find_rest(about: Matrices, there: Matrices, z: Array, u: Array) -> Array:
    """(states and outputs,) what the model ``about`` leaves out at a state ``z``, by the one about it."""
    A, B, C, D = (near - far for near, far in zip(there, about, strict=True))
    return np.concatenate([A @ z + B @ u, C @ z + D @ u])
