"""Line-of-sight sensor: a fine guidance sensor or beacon tracker that looks along the boresight, z of P.

The attitudes of payload and target are unit quaternions (scalar first) that map components in P, or in the target's
frame, to inertial components.  The target seen from the payload is ``q = conj(q_P) q_T = (w, x, y, z)``; its line has
the direction ``d = R(q) e_z`` in P, and the small rotation e that takes the boresight there has::

    e_x = -d_y = 2 (w x - y z)        e_y = d_x = 2 (w y + x z)        e_z = 2 w z

d_x and d_y are the direction cosines that an image plane measures, so e_x and e_y hold for any roll about the line.
e_z is the roll to third order.  A change of sign of a quaternion changes nothing.  The line of sight may be turned
against the platform (truss modes): that rotation is subtracted.

Noise is white from sample to sample and independent of axis: a function of the sample's number and the seed alone.
"""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass
from enum import Enum
from functools import cached_property, reduce
from math import isnan, nan
from operator import add, mul

import numpy as np
from numpy.typing import NDArray

from ..mechanism.quantities import Array, Checked, ParameterError, quantity
from ..numerics.calls import count, finish
from ..numerics.normal import Stream, make_key
from .errors import seed_in_parts, split, wrap

_BLOCK = 128  # samples that are drawn at once
_PARTS = 4  # in which that is done

#: Pairs (component of q_P, component of q_T) whose products make the four components of q.
PAIRS = tuple((i, j) for i in range(4) for j in range(4))

#: Pairs of components of q whose products make error and place.
SECOND_PAIRS = ((0, 1), (0, 2), (0, 3), (2, 3), (1, 3), (0, 0), (1, 1), (2, 2), (3, 3))

_PLACES, _SECOND_PLACES = np.array(PAIRS).T, np.array(SECOND_PAIRS).T
_LARGEST_SCALE_ERROR = 0.01  # of the product of two squared norms: quaternions are units


def relative_rows() -> Array:
    """(4, 16): ``q = conj(q_P) q_T`` from the products of :data:`PAIRS`."""
    rows = np.zeros((4, 4, 4))  # component of q, of the payload, of the target
    rows[0] = np.eye(4)
    for k in (1, 2, 3):
        rows[k, 0, k], rows[k, k, 0] = 1.0, -1.0
    for i, j, k in ((1, 2, 3), (2, 3, 1), (3, 1, 2)):  # minus the cross product of the vector parts
        rows[k, i, j], rows[k, j, i] = -1.0, 1.0
    return rows.reshape(4, 16)


_RELATIVE_ROWS = relative_rows()
_RELATIVE_LISTS: list[list[float]] = _RELATIVE_ROWS.tolist()


