"""Total momentum: what outer forces alone can change, kept beside the linear models and given back to the base.

Between two centres the momentum of a linear model is right to second order only.  So at each new centre the true one is
carried on by the impulse of the outer forces, and the velocities of the base are set so that the bodies have it.

**Reaction of a free base to a slew** (:func:`find_reaction`), without a simulation.  The system starts at rest and no
outer force acts, so total momentum stays zero.  At each pose this gives the twist of the base for unit rates of the
coarse legs; the turn of the base is its integral along the path, and knows nothing of vibration.  This is the reaction
of a free-floating manipulator: Y. Umetani, K. Yoshida, IEEE Trans. Robot. Autom. 5(3), 1989.
"""

from __future__ import annotations

import numpy as np

from .convection import COARSE, FINE, N_SPEEDS, TURN
from .dynamics import FlexibleSystem, Pose
from .inverse_kinematics import inverse_kinematics
from .kinematics import Jacobians, forward_kinematics, jacobians
from .linear_model import Place, PlantModel
from .quantities import Array
from .rotations import (
    angular_velocity_map,
    cross,
    rotation_from_vector,
    rotation_matrix,
    rotation_vector,
    skew,
    turn_vector,
)
from .signals import count_states, servo_slices

#: Longer models than this, s, meet vibration whose rates at the ends say nothing of those between.
_SMOOTH = 0.1

#: What a model about rest does to the place in a longer time, s, is not made up for at once: places must not step.
_BRIEF = 1.0


def find_momentum(
    system: FlexibleSystem, pose: Pose, velocity_B: Array, speeds: Array, J: Jacobians | None = None
) -> tuple[Array, Array]:
    """Linear and angular momentum of all bodies, their modes at rest, about the origin of B in its axes.

    Parameters
    ----------
    pose: of the platform, fine legs at their present length.
    velocity_B: (3,) m/s, of the origin of B.
    speeds: (9,) of :mod:`.convection`.
    J: the Jacobians at the pose, if they are known.

    Returns
    -------
    (6,) N.s and N.m.s, and the centre of mass, (3,) m from the origin of B.
    """
    geometry, R, t = system.manipulator.geometry, pose.rotation_BP, pose.translation_B
    if J is None:
        J = jacobians(geometry, t, R)
    lines, n_B, length = J.legs, J.legs.n_B, J.legs.length[:, None]
    turn = speeds[TURN]
    base = np.concatenate([velocity_B, turn])  # twists in inertial space
    platform = J.J_pl @ np.concatenate([speeds[COARSE], speeds[FINE]]) + base
    platform[:3] += cross(turn, t)
    upper_end = (lines.platform_points @ platform).reshape(-1, 3)
    lower_end = (geometry.base_points @ base).reshape(-1, 3)
    apart = upper_end - lower_end
    swing = (apart - n_B * np.vecdot(apart, n_B)[:, None]) / length
    (m_u, m_l), (first_u, first_l), second = system.leg_moments
    upper, lower = m_u * upper_end - first_u * swing, m_l * lower_end + first_l * swing
    # What moves with the platform, about its origin; then all the rest, about that of B.
    payload, bus = system.payload, system.bus
    com_B = R @ payload.com_P
    linear = payload.mass * (platform[:3] + cross(platform[3:], com_B))
    spin = R @ (payload.inertia_P @ (R.T @ platform[3:]))
    above = lines.platform_points.T @ upper.ravel() + np.concatenate([linear, cross(com_B, linear) + spin])
    total = geometry.base_points.T @ lower.ravel() + system.bus_mass @ base + above
    total[3:] += cross(t, above[:3])
    total[3:] += np.add.reduce(cross(n_B, first_l * lower_end - first_u * upper_end + second * swing))
    first = np.add.reduce(m_u * (t + lines.arms_B) + (first_l - first_u) * n_B + m_l * geometry.base_joints_B)
    first = first + payload.mass * (t + com_B) + bus.mass * bus.com_B
    return total, first / (system.legs_mass + payload.mass + bus.mass)


def find_displacements(model: PlantModel, x: Array) -> Array:
    """(6,) m, of all legs from their nominal lengths in the state ``x`` of a model, stretched rods included."""
    d = model.dynamics
    return np.concatenate([x[servo_slices(d.n)[0]] + x[d.slices["e_c"]], x[d.slices["d_f"]]])


