"""The plant over a slew: a linear model about a pose, replaced by one about the next pose when the legs have moved.

Between poses everything is linear (:class:`.linear_model.PlantModel`).  What is not linear happens here: the rate
limit of the coarse servos, the stroke, and the choice of a new pose.  Nothing here knows of FMI.

Momentum.  At a new pose all coordinates and velocities stay as they are, but the masses they belong to are others:
the linear and angular momentum that these velocities stand for changes.  In reality this is the convective part of the
inertial forces, ``(dM/ds s') q' + (dm_c/ds s') s'``, which acts while the legs move.  So the difference is
given back to the bus as a *convective wrench* over a time as long as that since the pose before.  Total momentum is
conserved, a slew leaves no drift behind, and the accelerometers feel what turns the bus: a jump of the velocities
would be hidden from them, and an isolator that integrates acceleration would be off by some per cent of the bus's
reaction.  What counts is motion about the common centre of mass: see :func:`momentum_taken`.

Convective forces within the mechanism (between payload and legs) are neglected: at the middle of the default slew to
8.5 deg they would turn the payload on its fine legs by 0.03 urad across the boresight and by 0.13 urad about it.
"""

from __future__ import annotations

from collections.abc import Iterable
from operator import sub
from typing import NamedTuple

import numpy as np

from .linear_model import Plant, PlantModel, momentum, servo_slices
from .quantities import Array

#: A servo is at rest when it is this close to its reference (m) and this slow (m/s): far below any optical effect.
AT_REST = 1e-12


#: Numbers that a :class:`Convection` is kept in.
N_CONVECTION = 8


class Convection(NamedTuple):
    """Momentum that changes of pose have taken from the model and that the bus has yet to be given."""

    owed: Array  # (6,) N.s, N.m.s, B axes about its origin
    since_pose: float = 0.0  # s, time since the model was made
    remaining: float = 0.0  # s, time over which the rest is given

    @classmethod
    def read(cls, numbers: Array) -> Convection:
        """From N_CONVECTION numbers, as :meth:`write` leaves them; zeros: at rest."""
        return cls(numbers[:6], *numbers[6:].tolist())

    def write(self, numbers: Array) -> None:
        """Into N_CONVECTION numbers, for the FMU state."""
        numbers[:6], numbers[6], numbers[7] = self

    def at_new_pose(self, taken: Array) -> Convection:
        """A new model has been made; its velocities stand for ``taken`` (6,) less momentum."""
        return Convection(self.owed + taken, 0.0, self.since_pose)

    def step(self, h: float) -> tuple[Array, Convection]:
        """The wrench (6,) to apply over a step of ``h`` (s), and what is left after it."""
        if self.remaining <= 1.5 * h:  # the last step: leave nothing behind
            return self.owed / h, Convection(np.zeros(6), self.since_pose + h)
        wrench = self.owed / self.remaining
        return wrench, Convection(self.owed - wrench * h, self.since_pose + h, self.remaining - h)


def momentum_taken(old: PlantModel, new: PlantModel, x: Array) -> Array:
    """Momentum (6,), N.s and N.m.s in B about its origin O, that the state ``x`` loses when ``new`` replaces ``old``.

    Seen from the common centre of mass, which moves at the velocity p/m.  Angular momentum about O, itself moving at
    v, obeys ``H' = torque - v x p``: it is conserved where p = 0, and there alone.  Seen from where the simulation
    started, a slew would turn a bus that moves at 1 cm/s by 0.5 urad/s for ever after.
    """
    d, t_b = old.dynamics, old.dynamics.slices["q_b"].start
    total_mass = d.M[t_b, t_b]
    from_centre = x.copy()
    from_centre[d.n + t_b : d.n + t_b + 3] -= momentum(old, x)[:3] / total_mass
    return momentum(old, from_centre) - momentum(new, from_centre)


class CoarseMotion(NamedTuple):
    """What a step of moving coarse legs asks for."""

    rate: Array  # (3,) rate of the servos' reference over the step, m/s
    wrench: Array  # (6,) convective wrench over the step, N, N.m, B axes about its origin
    state: Array  # (n,) state of the plant, about the pose of ``model``
    model: PlantModel  # the same as before, or one about a new pose
    convection: Convection
    moving: bool  # ask again before the next step


def coarse_motion(
    plant: Plant, model: PlantModel, x: Array, convection: Convection, command: Array, h: float, resolution: float
) -> CoarseMotion:
    """The servos' reference on its way to the command over the next step, and the pose to linearise about.

    Parameters
    ----------
    x: state of ``model``.  command: (3,) within the stroke, m.  h: step, s.
    resolution: largest distance of a leg from the pose of the model, m.

    Raises
    ------
    ParameterError: the legs have reached lengths that no usable pose has.
    """
    # In every step of a slew: with lists of three, this takes 5 us instead of 12 with arrays.
    s, ds, r = servo_slices(model.dynamics.n)
    limit, goal = plant.servo.rate_limit, command.tolist()
    position, speed, reference = x[s].tolist(), x[ds].tolist(), x[r].tolist()
    to_go = [c - p for c, p in zip(goal, reference, strict=True)]
    rate = [min(max(way / h, -limit), limit) for way in to_go]
    at_rest = _largest(to_go) < AT_REST and _largest(speed) < AT_REST and _largest_gap(goal, position) < AT_REST
    # The pose of a command that has been there before is the final one; of one that creeps, any will do.
    final = at_rest and not any(to_go)
    if at_rest:
        x = x.copy()
        x[s] = x[r] = position = goal
        x[ds] = rate = [0.0, 0.0, 0.0]
    distance = _largest_gap(position, model.coarse_reference.tolist())
    if distance > resolution or (final and distance > 0.0):
        new = plant.linearise(x[s])
        convection = convection.at_new_pose(momentum_taken(model, new, x))
        model = new
    wrench, convection = convection.step(h)
    moving = not final or bool(wrench.any())
    return CoarseMotion(np.array(rate), wrench, x, model, convection, moving)


def _largest(values: Iterable[float]) -> float:
    return max(map(abs, values))


def _largest_gap(a: Iterable[float], b: Iterable[float]) -> float:
    return max(map(abs, map(sub, a, b)))
