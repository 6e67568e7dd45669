"""The practical plant: manipulator, payload, bus, servos and optics, as a linear system about rest.

State ``x`` (49 with the paper's modes), input ``u`` and output ``y``::

    x = [q, q', s, s', r]    q as in :mod:`.dynamics` (20), s: coarse-actuator displacement (3) from nominal length,
                             r: its reference (3)
    u = [f_f, w_b, f_a, w_p, r', 1]   fine forces (3, N), base wrench (6, B at its origin), further fine forces that are
                             added (3, N), payload wrench (6, in P at its origin), rate of the coarse reference
                             (3, m/s), constant 1
    y = see :mod:`.signals`

The coarse actuators are second-order servos that follow ``r`` whatever the load, so that their acceleration drives
the rest through ``m_c``: a slew shakes payload and bus.  The reference moves at a constant rate over a step.  Were it
to jump at each step, the accelerations sampled at the ends of the steps would not be those between them, and an
isolator that integrates them would drift away.

The matrices are derivatives of the mechanism in any motion (:mod:`.compiled`) at rest.  Outputs that are not linear in
the state have their value there, by the constant input, and change with the distance from it to first order.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from .compiled import N_MOVING_INPUTS, Mechanism, Place
from .discretisation import make_held_step_map, zero_order_hold
from .dynamics import Dynamics, Pose
from .kinematics import Jacobians, KinematicsError, forward_kinematics, jacobians
from .parameters import Bus, CoarseServo, Manipulator, Optics, Parameters, Payload
from .quantities import Array, ParameterError, group
from .rotations import IDENTITY, GimbalLockError, orientation_rate_map, roll_pitch_yaw
from .signals import ADDED, N_INPUTS, N_OUTPUTS, RATE, count_states, servo_slices

Matrices = tuple[Array, Array, Array, Array]
"""A, B, C, D of ``x' = A x + B u``, ``y = C x + D u``."""


@dataclass(frozen=True, eq=False)
class PlantModel:
    """Continuous-time matrices of the plant about rest.

    Parameters
    ----------
    coarse: (3,) m, displacements of the coarse actuators.
    dynamics: at their pose.
    rpy: (3,) roll, pitch, yaw there, rad.
    continuous: A, B, C, D.
    """

    coarse: Array
    dynamics: Dynamics
    rpy: Array
    continuous: Matrices

    @property
    def n_states(self) -> int:
        """Size of ``x``."""
        return count_states(self.dynamics.n)

    def matrices(self) -> Matrices:
        """A, B, C, D of ``x' = A x + B u``, ``y = C x + D u``."""
        return self.continuous

    def output_map(self) -> Array:
        """[C D]: outputs from state and input at the same instant."""
        return np.hstack(self.continuous[2:])

    def step_map(self, h: float) -> Array:
        """[y; x](t + h) from [x; u](t), see :func:`.discretisation.make_held_step_map`."""
        return make_held_step_map(*self.hold(h))

    def hold(self, h: float) -> Matrices:
        """Ad, Bd, C, D of a step of h (s): ``x(t + h) = Ad x(t) + Bd u(t)``, ``y(t + h) = C x(t + h) + D u(t)``."""
        A, B, C, D = self.continuous
        Ad, Bd = zero_order_hold(A, B, h)
        Bd[:, ADDED] = Bd[:, 0:3]  # they act as the other fine forces, to the last bit
        return Ad, Bd, C, D


