"""The plant while it slews, swings or turns: a linear model about a centre, and a next one when the motion leaves it.

Between events everything is linear (:class:`.linear_model.PlantModel`).  A model is made about a *centre*: the middle
of the way that is expected, fine legs and speeds included.  What is quadratic in the distance from it is
added as a function of time (:mod:`.curvature`).  The model serves from the start of the way to its end, or until the
motion is not what was expected.  The middle is the middle in time, whatever the step: were it half a step off, errors
of first order would be left (1.5e-6 rad in a yaw of 10 deg in 0.5 s, whatever the distance).

States never step, but for the place and the velocities of the base, by which centre of mass and total momentum are kept
(:mod:`.momentum`).  At rest, or where all motion is small, the centre is the commanded pose with no speed at all; fine
legs are undeformed there, unless something holds them at another length.

**The way** that the plant is expected to go while its next model serves (:func:`look_ahead`), and how long that may be:
bodies go on as the present linear model says, rods and modes held as they are: what is fast would only hide where the
motion leads.  A way is as long as allows what is added to the next model, parabolas in time through its start, middle
and end.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from .centre import Centre
from .convection import COARSE, FINE, TURN
from .discretisation import zero_order_hold
from .linear_model import PlantModel
from .quantities import Array, Checked, quantity
from .rotations import from_rotation_vector, multiply, turn_vector
from .signals import output_slices, servo_slices

_ACCELERATION = output_slices()["base_acceleration"]

#: The middle of a way lies up to this many distances of Renewal ahead; twice the angle.
_AHEAD, _TURNED_AHEAD = 10.0, 2.0

#: A parabola may be off the way by this part of the distance of Renewal.  With a tenth, the payload's attitude is right
#: to 3e-7 rad in all fast slews of the tests.
_OFF = 0.1

#: Longest time to the middle of a way, s.
_LONGEST = 0.25


@dataclass(frozen=True)
class Renewal(Checked):
    """How far the motion may leave what its linear model was made for."""

    relinearisation_distance: float = quantity(
        "m", "Deviation of a leg's length from the prediction at which the plant makes new linear models",
        at_least=1e-9, display="um",
    )  # fmt: skip
    relinearisation_angle: float = quantity(
        "rad", "Turn of the base after which the plant makes new linear models; while the base turns, a tenth of this "
        "as deviation from the prediction",
        at_least=1e-9, at_most=0.1, display="mrad",
    )  # fmt: skip
    relinearisation_speed: float = quantity(
        "m/s", "Deviation of a coarse leg's speed from the prediction at which the plant makes new linear models",
        at_least=1e-9,
    )  # fmt: skip


#: What is usual.
RENEWAL = Renewal(3e-5, 1e-3, 1e-3)


class Way(NamedTuple):
    """Three states (n,) on the way."""

    half: float  # s, from the start to the middle and from there to the end
    start: Array
    middle: Array
    end: Array


@np.errstate(over="raise", divide="raise", invalid="raise")
def look_ahead(
    model: PlantModel, x: Array, u: Array, growth: Array, renewal: Renewal, h: float, prescribed: bool = False
) -> Way:
    """The way from a state, for whole steps.

    Parameters
    ----------
    model: the present one.  x: its state.
    u: its input, which is held.
    growth: (3,) of the rates of the coarse references, see :func:`find_growth`, m/s2.
    h: step, s.
    prescribed: the base is moved by a host; its places in the state hold other things.
    """
    n, d_f = model.dynamics.n, model.dynamics.slices["d_f"]
    s, _, r = servo_slices(n)
    rates, z = _move_rigidly(model, x, u, prescribed)
    half = _find_half(model, rates, z, renewal, 1.0 if prescribed else _AHEAD)

    moving = np.asarray(rates.any(axis=1))
    moving[r] = True
    keep = moving.nonzero()[0]
    m = len(keep)
    A, B, start = np.zeros((m + 1, m + 1)), np.ones((m + 1, 1)), np.zeros(m + 1)  # the last one is time
    held = np.empty(len(z) + 1)
    held[:-1], held[-1] = z, 1.0
    start[:m], held[keep] = z[keep], 0.0
    by_kept = rates[keep]
    A[:m, :m], B[:m, 0] = by_kept[:, keep], by_kept @ held
    first = int(keep.searchsorted(r.start))
    A[first : first + 3, m] = growth
    near = _AHEAD * renewal.relinearisation_distance
    is_leg = np.zeros(len(z), dtype=bool)
    is_leg[d_f] = is_leg[s] = True
    legs = is_leg[keep].nonzero()[0]
    while True:
        half = 0.5 * h * max(int(2.0 * half / h), 1)
        Ad, Bd = zero_order_hold(A, B, half)
        to_middle = Ad @ start + Bd[:, 0]
        to_end = Ad @ to_middle + Bd[:, 0]
        if not np.isfinite(to_end).all():
            return Way(0.5 * h, z, z, z)
        far = max(_largest((to_middle - start)[legs]), _largest((to_end - to_middle)[legs]))
        if far <= near or half < h:
            middle, end = z.copy(), z.copy()
            middle[keep], end[keep] = to_middle[:m], to_end[:m]
            return Way(half, z, middle, end)
        half *= max(0.9 * near / far, 0.1)


def _find_half(model: PlantModel, rates: Array, z: Array, renewal: Renewal, ahead: float) -> float:
    """How far ahead, s, the middle may be as distances, angle, speed and curvature say at the start."""
    d, n = model.dynamics, model.dynamics.n
    d_f, (_, r_b) = d.slices["d_f"], d.base_places()
    v_f, v_r, (_, ds, _) = slice(n + d_f.start, n + d_f.stop), slice(n + r_b.start, n + r_b.stop), servo_slices(n)
    growing = np.zeros(len(z) + 1)
    growing[:-1], growing[-1] = z, 1.0
    speeds: list[float] = z.tolist()  # few numbers of each are needed: lists are quicker than arrays
    growing[:-1], growing[-1] = rates @ growing, 0.0
    now: list[float] = growing.tolist()
    later: list[float] = (rates @ growing).tolist()
    near, turned = ahead * renewal.relinearisation_distance, min(ahead, _TURNED_AHEAD) * renewal.relinearisation_angle
    half = _LONGEST
    for speed, distance in ((ds, near), (v_f, near), (v_r, turned)):
        half = min(half, time_to(0.9 * distance, max(map(abs, speeds[speed])), max(map(abs, now[speed]))))
    half = min(half, time_to(0.9 * ahead * renewal.relinearisation_speed, max(map(abs, now[ds])), 0.0))
    # A parabola through three points of a way is off it by T**3 / 15.6 times the third derivative, which may grow.
    swing = math.sqrt(_largest(rates[v_f, d_f].diagonal()))
    servo = 2.0 * math.pi * model.servo.frequency
    for speed, frequency in ((v_f, swing), (ds, servo)):
        third = max(abs(b) + frequency * abs(a) for a, b in zip(now[speed], later[speed], strict=True))
        if third > 0.0:
            half = min(half, math.cbrt(15.6 * _OFF * renewal.relinearisation_distance / third))
    return half


def _move_rigidly(model: PlantModel, x: Array, u: Array, prescribed: bool) -> tuple[Array, Array]:
    """Rates (n, n + 1) by state and 1 with rods and modes held as they are, and the state (n,) with these at rest."""
    d, n = model.dynamics, model.dynamics.n
    A, B, C, D = model.matrices()
    by_model, inertial = np.empty((len(A), len(A) + 1)), np.empty((3, len(A) + 1))
    by_model[:, :-1], by_model[:, -1] = A, B @ u
    inertial[:, :-1], inertial[:, -1] = C[_ACCELERATION], D[_ACCELERATION] @ u
    d_f, q_b, (t_b, r_b) = d.slices["d_f"], d.slices["q_b"], d.base_places()
    bodies, v_t = slice(d_f.start, q_b.stop), slice(n + t_b.start, n + t_b.stop)  # legs and base stand side by side
    rigid = d_f if prescribed else bodies
    accelerations = by_model[n : 2 * n].copy()
    accelerations[t_b] = inertial
    rates = np.zeros_like(by_model)
    for followed in (rigid, slice(2 * n, len(A))):
        rates[followed] = by_model[followed]
    # Forces on the bodies are what moved them with rods and modes; without these they move otherwise.
    forces = d.M[rigid] @ (accelerations * d.active[:, None])
    rates[n + rigid.start : n + rigid.stop] = np.linalg.solve(d.M[rigid, rigid], forces)
    if prescribed:
        rates[r_b] = by_model[r_b]
    else:
        rates[v_t] += by_model[v_t] - inertial  # since B turns
    z = x.copy()
    z[n : n + bodies.start] = z[n + bodies.stop : 2 * n] = 0.0
    return rates, z


def find_growth(lasted: float, moved: Array, before: Array, now: Array, renewal: Renewal) -> Array:
    """(3,) m/s2, how rates of the references have grown from ``before`` to ``now``, m/s, in ``lasted``, s.

    Zero for a reference that has not moved, m, as one whose rate grows evenly: it has started or stopped in between, or
    its command comes in steps.
    """
    if lasted <= 0.0:
        return np.zeros(3)
    allowed = _OFF * renewal.relinearisation_distance
    each = zip(moved.tolist(), before.tolist(), now.tolist(), strict=True)
    return np.array([(b - a) / lasted if abs(way - 0.5 * lasted * (a + b)) < allowed else 0.0 for way, a, b in each])


def _largest(values: Array) -> float:
    return float(np.abs(values).max())


def time_to(distance: float, speed: float, acceleration: float) -> float:
    """When a distance is covered, s: the root of ``speed t + acceleration t**2 / 2 = distance``; inf: never."""
    divisor = speed + math.sqrt(speed**2 + 2.0 * acceleration * distance)
    return 2.0 * distance / divisor if divisor > 0.0 else math.inf


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