def count_balance(n: int) -> int:
    """Numbers that a :class:`Balance` keeps, for ``n`` coordinates."""
    return 14 + count_states(n)


class Balance:
    """The true momentum and centre of mass where the present linear model began; kept in numbers of the FMU state.

    ``numbers`` (:func:`count_balance`,): momentum (3,), angular momentum about the centre of mass (3,), place of the
    centre of mass from where the origin of B was at the start (3,), and from where it is (3,), all in axes of B; then
    the time from the centre of the model and the time, s, and the state where the model began.
    """

    start: Array
    """(n states,) where the present model began."""

    def __init__(self, system: FlexibleSystem, numbers: Array) -> None:
        self._system = system
        self._true, self._place, self._com_B = numbers[:6], numbers[6:9], numbers[9:12]
        self._first, self._time, self.start = numbers[12:13], numbers[13:14], numbers[14:]

    @np.errstate(over="raise", divide="raise", invalid="raise")
    def begin(self, model: PlantModel, x: Array, t: float) -> None:
        """The state ``x`` of a model has the true momentum and centre of mass at the time ``t``, s."""
        momentum, com_B = self.find_momentum(model, x)
        self._true[:3], self._true[3:] = momentum[:3], momentum[3:] - cross(com_B, momentum[:3])
        self._com_B[:], self._place[:] = com_B, x[model.dynamics.base_places()[0]] + com_B
        self.go_on(x, t)

    def go_on(self, x: Array, t: float, from_centre: float = 0.0) -> None:
        """A new model serves from the state ``x`` at the time ``t``, s; and what time it is from its centre, s."""
        self.start[:], self._time[0], self._first[0] = x, t, from_centre

    @np.errstate(over="raise", divide="raise", invalid="raise")
    def settle(self, model: PlantModel, x: Array, t: float, at: Place | None = None) -> Array:
        """The state whose base is and moves such that all bodies have the true momentum and centre of mass.

        ``model`` served up to ``t``, s, and its state is ``x``.  After a long time about rest the place of the base is
        left as it is.  ``at``: as for :meth:`find_momentum`.
        """
        d, n = model.dynamics, model.dynamics.n
        q_b, (t_b, r_b) = d.slices["q_b"], d.base_places()
        v_t = slice(n + t_b.start, n + t_b.stop)
        lasted, turned = t - float(self._time[0]), x[r_b] - self.start[r_b]
        momentum, com_B = self.find_momentum(model, x, at)
        impulse, over_time = self._find_outer(model, x, lasted)
        mass = d.M[t_b.start, t_b.start]
        ends = (self.start, self._true, self._com_B), (x, momentum, com_B)
        turns = self.start[n + r_b.start : n + r_b.stop], x[n + r_b.start : n + r_b.stop]
        moving = model.convection is not None
        back = rotation_from_vector(-turn_vector(turned, *turns, lasted) if moving else -turned)
        place = back @ (self._place + lasted * self._true[:3] / mass) + over_time[:3] / mass
        # Moments of the impulse about the centre of mass, which moves in B.
        shifts = tuple(
            total[:3] / mass - state[v_t] - cross(turn, at_B)
            for turn, (state, total, at_B) in zip(turns, ends, strict=True)
        )
        impulse[3:] -= cross(com_B, impulse[:3])
        impulse[3:] += _integrate_cross(shifts, com_B - self._com_B, impulse[:3], over_time[:3], lasted)
        over_time[3:] -= cross(0.5 * (self._com_B + com_B), over_time[:3])
        # Components in B of a vector that stays as it is turn back, those of an impulse from when it came.
        for k in (slice(0, 3), slice(3, 6)):
            lost = _integrate_cross(turns, turned, impulse[k], over_time[k], lasted)
            self._true[k] = back @ self._true[k] + impulse[k] - lost
        missing = np.concatenate([self._true[:3], self._true[3:] + cross(com_B, self._true[:3])]) - momentum
        x = x.copy()
        x[n + q_b.start : n + q_b.stop] += np.linalg.solve(d.M[q_b, q_b], missing)
        if moving or lasted < _BRIEF:
            x[t_b] = place - com_B
        self._com_B[:], self._place[:] = com_B, x[t_b] + com_B
        return x

    def _find_outer(self, model: PlantModel, x: Array, lasted: float) -> tuple[Array, Array]:
        """Impulse of outer forces since the model began, and its integral over that time, (6,) each.

        What the linear model has beside them are convective forces: integrals that are no differences of states by
        Hermite's rule, with the derivatives at both ends.
        """
        d, n, centre = model.dynamics, model.dynamics.n, model.centre
        q_b, (t_b, r_b), (s, ds, _) = d.slices["q_b"], d.base_places(), servo_slices(n)
        v_t, turn = slice(n + t_b.start, n + t_b.stop), slice(n + r_b.start, n + r_b.stop)
        M, start, moved = d.M[q_b] * d.active, self.start, x - self.start

        def find_linear(x: Array) -> Array:
            return np.asarray(M @ x[n : 2 * n] + d.m_c[q_b] @ x[ds])

        w, v, p = centre.speeds[TURN], centre.velocity_B, centre.position_B
        C = np.zeros((6, N_SPEEDS)) if model.convection is None else model.convection[q_b]
        C_w = 2.0 * C
        C_w[:, TURN] -= M[:, t_b] @ skew(v)
        constant = C @ centre.speeds + M[:, t_b] @ cross(w, v)
        added = np.zeros((model.n_states, 2)) if model.curvature is None else model.curvature[: model.n_states]
        first, last = float(self._first[0]), float(self._first[0]) + lasted
        over = added @ [0.5 * (last**2 - first**2), (last**3 - first**3) / 3.0]

        def find_other(x: Array, time: float) -> Array:
            speeds = np.concatenate([x[n : 2 * n][d.slices["d_f"]], x[turn], x[ds] + x[n : 2 * n][d.slices["e_c"]]])
            by_time = added[n : 2 * n] @ [time, time**2]
            return np.asarray(constant - C_w @ speeds - M[:, t_b] @ cross(w, x[v_t]) + M @ by_time)

        turned, hermite = moved[r_b], lasted**2 / 12.0 if lasted < _SMOOTH else 0.0
        ends = start[v_t] - cross(w, start[t_b]), x[v_t] - cross(w, x[t_b])
        of_place = 0.5 * lasted * (start[t_b] + x[t_b]) + hermite * (ends[0] - ends[1])
        of_velocity = moved[t_b] + cross(w, of_place) + cross(turned - lasted * w, p) - over[t_b]
        ways = np.concatenate([moved[d.slices["d_f"]], turned, moved[s] + moved[d.slices["e_c"]]])
        other = lasted * constant - C_w @ ways - M[:, t_b] @ cross(w, of_velocity) + M @ over[n : 2 * n]
        way = moved[:n].copy()
        way[t_b] = of_velocity
        of_linear = M @ way + d.m_c[q_b] @ moved[s]
        smooth = 0.5 * lasted * other + hermite * (find_other(start, first) - find_other(x, last))
        push = of_linear - lasted * find_linear(start) - smooth
        return find_linear(moved) - other, push

    def find_momentum(self, model: PlantModel, x: Array, at: Place | None = None) -> tuple[Array, Array]:
        """As :func:`find_momentum`, of the state ``x`` of a model, modes and rods included.

        ``at``: where the platform is by :func:`find_displacements`, if that is known.
        """
        d, n = model.dynamics, model.dynamics.n
        ds = servo_slices(n)[1]
        d_f, e_c, (t_b, r_b) = d.slices["d_f"], d.slices["e_c"], d.base_places()
        if at is None:
            geometry = self._system.manipulator.geometry
            lengths = geometry.nominal_lengths + find_displacements(model, x)
            found = forward_kinematics(geometry, lengths, d.pose.translation_B, d.pose.rotation_BP)
            J = jacobians(geometry, found.translation_B, found.R, found.legs)
            at = Place(Pose(found.translation_B, found.R), J)
        rate = x[n : 2 * n]
        speeds = np.concatenate([rate[d_f], rate[r_b], x[ds] + rate[e_c]])
        momentum, com_B = find_momentum(self._system, at.pose, rate[t_b], speeds, at.jacobians)
        coupling = d.M[d.slices["q_b"]] * d.moving_modes
        momentum += coupling @ rate
        shifted = coupling[:3] @ x[:n]  # kg.m, what moves along with the base
        momentum[:3] += cross(rate[r_b], shifted)
        momentum[3:] += cross(shifted, rate[t_b])
        return momentum, com_B + shifted / d.M[t_b.start, t_b.start]


