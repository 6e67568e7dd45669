"""Motion profiles: smooth paths of roll, pitch and yaw from any state of motion to rest at a target.

From rest, a profile is the polynomial of degree 7 in time whose rate, acceleration and jerk vanish at both
ends.  A profile that replaces another one midway is the sum of two such polynomials that begin together: a
*brake* takes up position, rate, acceleration and jerk of the start and comes to rest at its natural stop,
and a *transfer* from rest to rest covers the distance from that stop to the target.  Position, rate,
acceleration and jerk are continuous, and a change of mind never carries the motion further astray than the
brake needs (one polynomial for both would: its rate limit asks for a long duration, and that lets the
initial rate act for long).

With tau = (t - t_0)/T, each part is, relative to its end,

    x(tau) = (1 - tau)^4 (b_0 + b_1 tau + b_2 tau^2 + b_3 tau^3),

where b is the product of the start's Taylor polynomial and (1 - tau)^-4 = 1 + 4 tau + 10 tau^2 + 20 tau^3 +
..., cut after tau^3.  The factor makes the end exact, without cancellation.

The fourth derivative jumps at the ends, by 840 D/T^4 for a transfer over D.  This is what shakes a lightly
damped mode of circular frequency omega well above 1/T: it is left with an angle of at most
1680 D/(omega T)^4.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from math import comb
from typing import NamedTuple

import numpy as np

from ..mechanism.quantities import Array, Checked, quantity

# Peaks of |x'|, |x''|, |x'''| of a transfer over unit distance in unit time.
PEAK_RATE = 35.0 / 16.0
PEAK_ACCELERATION = 84.0 * 5.0**0.5 / 25.0
PEAK_JERK = 105.0 / 2.0

# How far the sum of brake and transfer may exceed the limits, relative.  At the full rate, a transfer in
# the same direction would otherwise have to wait for the brake: 10 % more halves the time in the worst
# cases tried.
REDIRECTION_EXCESS = 0.1

# Sampling and rounding of a profile that just meets its limits.
_SLACK = 1e-3
# Samples of tau, for each of the two parts, at which a profile is held against its limits.
_SAMPLES = np.linspace(0.0, 1.0, 33)
# Durations tried, relative to a lower bound; 3 % apart.
_BRAKES = 0.5 * 1.03 ** np.arange(100)
_TRANSFERS = 1.03 ** np.arange(60)


class State(NamedTuple):
    """Position and its first three derivatives in time; (..., 3) each, rad, rad/s, rad/s2, rad/s3."""

    position: Array
    rate: Array
    acceleration: Array
    jerk: Array

    @classmethod
    def at_rest(cls, position: Array) -> State:
        """No motion at ``position``."""
        zero = np.zeros(np.shape(position))
        return cls(np.array(position, dtype=float), zero, zero, zero)


@dataclass(frozen=True)
class Limits(Checked):
    """What a profile may demand; each limit holds for the Euclidean norm over roll, pitch and yaw."""

    max_rate: float = quantity("rad/s", "Largest rate of the commanded orientation", above=0.0, display="deg/s")
    max_acceleration: float = quantity(
        "rad/s2", "Largest second derivative of the commanded orientation", above=0.0, display="deg/s2"
    )
    max_jerk: float = quantity("rad/s3", "Largest third derivative of the commanded orientation", above=0.0)
    min_duration: float = quantity("s", "Shortest duration of any motion", at_least=0.0)


@dataclass(frozen=True, eq=False)
class Profile:
    """Motion from ``start`` at ``start_time`` to rest at ``target``."""

    start_time: float
    """s."""
    brake: float
    """s, duration of the brake; zero when the start is at rest."""
    transfer: float
    """s, duration of the transfer; zero when there is none."""
    start: State
    """(3,) each."""
    target: Array
    """(3,), rad."""

    @classmethod
    def hold(cls, position: Array, time: float = 0.0) -> Profile:
        """Rest at ``position``."""
        return cls(time, 0.0, 0.0, State.at_rest(position), np.array(position, dtype=float))

    @property
    def duration(self) -> float:
        """s."""
        return max(self.brake, self.transfer)

    @property
    def end_time(self) -> float:
        """s; from then on the profile is exactly at its target."""
        return self.start_time + self.duration

    def remaining(self, time: float | Array) -> Array:
        """Time until rest, (...) s to (...) s; zero throughout for a profile without duration."""
        return np.maximum(self.end_time - np.asarray(time), 0.0) * (self.duration > 0.0)

    def at(self, time: float | Array) -> State:
        """State at one or many times, () or (n,) s, to (3,) or (n, 3)."""
        x, rate, acceleration, jerk = self._derive(time, 3)
        return State(self.target + x, rate, acceleration, jerk)

    def motion_at(self, time: float | Array) -> tuple[Array, Array]:
        """Position and rate alone, as :meth:`at`, in half of its time."""
        x, rate = self._derive(time, 1)
        return self.target + x, rate

    def _derive(self, time: float | Array, order: int) -> list[Array]:
        """Position from the target, and its derivatives up to an order."""
        time = np.asarray(time, dtype=float)[..., None]
        # The end is exact although (end_time - start_time)/duration may round below 1.
        elapsed = np.where(time >= self.end_time, np.inf, time - self.start_time)
        braking, transfer = self._parts
        parts = [_part(braking, self.brake, elapsed, order), _part(transfer, self.transfer, elapsed, order)]
        return [a + b for a, b in zip(*parts, strict=True)]

    @cached_property
    def _parts(self) -> tuple[list[Array], list[Array]]:
        stop = _natural_stop(self.start, self.brake)
        braking = _factors(self.start, stop, self.brake)
        return braking, _factors(State.at_rest(stop), self.target, self.transfer)


def plan(time: float, start: State, target: Array, limits: Limits) -> Profile:
    """The shortest profile from ``start`` to rest at ``target`` within the limits.

    From rest the duration follows in closed form.  Otherwise the shortest brake within the limits, then the
    shortest transfer with which the sum exceeds them by at most 10 % (durations are tried in steps of 3 %).
    A limit that the start itself exceeds is raised to what the start has.

    Parameters
    ----------
    time: s, of the start.
    start: (3,) each.
    target: (3,), rad.
    """
    target = np.array(target, dtype=float)
    own = np.array([np.linalg.norm(derivative) for derivative in start[1:]])
    if not own.any():
        distance = float(np.linalg.norm(target - start.position))
        return Profile(time, 0.0, _transfer_duration(distance, limits), start, target)
    limit = np.array([limits.max_rate, limits.max_acceleration, limits.max_jerk])
    allowed = np.maximum(own, limit) * (1.0 + _SLACK)
    bound = max(
        own[0] / limits.max_acceleration,
        (own[0] / limits.max_jerk) ** (1 / 2),
        own[1] / limits.max_jerk,
        1e-3,  # s
    )
    stops = ((f * bound, _natural_stop(start, f * bound)) for f in _BRAKES)
    braking = _shortest((Profile(0.0, d, 0.0, start, stop) for d, stop in stops), allowed)
    allowed = np.maximum(allowed * max(1.0, _excess(braking, allowed)), (1.0 + REDIRECTION_EXCESS) * limit)
    shortest = _transfer_duration(float(np.linalg.norm(target - braking.target)), limits)
    return _shortest((Profile(time, braking.brake, f * shortest, start, target) for f in _TRANSFERS), allowed)


def _transfer_duration(distance: float, limits: Limits) -> float:
    if distance == 0.0:
        return 0.0
    return max(
        limits.min_duration,
        PEAK_RATE * distance / limits.max_rate,
        (PEAK_ACCELERATION * distance / limits.max_acceleration) ** (1 / 2),
        (PEAK_JERK * distance / limits.max_jerk) ** (1 / 3),
    )


def _shortest(candidates: Iterable[Profile], allowed: Array) -> Profile:
    """The first candidate within what is allowed, else the one with the least excess."""
    tried = []
    for candidate in candidates:
        excess = _excess(candidate, allowed)
        if excess <= 1.0:
            return candidate
        tried.append((excess, candidate))
    return min(tried, key=lambda item: item[0])[1]


def _excess(profile: Profile, allowed: Array) -> float:
    """Largest ratio of rate, acceleration and jerk to what is allowed."""
    times = profile.start_time + np.outer((profile.brake, profile.transfer), _SAMPLES).reshape(-1)
    peaks = [np.linalg.norm(derivative, axis=-1).max() for derivative in profile.at(times)[1:]]
    return float(np.max(peaks / allowed))


def _natural_stop(start: State, duration: float) -> Array:
    """Where a brake of this duration ends: the stop that lowers the polynomial's degree to 6 (b_3 = 0)."""
    T = duration
    return np.asarray(
        start.position + start.rate * T / 2 + start.acceleration * T**2 / 10 + start.jerk * T**3 / 120
    )


