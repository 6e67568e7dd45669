"""The plant while it slews, swings or turns: a linear model about a centre, and a next one when the motion leaves it.

Between events everything is linear (:class:`.linear_model.PlantModel`).  A model is made about a *centre*: the middle
of the way that is expected (:mod:`.ways`), fine legs and speeds included.  What is quadratic in the distance from it is
added as a function of time (:mod:`.curvature`).  The model serves from the start of the way to its end, or until the
motion is not what was expected.  The middle is the middle in time, whatever the step: were it half a step off, errors
of first order would be left (1.5e-6 rad in a yaw of 10 deg in 0.5 s, whatever the distance).

States never step, but for the place and the velocities of the base, by which centre of mass and total momentum are kept
(:mod:`.momentum`).  At rest, or where all motion is small, the centre is the commanded pose with no speed at all; fine
legs are undeformed there, unless something holds them at another length.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from .centre import Centre
from .convection import COARSE, FINE, TURN
from .linear_model import PlantModel
from .quantities import Array
from .quaternions import from_rotation_vector, multiply
from .rotations import turn_vector
from .signals import servo_slices
from .ways import Renewal, Way

#: A servo is at rest when it is this close to its reference (m) and this slow (m/s): far below any optical effect.
AT_REST = 1e-12

#: No linear model is meant to serve for less, s.
_SHORTEST = 1e-3

#: Below this the base turns by vibration alone, rad/s: what is quadratic in it changes 1e-8 rad/s2 at most.
_HARDLY_TURNING = 1e-4

#: Fine legs have to be near rest now and this much later, s, to count as resting: a third of a radian of their swing.
_SOON = 0.01

#: In motion the base may be off its expected rotation by this part of the angle of Renewal.
_TURNED_OFF = 0.1


def find_attitude(model: PlantModel, x: Array, time: float, centre: Centre | None = None) -> Array:
    """(4,) attitude of B in the state ``x``, which the model reaches at ``time``, s, from its ``centre``."""
    centre = model.centre if centre is None else centre
    n, (_, r_b) = model.dynamics.n, model.dynamics.base_places()
    turn_B = x[n + r_b.start : n + r_b.stop]
    turn = turn_vector(x[r_b] - centre.rotation_B, centre.speeds[TURN], turn_B, time)
    q = multiply(centre.attitude, from_rotation_vector(turn))
    return np.asarray(q / math.sqrt(q @ q))


def is_at_rest(model: PlantModel, x: Array, command: Array) -> bool:
    """Whether the coarse legs have come to rest at the command (3,), m."""
    s, ds, r = servo_slices(model.dynamics.n)
    if not np.abs(x[ds]).max() < AT_REST:
        return False
    left = np.concatenate([x[s] - command, x[r] - command])
    return bool(np.abs(left).max() < AT_REST)


def rest_at(model: PlantModel, x: Array, command: Array) -> Array:
    """The state with the coarse legs exactly at the command (3,), m."""
    x = x.copy()
    s, ds, r = servo_slices(model.dynamics.n)
    x[s] = x[r] = command
    x[ds] = 0.0
    return x


@np.errstate(over="raise", divide="raise", invalid="raise")
def find_next_centre(
    model: PlantModel, x: Array, time: float, way: Way, command: Array, renewal: Renewal, prescribed: bool = False
) -> Centre:
    """What the next linear model is to be made about.

    Parameters
    ----------
    model: the present one.  x: its state, at ``time``, s, from its centre.
    way: what is expected from there.
    command: (3,) where the coarse legs are to go, m.
    prescribed: the base is moved by a host; its places in the state hold other things.
    """
    d, n, (t_b, r_b) = model.dynamics, model.dynamics.n, model.dynamics.base_places()
    v_r, middle = slice(n + r_b.start, n + r_b.stop), way.middle
    resting, now = is_at_rest(model, x, command), find_attitude(model, x, time)
    d_f = d.slices["d_f"]
    at = x[d_f]
    soon = at + _SOON * x[n + d_f.start : n + d_f.stop]
    near = 0.5 * renewal.relinearisation_distance
    if (
        resting
        and not np.abs(x[v_r]).max() > _HARDLY_TURNING
        and not np.abs(x[r_b] - model.centre.rotation_B).max() > 0.5 * renewal.relinearisation_angle
        and np.abs(soon - at).max() < near
    ):
        fine = np.zeros(3) if max(np.abs(at).max(), np.abs(soon).max()) < near else 0.5 * (at + soon)
        at_rest = replace(Centre.at_rest(command, now), fine=fine, rotation_B=x[r_b].copy())
        if prescribed:
            return at_rest
        return replace(at_rest, velocity_B=x[n + t_b.start : n + t_b.stop].copy(), position_B=x[t_b].copy())
    turn = turn_vector(middle[r_b] - x[r_b], x[v_r], middle[v_r], way.half)
    centre = find_centre(model, middle, multiply(now, from_rotation_vector(turn)), prescribed)
    return replace(centre, coarse=command, speeds=np.append(centre.speeds[:6], np.zeros(3))) if resting else centre


def find_centre(model: PlantModel, x: Array, attitude: Array, prescribed: bool = False) -> Centre:
    """The centre at the state ``x`` of a model, with the attitude of B there."""
    d, n = model.dynamics, model.dynamics.n
    s, ds, _ = servo_slices(n)
    d_f, (t_b, r_b), rate = d.slices["d_f"], d.base_places(), x[n : 2 * n]
    speeds = np.concatenate([rate[d_f], rate[r_b], x[ds]])
    shift = (np.zeros(3), np.zeros(3)) if prescribed else (rate[t_b].copy(), x[t_b].copy())
    return Centre(x[s].copy(), x[d_f].copy(), speeds, *shift, x[r_b].copy(), attitude)


class Distances(NamedTuple):
    """How far the motion may be from what was expected."""

    coarse: float  # m
    fine: float  # m
    coarse_speed: float  # m/s
    rotation: float  # rad


def find_distances(centre: Centre, renewal: Renewal) -> Distances:
    """As ``renewal`` says, and more where the motion is so fast that it would leave the centre within _SHORTEST."""
    near, angle = renewal.relinearisation_distance, renewal.relinearisation_angle
    fine, turn, coarse = (0.5 * _SHORTEST * float(np.abs(centre.speeds[k]).max()) for k in (FINE, TURN, COARSE))
    if centre.speeds.any():
        angle *= _TURNED_OFF
    return Distances(max(near, coarse), max(near, fine), renewal.relinearisation_speed, max(angle, turn))


def is_used_up(model: PlantModel, x: Array, renewal: Renewal, following: Centre) -> bool:
    """Whether a model has to be replaced by one about the centre ``following``: always, but for another one at rest."""
    centre = model.centre
    if following.speeds.any() or following.fine.any() or centre.speeds.any() or centre.fine.any():
        return True
    return bool((centre.coarse != following.coarse).any()) or _measure(model, x, renewal) > 1.0


def _measure(model: PlantModel, x: Array, renewal: Renewal) -> float:
    """Distance from a centre at rest in allowed ones."""
    d, centre = model.dynamics, model.centre
    s, ds, _ = servo_slices(d.n)
    allowed = find_distances(centre, renewal)
    return float(
        max(
            np.abs(x[s] - centre.coarse).max() / allowed.coarse,
            np.abs(x[d.slices["d_f"]]).max() / allowed.fine,
            np.abs(x[ds]).max() / allowed.coarse_speed,
            np.abs(x[d.base_places()[1]] - centre.rotation_B).max() / allowed.rotation,
        )
    )
