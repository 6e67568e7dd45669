"""The practical plant: manipulator, payload, bus, servos and optics, as a linear system about a pose.

State ``x`` (49 with the paper's modes), input ``u`` and output ``y``::

    x = [q, q', s, s', r]    q as in :mod:`.dynamics` (20), s: coarse-actuator displacement (3) from nominal length,
                             r: its reference (3)
    u = [f_f, w_b, r', w_c, 1]   fine forces (3, N), base wrench (6, B at its origin), rate of the coarse reference
                             (3, m/s), convective wrench (6, as w_b; see :mod:`.plant`), constant 1
    y = see OUTPUTS

The coarse actuators are second-order servos that follow ``r`` whatever the load, so that their acceleration drives
the rest through ``m_c``: a slew shakes payload and bus.  The reference moves at a constant rate over a step.  Were it
to jump at each step, the accelerations sampled at the ends of the steps would not be those between them, and an
isolator that integrates them would drift away.  The constant input carries the pose about which the model is
linearised, so that orientation and coarse displacement are absolute.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from .discretisation import make_held_step_map, zero_order_hold
from .dynamics import Dynamics, FlexibleSystem, Pose
from .forward_kinematics import forward_kinematics
from .kinematics import KinematicsError
from .parameters import Bus, CoarseServo, Manipulator, Optics, Parameters, Payload
from .quantities import Array, ParameterError, Signal, group
from .rotations import orientation_rate_map

_XYZ, _RPY, _123 = ("x", "y", "z"), ("roll", "pitch", "yaw"), ("1", "2", "3")

#: Groups of outputs, in the order of ``y``.
OUTPUTS = (
    Signal("base_acceleration", _XYZ, "m/s2", "Acceleration of the origin of B, in B", 1e-3, starts_at_zero=False),
    Signal("base_angular_acceleration", _XYZ, "rad/s2", "Angular acceleration of B, in B", 1e-3, starts_at_zero=False),
    Signal("base_velocity", _XYZ, "m/s", "Velocity of the origin of B, in B", 1e-5),
    Signal("base_angular_velocity", _XYZ, "rad/s", "Angular velocity of B, in B", 1e-5),
    Signal("base_position", _XYZ, "m", "Displacement of the origin of B since the start, in B", 1e-5, "um"),
    Signal("base_rotation", _XYZ, "rad", "Small rotation of B since the start, in B", 1e-5, "urad"),
    Signal("payload_position", _XYZ, "m", "Displacement of the origin of P by vibration, in B", 1e-5, "um"),
    Signal("payload_rotation", _XYZ, "rad", "Small rotation of P by vibration (jitter), in P", 1e-6, "urad"),
    Signal("fine_displacement", _123, "m", "Elongation of a fine leg", 1e-6, "um"),
    Signal(
        "coarse_displacement", _123, "m", "Displacement of a coarse actuator from its nominal length", 0.01, "mm", False
    ),
    Signal(
        "orientation", _RPY, "rad", "Nominal orientation of P in B, by the coarse actuators alone", 0.1, "deg", False
    ),
    Signal(
        "relative_orientation", _RPY, "rad", "Orientation of P in B with fine legs and rod stretch", 0.1, "deg", False
    ),
    Signal("los", ("x", "y"), "m", "Image point of the boresight on the image plane, axes of P", 1e-6, "um"),
)

#: Size of ``y``.
N_OUTPUTS = sum(len(signal.components) for signal in OUTPUTS)
#: Size of ``u``.
N_INPUTS = 19
#: Fine forces and base wrench, the first inputs: what acts from outside.
N_LOADS = 9


def output_slices() -> dict[str, slice]:
    """Place of each group in ``y``."""
    places, start = {}, 0
    for signal in OUTPUTS:
        places[signal.name] = slice(start, start + len(signal.components))
        start += len(signal.components)
    return places


def servo_slices(n: int) -> tuple[slice, slice, slice]:
    """Places of ``s``, ``s'`` and ``r`` in the state, for n coordinates."""
    return slice(2 * n, 2 * n + 3), slice(2 * n + 3, 2 * n + 6), slice(2 * n + 6, count_states(n))