def _integrate_cross(ends: tuple[Array, ...], f_sum: Array, J: Array, J_sum: Array, lasted: float) -> Array:
    """(3,) integral of ``f x J`` over a time, s: parabolas, f by its values at both ends and its integral ``f_sum``.

    J begins with zero and ends with ``J``; its integral is ``J_sum``.  After a long time f is taken as constant.
    """
    if lasted <= 0.0:
        return np.zeros(3)
    if lasted < _SMOOTH:
        starts, stops = (end.tolist() for end in ends)
    else:
        starts = stops = (f_sum / lasted).tolist()
    # Number by number: 8 us, where arrays of three take 30.
    factors = []  # of time and its square, for f and J
    for f_0, f_1, of_f, J_1, of_J in zip(starts, stops, f_sum.tolist(), J.tolist(), J_sum.tolist(), strict=True):
        f_2, J_2 = 3.0 * (f_0 + f_1) - 6.0 * of_f / lasted, 3.0 * J_1 - 6.0 * of_J / lasted
        f_1, J_1 = f_1 - f_0 - f_2, J_1 - J_2
        parts = J_1 / 2.0 + J_2 / 3.0, J_1 / 3.0 + J_2 / 4.0, J_1 / 4.0 + J_2 / 5.0
        factors.append(tuple(zip((f_0, f_1, f_2), parts, strict=True)))
    crossed = []
    for b, c in ((1, 2), (2, 0), (0, 1)):
        first, second, third = (
            f_b * J_c - f_c * J_b for (f_b, J_b), (f_c, J_c) in zip(factors[b], factors[c], strict=True)
        )
        crossed.append(lasted * (first + second + third))
    return np.array(crossed)


