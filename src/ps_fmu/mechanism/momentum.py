"""Total momentum: what outer forces alone can change, kept beside the linear models and given back to the base.

Between two centres the momentum of a linear model is right to second order only.  So at each new centre the true one is
carried on by the impulse of the outer forces, and the velocities of the base are set so that the bodies have it.
"""

from __future__ import annotations

import numpy as np

from .convection import COARSE, FINE, TURN
from .dynamics import FlexibleSystem, Pose
from .forward_kinematics import forward_kinematics
from .kinematics import jacobians
from .linear_model import PlantModel
from .quantities import Array
from .rotations import cross, rotation_from_vector
from .signals import servo_slices

#: Numbers that :class:`Balance` keeps.
N_BALANCE = 19


def find_momentum(system: FlexibleSystem, pose: Pose, velocity_B: Array, speeds: Array) -> tuple[Array, Array]:
    """Linear and angular momentum of all bodies, their modes at rest, about the origin of B in its axes.

    Parameters
    ----------
    pose: of the platform, fine legs at their present length.
    velocity_B: (3,) m/s, of the origin of B.
    speeds: (9,) of :mod:`.convection`.

    Returns
    -------
    (6,) N.s and N.m.s, and the centre of mass, (3,) m from the origin of B.
    """
    geometry, R, t = system.manipulator.geometry, pose.rotation_BP, pose.translation_B
    J = jacobians(geometry, t, R)
    lines, n_B, length = J.legs, J.legs.n_B, J.legs.length[:, None]
    turn = speeds[TURN]
    base = np.concatenate([velocity_B, turn])  # twists in inertial space
    platform = J.J_pl @ np.concatenate([speeds[COARSE], speeds[FINE]]) + base
    platform[:3] += cross(turn, t)
    upper_end = (lines.platform_points @ platform).reshape(-1, 3)
    lower_end = (geometry.base_points @ base).reshape(-1, 3)
    apart = upper_end - lower_end
    swing = (apart - n_B * np.sum(apart * n_B, axis=-1)[:, None]) / length
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
    total[3:] += cross(n_B, first_l * lower_end - first_u * upper_end + second * swing).sum(axis=0)
    first = (m_u * (t + lines.arms_B) + (first_l - first_u) * n_B + m_l * geometry.base_joints_B).sum(axis=0)
    first = first + payload.mass * (t + com_B) + bus.mass * bus.com_B
    return total, first / (float(np.sum(m_u) + np.sum(m_l)) + payload.mass + bus.mass)


class Balance:
    """The true momentum at the last centre, and what is needed to carry it on; kept in numbers of the FMU state.

    ``numbers`` (N_BALANCE,): momentum (3,) and angular momentum about the centre of mass (3,), axes of B; then of the
    last centre: the momentum of the linear model (6,), rotation and velocity of the base (3, 3), time (1,).
    """

    def __init__(self, system: FlexibleSystem, numbers: Array) -> None:
        self._system = system
        self._true, self._linear = numbers[:6], numbers[6:12]
        self._rotation, self._velocity, self._time = numbers[12:15], numbers[15:18], numbers[18:19]

    @np.errstate(over="raise", divide="raise", invalid="raise")
    def begin(self, model: PlantModel, x: Array, t: float) -> None:
        """The state ``x`` of a model has the true momentum at the time ``t``, s."""
        momentum, com_B = self.find_momentum(model, x)
        self._true[:3], self._true[3:] = momentum[:3], momentum[3:] - cross(com_B, momentum[:3])
        self.go_on(model, x, t)

    def go_on(self, model: PlantModel, x: Array, t: float) -> None:
        """A new model serves from the state ``x`` at the time ``t``, s."""
        t_b, r_b = model.dynamics.base_places()
        n = model.dynamics.n
        self._linear[:] = _find_linear(model, x)
        self._rotation[:], self._velocity[:] = x[r_b], x[n + t_b.start : n + t_b.stop]
        self._time[0] = t

    @np.errstate(over="raise", divide="raise", invalid="raise")
    def settle(self, model: PlantModel, x: Array, t: float) -> Array:
        """The state whose base moves such that all bodies have the true momentum; ``model`` served up to ``t``, s."""
        d, n, centre = model.dynamics, model.dynamics.n, model.centre
        t_b, r_b = d.base_places()
        q_b, v_t = d.slices["q_b"], slice(n + t_b.start, n + t_b.stop)
        lasted, turned = t - float(self._time[0]), x[r_b] - self._rotation
        impulse = _find_linear(model, x) - self._linear
        if model.convection is not None:
            w, v = centre.speeds[TURN], centre.velocity_B
            way = 0.5 * lasted * (self._velocity + x[v_t])
            impulse -= lasted * (model.convection[q_b] @ centre.speeds)
            impulse += d.M[q_b, t_b] @ (cross(w, way) + cross(turned, v) - lasted * cross(w, v))
        momentum, com_B = self.find_momentum(model, x)
        # Components in B of a vector that stays as it is turn back; the impulse came in half-way.
        back, half = rotation_from_vector(-turned), rotation_from_vector(-0.5 * turned)
        about_com = impulse[3:] - cross(com_B, impulse[:3])
        self._true[:3] = back @ self._true[:3] + half @ impulse[:3]
        self._true[3:] = back @ self._true[3:] + half @ about_com
        missing = np.concatenate([self._true[:3], self._true[3:] + cross(com_B, self._true[:3])]) - momentum
        x = x.copy()
        x[n + q_b.start : n + q_b.stop] += np.linalg.solve(d.M[q_b, q_b], missing)
        return x

    def find_momentum(self, model: PlantModel, x: Array) -> tuple[Array, Array]:
        """As :func:`find_momentum`, of the state ``x`` of a model, modes and rods included."""
        d, n = model.dynamics, model.dynamics.n
        s, ds, _ = servo_slices(n)
        d_f, e_c, (t_b, r_b) = d.slices["d_f"], d.slices["e_c"], d.base_places()
        geometry = self._system.manipulator.geometry
        lengths = geometry.nominal_lengths + np.concatenate([x[s] + x[e_c], x[d_f]])
        found = forward_kinematics(geometry, lengths, d.pose.translation_B, d.pose.rotation_BP)
        rate = x[n : 2 * n]
        speeds = np.concatenate([rate[d_f], rate[r_b], x[ds] + rate[e_c]])
        momentum, com_B = find_momentum(self._system, Pose(found.translation_B, found.R), rate[t_b], speeds)
        for modes in (d.slices["x_m"], d.slices["x_t"]):
            momentum += d.M[d.slices["q_b"], modes] @ (rate[modes] * d.active[modes])
        return momentum, com_B


def _find_linear(model: PlantModel, x: Array) -> Array:
    """(6,) what outer forces change in the linear model: momentum, and the integral of convective forces by speeds."""
    d, n = model.dynamics, model.dynamics.n
    q_b, (s, ds, _) = d.slices["q_b"], servo_slices(n)
    momentum = d.M[q_b] @ (x[n : 2 * n] * d.active) + d.m_c[q_b] @ x[ds]
    if model.convection is not None:
        coarse = x[s] + x[d.slices["e_c"]]
        ways = np.concatenate([x[d.slices["d_f"]], x[d.base_places()[1]], coarse])
        momentum += 2.0 * (model.convection[q_b] @ ways)
    return np.asarray(momentum)