def error_rows() -> Array:
    """(3, 9): e (rad) from the products of :data:`SECOND_PAIRS`."""
    return np.array([
        [2.0, 0.0, 0.0, -2.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        [0.0, 2.0, 0.0, 0.0, 2.0, 0.0, 0.0, 0.0, 0.0],
        [0.0, 0.0, 2.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
    ])  # fmt: skip


def line_of_sight_error(payload: Array, target: Array) -> Array:
    """e (..., 3), rad, in P, of unit quaternions (..., 4) of payload and target, scalar first."""
    return np.asarray(_second_products(payload, target) @ error_rows().T)


def _second_products(payload: Array, target: Array) -> Array:
    """(..., 9)."""
    (i, j), (k, m) = _PLACES, _SECOND_PLACES
    q = (payload[..., i] * target[..., j]) @ _RELATIVE_ROWS.T
    return np.asarray(q[..., k] * q[..., m])


def _multiply(rows: list[list[float]], column: list[float]) -> list[float]:
    """The product of a matrix, by rows, and a column."""
    # Not sum(): from Python 3.12 on it adds in another way, and other bits come out.
    return [reduce(add, map(mul, row, column), 0.0) for row in rows]


def _find_largest(place: Array) -> float:
    """The largest absolute value of a few numbers; nan if one is: in a step, what numpy needs is in no cache."""
    sizes = [abs(value) for value in place.tolist()]
    return nan if any(map(isnan, sizes)) else max(sizes)


class Lock(Enum):
    """State of the tracker; the value is what the FMU keeps."""

    SEARCHING = 0.0
    """The target is not where it could be acquired."""
    ACQUIRING = 1.0
    """The target is in the acquisition field, for less than the acquisition time."""
    LOCKED = 2.0
    """The target is measured."""


@dataclass(frozen=True, eq=False)
class Tracker(Checked):
    """What a line-of-sight sensor is; its scalars are parameters of the FMU.

    The fields are squares about the boresight.
    """

    noise_equivalent_angle_P: Array = quantity(
        "rad", "Noise-equivalent angle: standard deviation of a sample about an axis of P", shape=(3,), display="urad"
    )
    roll_measured: bool = quantity(
        "", "True: the rotation about the boresight is measured, too; false: line_of_sight_error.z stays 0"
    )
    sample_time: float = quantity("s", "Time between samples", above=0.0)
    latency: float = quantity("s", "Time from a sample to its output", at_least=0.0)
    field_of_view: float = quantity("rad", "Full width of the field in which lock is kept", above=0.0, at_most=2.0)
    acquisition_field: float = quantity(
        "rad", "Full width of the field in which lock is acquired, at most field_of_view", above=0.0, at_most=2.0
    )
    acquisition_time: float = quantity("s", "Time in the acquisition field until lock", at_least=0.0)
    seed: int = quantity("1", "Seed of the noise", at_least=0)

    def __post_init__(self) -> None:
        super().__post_init__()
        if (self.noise_equivalent_angle_P < 0.0).any():
            raise ParameterError(
                "noise_equivalent_angle", f"must not be negative, got {self.noise_equivalent_angle_P.tolist()}"
            )
        if self.acquisition_field > self.field_of_view:
            raise ParameterError(
                "acquisition_field",
                f"must not be wider than field_of_view, {self.field_of_view:g} rad, got {self.acquisition_field:g} rad",
            )

    @property
    def acquisition_share(self) -> float:
        """Acquisition field over field of view."""
        return self.acquisition_field / self.field_of_view

    @cached_property
    def rows(self) -> Array:
        """(7, 14): error (3, rad) and place (4) from [SECOND_PAIRS (9), line_of_sight (2), payload_rotation (2), 1].

        The place says where the target is: e_x and e_y over half of the field of view; ``1 - d_z``, which is above 1
        for a target behind the sensor; and how far the quaternions are from units, over what is let pass.  Each is
        within +-1 where lock is possible.
        """
        rows = np.zeros((7, 14))
        rows[:3, :9] = error_rows()
        rows[:2, 9:11], rows[:2, 11:13] = -np.eye(2), np.eye(2)  # less the turn of the line of sight against P
        rows[3:5] = rows[:2] * (2.0 / self.field_of_view)
        rows[5, 6:8] = 2.0
        rows[6, 5:9], rows[6, 13] = 1.0 / _LARGEST_SCALE_ERROR, -1.0 / _LARGEST_SCALE_ERROR
        return rows

    @cached_property
    def _place_lists(self) -> list[list[float]]:
        """Of :attr:`rows`, those of the place."""
        return [row.tolist() for row in self.rows[3:]]

    def look(self, payload: Array, target: Array, turned: Array) -> Array:
        """The place (4,) of a target, see :meth:`rows`.

        ``payload`` and ``target``: quaternions (4,); ``turned``: line_of_sight and payload_rotation, x and y of each,
        (4,), rad.
        """
        # Numbers, not arrays: an event comes between steps, and what numpy needs for this is in no cache then.
        p, t = payload.tolist(), target.tolist()
        q = _multiply(_RELATIVE_LISTS, [p[i] * t[j] for i, j in PAIRS])
        sources = [q[i] * q[j] for i, j in SECOND_PAIRS]
        return np.array(_multiply(self._place_lists, [*sources, *turned.tolist(), 1.0]))

    def judge(self, lock: Lock, place: Array, visible: bool, elapsed: float) -> Lock:
        """The next state.

        Parameters
        ----------
        place: (4,) of the target, see :meth:`rows`.
        visible: nothing hides the target.
        elapsed: time in the state ACQUIRING, s.
        """
        largest = _find_largest(place)
        if not visible or largest > 1.0:
            return Lock.SEARCHING
        if lock is Lock.LOCKED:
            return lock
        if largest > self.acquisition_share:
            return Lock.SEARCHING
        return Lock.LOCKED if lock is Lock.ACQUIRING and elapsed >= self.acquisition_time else Lock.ACQUIRING

    def watch(self, lock: Lock, place: Array, visible: bool) -> tuple[Array, float]:
        """Centre (4,) and distance beyond which a change of ``place`` can change the state; see :meth:`judge`."""
        if lock is Lock.LOCKED:
            return np.zeros(4), 1.0
        if lock is Lock.ACQUIRING:
            return np.zeros(4), self.acquisition_share
        if not visible:
            return place, 1e30
        # The component that is farthest outside has to come back by so much at least.
        return place, max(_find_largest(place) - self.acquisition_share, 0.0)

    def sample_numbers(self, time: Array) -> NDArray[np.int64]:
        """Number of the last sample before times (n,), s since the start; before the first one: 0."""
        return np.maximum(np.ceil(time / self.sample_time - 1e-6) - 1.0, 0.0).astype(np.int64)

    def noise(self, numbers: NDArray[np.int64]) -> Array:
        """Noise (n, 3), rad, of ascending sample numbers (n,)."""
        return TrackerNoise(self)(numbers)


class TrackerNoise:
    """Noise of a tracker's samples, which keeps what it drew last."""

    def __init__(self, tracker: Tracker) -> None:
        self._seed, self._deviation_P = tracker.seed, tracker.noise_equivalent_angle_P * [1, 1, tracker.roll_measured]
        self._last: tuple[int, Array] = -1, np.empty((0, 3))
        """Number of a block of samples, and their noise."""

    def __call__(self, numbers: NDArray[np.int64]) -> Array:
        """Noise (n, 3), rad, of ascending sample numbers (n,)."""
        return finish(self.in_parts(numbers))

    def in_parts(self, numbers: NDArray[np.int64]) -> Generator[int, None, Array]:
        """As :meth:`__call__`, in parts of 20 to 60 us; yields how many are still to come."""
        if not self._deviation_P.any():
            return np.zeros((len(numbers), 3))
        found, blocks = np.empty((len(numbers), 3)), split(numbers, _BLOCK)
        yield len(blocks) * _PARTS
        for number, (block, part) in enumerate(blocks, 1):
            left = (len(blocks) - number) * _PARTS
            known, noise = self._last
            if known != block:
                random = yield from count(seed_in_parts(self._make_key(block)), left + 3)
                noise = self._draw(random)
                self._last = block, noise
                yield left + 1
            noise.take(numbers[part] - block * _BLOCK, axis=0, out=found[part], mode="clip")
            if left:
                yield left
        return found

    def _make_key(self, block: int) -> tuple[int, ...]:
        return make_key(Stream.TRACKER, *wrap((self._seed, block)))

    def _draw(self, random: np.random.Generator) -> Array:
        """A block of samples, (_BLOCK, 3)."""
        u, v = random.random((2, _BLOCK, 3))
        # Box-Muller, since the streams of numpy's own normal numbers may change between its versions.
        return np.asarray(np.sqrt(-2.0 * np.log1p(-u)) * np.cos(2.0 * np.pi * v) * self._deviation_P)


#: A fine guidance sensor on a bright star, or a beacon tracker of an optical terminal: half a microradian at
#: 100 Hz.  The roll comes from a second star at a distance, ten times coarser.
DEFAULT_TRACKER = Tracker(
    noise_equivalent_angle_P=np.array([5e-7, 5e-7, 5e-6]),  # rad
    roll_measured=True,
    sample_time=0.01,  # s
    latency=0.01,  # s
    field_of_view=2e-3,  # rad
    acquisition_field=1e-3,  # rad
    acquisition_time=0.5,  # s
    seed=1,
)
