"""From the forces that the controller computes to those that leave it: a digital controller's hold, then a delay."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..mechanism.quantities import Array


class StepError(ValueError):
    """A time that does not fit the communication step."""


def count_steps(name: str, interval: float, h: float) -> int:
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
        steps = count_steps("delay", delay, h)
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


@dataclass(frozen=True, eq=False)
class ForcePath:
    """The hold of a controller that computes forces once in a period, and a pure delay behind it.

    ``memory`` is ``[time since the last sample (s), held force (3, N), delay line]``, a view into whoever keeps it.
    """

    SIZE = 4 + DelayLine.SIZE

    memory: Array
    sample_time: float
    """Period of the controller, s; zero: every step."""
    delay: float
    """s."""

    @property
    def samples_now(self) -> bool:
        """Whether a period of the controller begins."""
        return self.sample_time > 0.0 and self.memory[0] == 0.0

    def push(self, force: Array, h: float) -> Array:
        """Take the force (3,) at the end of a step of ``h`` (s), and return the force that leaves.

        Raises
        ------
        StepError: sample time or delay is no multiple of the step, or the delay is too long.
        """
        if self.sample_time:
            count_steps("sample_time", self.sample_time, h)
            held = self.memory[1:4]
            self.memory[0] += h
            if self.memory[0] > self.sample_time - 0.5 * h:
                self.memory[0] = 0.0
                held[:] = force
            force = held
        return DelayLine(self.memory[4:]).push(force, self.delay, h)