def count_states(n: int) -> int:
    """Size of ``x`` for n coordinates."""
    return 2 * n + 9


@dataclass(frozen=True, eq=False)
class PlantModel:
    """Continuous-time matrices of the plant about a pose.

    Parameters
    ----------
    dynamics: of the pose.
    servo, optics: see :mod:`.parameters`.
    coarse_reference: (3,) coarse displacement at the pose, m.
    rpy: (3,) roll, pitch, yaw at the pose, rad.
    """

    dynamics: Dynamics
    servo: CoarseServo
    optics: Optics
    coarse_reference: Array
    rpy: Array

    @property
    def n_states(self) -> int:
        """Size of ``x``."""
        return count_states(self.dynamics.n)

    def matrices(self) -> tuple[Array, Array, Array, Array]:
        """A, B, C, D of ``x' = A x + B u``, ``y = C x + D u``."""
        d, n = self.dynamics, self.dynamics.n
        A, B = np.zeros((self.n_states, self.n_states)), np.zeros((self.n_states, N_INPUTS))
        dq, s, ds, r = slice(n, 2 * n), *servo_slices(n)
        on = np.flatnonzero(d.active)
        A[on, n + on] = 1.0  # q' = dq, for what can move
        A[s, ds] = np.eye(3)
        omega = 2.0 * np.pi * self.servo.frequency
        A[ds, s], A[ds, ds] = -(omega**2) * np.eye(3), -2.0 * self.servo.damping_ratio * omega * np.eye(3)
        A[ds, r] = omega**2 * np.eye(3)
        B[r, 9:12] = np.eye(3)

        # M q'' = - K q - C q' + [f_f; w_b; 0] - m_c s''
        pick = np.ix_(on, on)
        mobility = np.zeros((n, n))  # zero for what cannot move
        mobility[pick] = np.linalg.inv(d.M[pick])
        coupling = mobility @ d.m_c
        A[dq, :n] = -mobility @ d.K
        A[dq, dq] = -mobility @ d.C
        A[dq, 2 * n :] = -coupling @ A[ds, 2 * n :]
        B[dq, 0:3], B[dq, 3:9] = mobility[:, d.slices["d_f"]], mobility[:, d.slices["q_b"]]
        B[dq, 12:18] = B[dq, 3:9]
        C, D = self._output_matrices(A[dq], B[dq])
        return A, B, C, D

    def _output_matrices(self, acceleration_x: Array, acceleration_u: Array) -> tuple[Array, Array]:
        d, n = self.dynamics, self.dynamics.n
        J = d.jacobians
        R_PB = d.pose.rotation_BP.T
        place = output_slices()
        C, D = np.zeros((N_OUTPUTS, self.n_states)), np.zeros((N_OUTPUTS, N_INPUTS))
        q_b = d.slices["q_b"]
        t_b, r_b = slice(q_b.start, q_b.start + 3), slice(q_b.start + 3, q_b.stop)
        dt_b, dr_b = slice(n + t_b.start, n + t_b.stop), slice(n + r_b.start, n + r_b.stop)
        s, one = servo_slices(n)[0], N_INPUTS - 1
        C[place["base_acceleration"]], D[place["base_acceleration"]] = (
            acceleration_x[t_b],
            acceleration_u[t_b],
        )
        C[place["base_angular_acceleration"]] = acceleration_x[r_b]
        D[place["base_angular_acceleration"]] = acceleration_u[r_b]
        C[place["base_velocity"], dt_b] = np.eye(3)
        C[place["base_angular_velocity"], dr_b] = np.eye(3)
        C[place["base_position"], t_b] = np.eye(3)
        C[place["base_rotation"], r_b] = np.eye(3)
        platform = d.platform_rows()
        platform[:, ~d.active] = 0.0
        C[place["payload_position"], :n] = platform[:3]
        C[place["payload_rotation"], :n] = R_PB @ platform[3:]
        C[place["fine_displacement"], d.slices["d_f"]] = np.eye(3)
        C[place["coarse_displacement"], s] = np.eye(3)

        # Roll, pitch, yaw: those of the pose, and first order about it; rates from angular velocity in B.
        to_rates = orientation_rate_map(self.rpy)
        C[place["orientation"], s] = to_rates @ J.J_theta_c
        D[place["orientation"], one] = self.rpy - to_rates @ J.J_theta_c @ self.coarse_reference
        relative = platform[3:].copy()
        relative[:, r_b] = 0.0  # J_theta_b = [0 E]: the base rotation cancels (eq 39)
        C[place["relative_orientation"]] = C[place["orientation"]]
        D[place["relative_orientation"]] = D[place["orientation"]]
        C[place["relative_orientation"], :n] += to_rates @ relative
        # A small rotation th turns the boresight z by th x z = (th_y, -th_x, 0).
        jitter = C[place["payload_rotation"]]
        C[place["los"]] = self.optics.focal_length * np.array([jitter[1], -jitter[0]])
        return C, D

    def output_map(self) -> Array:
        """[C D]: outputs from state and input at the same instant."""
        _, _, C, D = self.matrices()
        return np.hstack([C, D])

    def step_map(self, h: float) -> Array:
        """[y; x](t + h) from [x; u](t), see :func:`.discretisation.make_held_step_map`."""
        A, B, C, D = self.matrices()
        # The convective wrench acts as the base wrench does, and the constant moves nothing: without their columns the
        # exponential takes 0.11 instead of 0.14 ms.
        Ad, Bd = zero_order_hold(A, B[:, :12], h)
        return make_held_step_map(Ad, np.hstack([Bd, Bd[:, 3:9], np.zeros((len(A), 1))]), C, D)


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
        """The plant of a parameter set."""
        return cls(p.manipulator, p.payload, p.bus, p.servo, p.optics)

    @property
    def n_states(self) -> int:
        """Size of the state of its models."""
        return count_states(self._system.n)

    def linearise(self, coarse_displacement: Array) -> PlantModel:
        """The model about the pose of given coarse displacements (3,), m, with the fine legs at their nominal length.

        Newton's iteration always starts from the nominal pose, so that the same displacements give the same bits
        whatever came before: a restored FMU state continues exactly.

        Raises
        ------
        ParameterError: no usable pose has these leg lengths; since they are within the stroke, it names the stroke.
        """
        geometry = self.manipulator.geometry
        lengths = geometry.nominal_lengths.copy()
        lengths[:3] += coarse_displacement
        try:
            found = forward_kinematics(geometry, lengths)
            dynamics = self._system.at(Pose(found.translation_B, found.R))
        except KinematicsError as error:
            at = ", ".join(f"{1e3 * displacement:.4g}" for displacement in coarse_displacement)
            raise ParameterError(
                "coarse_stroke", f"too large: no usable pose with the coarse legs at ({at}) mm from nominal; {error}"
            ) from error
        return PlantModel(dynamics, self.servo, self.optics, np.array(coarse_displacement), found.orientation)

    @cached_property
    def _system(self) -> FlexibleSystem:
        return FlexibleSystem(self.manipulator, self.payload, self.bus)

    def within_stroke(self, command: Array) -> Array:
        """The command (3,), m, with each leg kept within its stroke."""
        low, high = self.manipulator.coarse_stroke
        return np.minimum(np.maximum(command, low), high)

    def initial_state(self, model: PlantModel) -> Array:
        """Everything at rest at the pose of ``model``."""
        x = np.zeros(model.n_states)
        s, _, r = servo_slices(model.dynamics.n)
        x[s] = x[r] = model.coarse_reference
        return x


def momentum(model: PlantModel, x: Array) -> Array:
    """Linear and angular momentum of everything, (6,), B axes about its origin: the q_b rows of ``M q' + m_c s'``."""
    d, n = model.dynamics, model.dynamics.n
    q_b = d.slices["q_b"]
    return np.asarray(d.M[q_b] @ (x[n : 2 * n] * d.active) + d.m_c[q_b] @ x[servo_slices(n)[1]])
