"""The feedforward controller over a slew: gains follow the orientation of the platform.  Knows nothing of FMI."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..mechanism.dynamics import Pose
from ..mechanism.inverse_kinematics import trilaterate
from ..mechanism.parameters import FeedforwardFilters, Manipulator, Parameters, Payload
from ..mechanism.rotations import rotation_matrix
from .feedforward import Controller, Lowpass, gains

Array = NDArray[np.float64]


def known_payload(p: Parameters) -> Payload:
    """The payload as the controller knows it: its centre of mass is some millimetres off, and the truss is rigid."""
    return replace(p.payload, com_P=p.known_com_P, truss_modes=())


def is_known(name: str) -> bool:
    """Whether the gains (52)-(54) need a parameter of manipulator or payload: not stroke, rod flexibility, inertia."""
    return not name.startswith(("coarse_stroke", "coarse_rods", "payload.inertia"))


class UnreachableOrientationError(ValueError):
    """No pose with ``d_f = 0`` has this orientation."""


@dataclass(frozen=True, eq=False)
class Isolator:
    """What the controller knows of mechanism and payload, which may differ from the plant's."""

    manipulator: Manipulator
    payload: Payload
    filters: FeedforwardFilters
    lowpass: Lowpass

    def controller(self, orientation: Array) -> Controller:
        """The controller (55) for a nominal orientation (3,), roll, pitch, yaw, rad.

        Raises
        ------
        UnreachableOrientationError: the three fine legs cannot meet at this orientation.
        """
        R = rotation_matrix(orientation)
        found = trilaterate(self.manipulator.geometry, R)
        if not found.solved:
            degrees = ", ".join(f"{angle:.4g}" for angle in np.degrees(orientation))
            raise UnreachableOrientationError(
                f"orientation ({degrees}) deg: no pose with the fine legs at rest; "
                f"they miss each other by {np.max(np.abs(found.gaps)):.3g} m"
            )
        pose = Pose(found.translation_B, R)
        return Controller(gains(self.manipulator, self.payload, pose), self.lowpass, self.filters)


class StepError(ValueError):
    """A time that does not fit the communication step."""


def whole_steps(name: str, interval: float, h: float) -> int:
    """Whole steps of ``h`` (s) in ``interval`` (s); none for an interval of zero alone.

    Raises
    ------
    StepError: not a multiple of the step; the text starts with ``name``.
    """
    count = round(interval / h)
    if abs(interval / h - count) > 1e-6 * count:
        raise StepError(f"{name}: {interval:g} s is not a multiple of the communication step {h:g} s")
    return count


#: Longest delay in communication steps; 0.1 s at 1e-4 s.
LONGEST_DELAY = 1000


@dataclass(frozen=True, eq=False)
class DelayLine:
    """A pure delay of the three forces by a whole number of steps.

    ``memory`` is ``[next place, step size, ring (3 x LONGEST_DELAY)]``, a view into whoever keeps it: the delay line
    itself has no state of its own.
    """

    SIZE = 2 + 3 * LONGEST_DELAY

    memory: Array

    def push(self, force: Array, delay: float, h: float) -> Array:
        """Store the force (3,) at the end of a step of ``h`` (s) and return that of ``delay`` (s) ago.

        Raises
        ------
        StepError: the delay is no multiple of the step, or longer than :data:`LONGEST_DELAY` steps.
        """
        steps = whole_steps("delay", delay, h)
        if steps > LONGEST_DELAY:
            raise StepError(f"delay: {delay:g} s is {steps} steps of {h:g} s; at most {LONGEST_DELAY} are kept")
        if self.memory[1] != h:
            self._resample(h)
        ring = self.memory[2:].reshape(LONGEST_DELAY, 3)
        place = int(self.memory[0])
        delayed = ring[(place - steps) % LONGEST_DELAY].copy() if steps else force.copy()
        ring[place] = force
        self.memory[0] = (place + 1) % LONGEST_DELAY
        return np.asarray(delayed)

    def _resample(self, h: float) -> None:
        """The same past on the grid of a new step size, by linear interpolation."""
        old = float(self.memory[1])
        self.memory[1] = h
        if old == 0.0:
            return
        ring = self.memory[2:].reshape(LONGEST_DELAY, 3)
        place = int(self.memory[0])
        newest_first = ring[(place - 1 - np.arange(LONGEST_DELAY)) % LONGEST_DELAY]
        ages = np.arange(LONGEST_DELAY)
        wanted = ages * (h / old)
        past = np.stack([np.interp(wanted, ages, newest_first[:, i], right=0.0) for i in range(3)], axis=1)
        ring[:] = past[::-1]
        self.memory[0] = 0.0