#: Parts of the path, each with Gauss's two points.  Against 64 parts they leave 1e-8 of the reaction to 8.5 deg of
#: roll, and 4e-8 of that to (3, -4, 8) deg.
_PARTS = 8
_GAUSS = 0.5 - np.sqrt(3.0) / 6.0, 0.5 + np.sqrt(3.0) / 6.0
_UNITS = np.eye(3 + N_SPEEDS)


def find_reaction(system: FlexibleSystem, target: Array, *, held: bool) -> Array:
    """Rotation of the base by a slew from roll, pitch, yaw of zero to ``target`` (3,), rad.

    The angles go there along a straight line, as the commander's profile from rest does; how fast makes no difference.

    Parameters
    ----------
    held: False: the fine legs are at rest before and after, and the payload turns with the base.  True: the fine legs
        take up the rotation of the base, so that the payload has its nominal orientation in inertial space.  Momentum
        is then that of the nominal pose, without the elongation of the fine legs (1e-4 of their length).

    Returns
    -------
    (3,) rotation vector, rad, axes of B.

    Raises
    ------
    KinematicsError: the path has a pose that no Jacobian exists for.
    """
    target = np.asarray(target, dtype=float)
    turned = np.eye(3)
    for part in range(_PARTS):
        rates = [_find_turn(system, (part + node) / _PARTS * target, target, held) for node in _GAUSS]
        turned = turned @ rotation_from_vector(0.5 * (rates[0] + rates[1]) / _PARTS)
    return rotation_vector(turned)


def _find_turn(system: FlexibleSystem, orientation: Array, rate: Array, held: bool) -> Array:
    """(3,) angular velocity of the base, rad/s, axes of B, for ``rate`` (3,), rad/s, of roll, pitch and yaw."""
    geometry, R = system.manipulator.geometry, rotation_matrix(orientation)
    pose = Pose(inverse_kinematics(geometry, orientation).translation_B, R)
    J = jacobians(geometry, pose.translation_B, R)
    columns = [find_momentum(system, pose, unit[:3], unit[3:], J)[0] for unit in _UNITS]
    by_speeds = np.column_stack(columns[3:])
    of_base = np.column_stack([*columns[:3], by_speeds[:, TURN]])
    relative = by_speeds[:, COARSE] @ np.linalg.solve(J.J_theta_c, angular_velocity_map(orientation) @ rate)
    if not held:
        return np.asarray(np.linalg.solve(of_base, -relative)[3:])
    # Also for the rates of the fine legs: what they turn the platform is the opposite of what the base turns.
    both = np.block([[of_base, by_speeds[:, FINE]], [np.zeros((3, 3)), np.eye(3), J.J_theta_f]])
    return np.asarray(np.linalg.solve(both, np.append(-relative, np.zeros(3)))[3:6])
