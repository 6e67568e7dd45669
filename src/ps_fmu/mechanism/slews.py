"""The plant while it slews, swings or turns: a linear model about a centre, and a next one when the motion leaves it.

Between events everything is linear (:class:`.linear_model.PlantModel`).  A model is made about a *centre* on the way:
the pose, fine legs included, and the speeds that are expected for the middle of the interval that it will serve.
Errors of first order in the distance from it then cancel over the interval, and the outputs of two models in a row meet
where one replaces the other, up to third order.  This is the midpoint rule with an exponential of the linear part
(M. Hochbruck and A. Ostermann, Exponential integrators, Acta Numerica 19, 2010).  States never step, but for the
velocities of the base, by which the total momentum is kept (:mod:`.momentum`).

At rest, or where all motion is small, the centre is the commanded pose with undeformed fine legs and no speed at all.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from .centre import Centre
from .convection import COARSE, FINE, TURN
from .linear_model import PlantModel
from .quantities import Array, Checked, quantity
from .quaternions import from_rotation_vector, multiply
from .signals import servo_slices

#: A servo is at rest when it is this close to its reference (m) and this slow (m/s): far below any optical effect.
AT_REST = 1e-12

#: Longest time between two centres that is looked ahead, s: a tenth of the period of the suspension.
_LONGEST = 0.02

#: No linear model is meant to serve for less, s.
_SHORTEST = 1e-3

#: Below this the base turns by vibration alone, rad/s: what is quadratic in it changes 1e-8 rad/s2 at most.
_HARDLY_TURNING = 1e-4


@dataclass(frozen=True)
class Renewal(Checked):
    """How far the motion may leave the centre of its linear model."""

    relinearisation_distance: float = quantity(
        "m", "A new linear model is made when a leg is this far from the centre of the last one",
        at_least=1e-9, display="um",
    )  # fmt: skip
    relinearisation_angle: float = quantity(
        "rad", "A new linear model is made when the base has turned by this from the centre of the last one",
        at_least=1e-9, at_most=0.1, display="mrad",
    )  # fmt: skip
    relinearisation_speed: float = quantity(
        "m/s", "A new linear model is made when a coarse leg's speed differs by this from that at the centre",
        at_least=1e-9,
    )  # fmt: skip


#: What is usual.
RENEWAL = Renewal(3e-5, 1e-3, 1e-3)


def find_attitude(centre: Centre, rotation_B: Array) -> Array:
    """(4,) attitude of B at another ``rotation_B`` (3,), rad, near that of the centre."""
    q = multiply(centre.attitude, from_rotation_vector(rotation_B - centre.rotation_B))
    return np.asarray(q / np.linalg.norm(q))


def is_at_rest(model: PlantModel, x: Array, command: Array) -> bool:
    """Whether the coarse legs have come to rest at the command (3,), m."""
    s, ds, r = servo_slices(model.dynamics.n)
    left = np.concatenate([x[s] - command, x[r] - command, x[ds]])
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
    model: PlantModel, x: Array, u: Array, command: Array, renewal: Renewal, prescribed: bool = False
) -> Centre:
    """What the next linear model is to be made about.

    Parameters
    ----------
    model: the present one.  x, u: its state, and the input of the last step.
    command: (3,) where the coarse legs are to go, m.
    prescribed: the base is moved by a host; its places in the state hold other things.
    """
    d, n = model.dynamics, model.dynamics.n
    A, B, _, _ = model.matrices()
    rates = A @ x + B @ u
    s, ds, _ = servo_slices(n)
    d_f, (t_b, r_b) = d.slices["d_f"], d.base_places()
    v_f, v_t, v_r = (slice(n + place.start, n + place.stop) for place in (d_f, t_b, r_b))
    if prescribed:
        rates[v_r] = 0.0

    near = renewal.relinearisation_distance
    lead = 0.5 * _LONGEST
    for speed, distance in ((ds, near), (v_f, near), (v_r, renewal.relinearisation_angle)):
        lead = min(lead, _time_to(0.9 * distance, float(np.abs(x[speed]).max()), float(np.abs(rates[speed]).max())))
    lead = min(lead, _time_to(0.9 * renewal.relinearisation_speed, float(np.abs(rates[ds]).max()), 0.0))

    def ahead(place: slice, speed: slice) -> Array:
        return np.asarray(x[place] + lead * x[speed] + 0.5 * lead**2 * rates[speed])

    def speed_ahead(speed: slice) -> Array:
        return np.asarray(x[speed] + lead * rates[speed])

    resting = is_at_rest(model, x, command)
    coarse, coarse_speed = (command, np.zeros(3)) if resting else (ahead(s, ds), speed_ahead(ds))
    fine, fine_speed = ahead(d_f, v_f), speed_ahead(v_f)
    rotation, turn = ahead(r_b, v_r), speed_ahead(v_r)
    if max(np.abs(fine).max(), np.abs(x[d_f]).max()) < 0.5 * near:
        fine, fine_speed = np.zeros(3), np.zeros(3)
    angle = np.abs(x[r_b] - model.centre.rotation_B).max()
    turning = np.abs(turn).max() > _HARDLY_TURNING or angle > 0.5 * renewal.relinearisation_angle
    if resting and not fine.any() and not turning:
        attitude = find_attitude(model.centre, x[r_b])
        return replace(Centre.at_rest(command, attitude), rotation_B=x[r_b].copy())
    attitude = find_attitude(model.centre, rotation)
    speeds = np.concatenate([fine_speed, turn, coarse_speed])
    if prescribed:
        return Centre(coarse, fine, speeds, np.zeros(3), np.zeros(3), rotation, attitude)
    return Centre(coarse, fine, speeds, speed_ahead(v_t), ahead(t_b, v_t), rotation, attitude)


def _time_to(distance: float, speed: float, acceleration: float) -> float:
    """When a distance is covered, s: the root of ``speed t + acceleration t**2 / 2 = distance``; inf: never."""
    divisor = speed + np.sqrt(speed**2 + 2.0 * acceleration * distance)
    return 2.0 * distance / divisor if divisor > 0.0 else np.inf


class Distances(NamedTuple):
    """How far the motion may leave a centre."""

    coarse: float  # m
    fine: float  # m
    coarse_speed: float  # m/s
    rotation: float  # rad


def find_distances(centre: Centre, renewal: Renewal) -> Distances:
    """As ``renewal`` says, and more where the motion is so fast that it would leave the centre within _SHORTEST."""
    near = renewal.relinearisation_distance
    fine, turn, coarse = (0.5 * _SHORTEST * float(np.abs(centre.speeds[k]).max()) for k in (FINE, TURN, COARSE))
    return Distances(
        max(near, coarse), max(near, fine), renewal.relinearisation_speed, max(renewal.relinearisation_angle, turn)
    )


def is_used_up(model: PlantModel, x: Array, renewal: Renewal, following: Centre) -> bool:
    """Whether a model has to be replaced by one about the centre ``following``."""
    centre = model.centre
    if not following.speeds.any() and not following.fine.any():
        same = (centre.coarse == following.coarse).all() and not centre.speeds.any() and not centre.fine.any()
        return not same or bool(_measure(model, x, renewal) > 1.0)
    return bool(_measure(model, x, renewal) > 0.5)


def _measure(model: PlantModel, x: Array, renewal: Renewal) -> float:
    """Distance from the centre in allowed ones."""
    d, centre = model.dynamics, model.centre
    s, ds, _ = servo_slices(d.n)
    allowed = find_distances(centre, renewal)
    return float(
        max(
            np.abs(x[s] - centre.coarse).max() / allowed.coarse,
            np.abs(x[d.slices["d_f"]] - centre.fine).max() / allowed.fine,
            np.abs(x[ds] - centre.speeds[COARSE]).max() / allowed.coarse_speed,
            np.abs(x[d.base_places()[1]] - centre.rotation_B).max() / allowed.rotation,
        )
    )