@dataclass(frozen=True, eq=False)
class Plant:
    """What the plant FMU simulates; its scalars are the parameters of the FMU."""

    manipulator: Manipulator = group(flat=True)
    payload: Payload = group()
    bus: Bus = group()
    servo: CoarseServo = group()
    optics: Optics = group()

    @classmethod
    def from_parameters(cls, p: Parameters) -> Plant:
        """The plant of a parameter set, with all places for modes that the FMU has.

        Raises ParameterError for more modes than that.
        """
        p = p.fill_places()
        return cls(p.manipulator, p.payload, p.bus, p.servo, p.optics)

    @property
    def n_states(self) -> int:
        """Size of the state of its models."""
        return count_states(self.mechanism.n)

    @property
    def most_coordinates(self) -> int:
        """Number of coordinates ``q`` with a mode in each place."""
        return 12 + len(self.bus.modes) + len(self.payload.truss_modes) + len(self.payload.modes)

    @np.errstate(over="raise", divide="raise", invalid="raise")
    def linearise(self, coarse_displacement: Array, attitude: Array = IDENTITY) -> PlantModel:
        """The model about rest at coarse displacements (3,), m, with fine legs at nominal length.

        ``attitude`` (4,): quaternion from B to inertial axes there.

        Raises
        ------
        ParameterError: no usable pose has these leg lengths; since they are within the stroke, it names the stroke.
        """
        coarse = np.array(coarse_displacement, dtype=float)
        try:
            pose, J, rpy = self._find_pose(coarse)
        except (KinematicsError, GimbalLockError) as error:
            at = ", ".join(f"{1e3 * displacement:.4g}" for displacement in coarse)
            raise ParameterError(
                "coarse_stroke", f"too large: no usable pose with the coarse legs at ({at}) mm from nominal; {error}"
            ) from error
        d, n, size = Dynamics.of(self.mechanism, pose, J), self.mechanism.n, self.n_states
        x, (s, _, r) = np.zeros(size), servo_slices(n)
        x[s] = x[r] = coarse
        t, R = pose.translation_B, pose.rotation_BP
        point = self.mechanism.evaluate(Place.of(t, R, (t, R), attitude), x, np.zeros(N_MOVING_INPUTS))
        A, by_input, C, outputs_by_input, _, _ = self.mechanism.linearise(point)
        B, D, given = np.zeros((size, N_INPUTS)), np.zeros((N_OUTPUTS, N_INPUTS)), slice(0, RATE.stop)
        B[:, given], D[:, given] = by_input[:, given], outputs_by_input[:, given]
        D[:, -1] = point.read("outputs", N_OUTPUTS) - C @ x
        return PlantModel(coarse, d, rpy, (A, B, C, D))

    def _find_pose(self, coarse: Array) -> tuple[Pose, Jacobians, Array]:
        """Where the platform is, with its roll, pitch and yaw."""
        geometry = self.manipulator.geometry
        found = forward_kinematics(geometry, geometry.nominal_lengths + np.append(coarse, np.zeros(3)))
        J, rpy = jacobians(geometry, found.translation_B, found.R), roll_pitch_yaw(found.R)
        orientation_rate_map(rpy)  # it refuses what has no angles
        return Pose(found.translation_B, found.R), J, rpy

    @cached_property
    def mechanism(self) -> Mechanism:
        """Its bodies, servos and optics in any motion; the damping of the rods is that of the last pose."""
        return Mechanism(self.manipulator, self.payload, self.bus, self.servo, self.optics)

    def within_stroke(self, command: Array) -> Array:
        """The command (3,), m, with each leg kept within its stroke."""
        low, high = self.manipulator.coarse_stroke
        return np.minimum(np.maximum(command, low), high)

    @np.errstate(over="raise", divide="raise", invalid="raise")
    def initial_state(self, model: PlantModel, angular_velocity_B: Array | None = None) -> Array:
        """At the pose of ``model``, undeformed, the common centre of mass at rest.

        ``angular_velocity_B`` (3,), rad/s, in B: everything turns as one body; default: it is at rest.
        """
        d = model.dynamics
        x = np.zeros(model.n_states)
        s, _, r = servo_slices(d.n)
        x[s] = x[r] = model.coarse
        if angular_velocity_B is not None and angular_velocity_B.any():
            t_b, r_b = d.base_places()
            x[d.n + r_b.start : d.n + r_b.stop] = angular_velocity_B
            x[d.n + t_b.start : d.n + t_b.stop] = -d.M[t_b, r_b] @ angular_velocity_B / d.M[t_b.start, t_b.start]
        return x


def momentum(model: PlantModel, x: Array) -> Array:
    """Linear and angular momentum of everything, (6,), B axes about its origin: the q_b rows of ``M q' + m_c s'``."""
    d, n = model.dynamics, model.dynamics.n
    q_b = d.slices["q_b"]
    return np.asarray(d.M[q_b] @ (x[n : 2 * n] * d.active) + d.m_c[q_b] @ x[servo_slices(n)[1]])