def _factors(start: State, end: Array, duration: float) -> list[Array]:
    """b_0 to b_3 of the polynomial from ``start`` to rest at ``end``."""
    c0 = start.position - end
    c1 = start.rate * duration
    c2 = start.acceleration * duration**2 / 2.0
    c3 = start.jerk * duration**3 / 6.0
    return [c0, c1 + 4.0 * c0, c2 + 4.0 * c1 + 10.0 * c0, c3 + 4.0 * c2 + 10.0 * c1 + 20.0 * c0]


def _part(b: list[Array], duration: float, elapsed: Array, order: int) -> list[Array]:
    """``(1 - tau)^4 b(tau)`` and its derivatives in time up to order 3 (Leibniz); zero from the end on."""
    if duration == 0.0:
        return [np.zeros(np.broadcast_shapes(elapsed.shape, (3,)))] * (order + 1)
    tau = np.clip(elapsed / duration, 0.0, 1.0)
    q = 1.0 - tau
    outer = [q**4, -4.0 * q**3, 12.0 * q**2, -24.0 * q]
    inner = [
        b[0] + tau * (b[1] + tau * (b[2] + tau * b[3])),
        b[1] + tau * (2.0 * b[2] + 3.0 * tau * b[3]),
    ]
    if order > 1:
        inner += [2.0 * b[2] + 6.0 * tau * b[3], 6.0 * b[3]]
    return [
        np.asarray(sum(comb(k, j) * outer[j] * inner[k - j] for j in range(k + 1)) / duration**k)
        for k in range(order + 1)
    ]
