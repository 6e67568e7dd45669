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

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..mechanism.quantities import Array, Checked, ParameterError, quantity
from ..numerics import library
from ..numerics.library import find_address
from ..numerics.normal import Stream, Words, make_key, make_words
from .errors import wrap

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

    def noise(self, numbers: NDArray[np.int64]) -> Array:
        """Noise (n, 3), rad, of sample numbers (n,), 0 or greater."""
        found, words = np.empty((len(numbers), 3)), self._make_words()
        draw = library.find_arithmetic().find_tracker_noise
        for row, number in zip(found, np.asarray(numbers).tolist(), strict=True):
            draw(words, len(words), number, find_address(row))
        return np.asarray(found * (self.noise_equivalent_angle_P * self._measured))

    def describe(self) -> library.Tracker:
        """The tracker for the element of a step (``instruments.h``), which still needs places in a buffer."""
        deviation, words = self.noise_equivalent_angle_P * self._measured, self._make_words()
        found = library.Tracker(sample=library.NONE, noisy=bool(deviation.any()), n_words=len(words))
        found.acquisition_share, found.acquisition_time = self.acquisition_share, self.acquisition_time
        found.sample_time, found.deviation[:], found.measured[:] = self.sample_time, deviation, self._measured
        found.words[: len(words)] = words
        return found

    @property
    def _measured(self) -> tuple[int, int, int]:
        return 1, 1, int(self.roll_measured)

    def _make_words(self) -> Words:
        """Of the random numbers; the block of samples is the last of them."""
        return make_words(make_key(Stream.TRACKER, *wrap((self.seed, 0))))


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
