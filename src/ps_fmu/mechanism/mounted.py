"""The plant on a base that a host's spacecraft moves: motion in, reaction out, without the mass that the host has.

The host's hub holds the mechanism as if it were locked at its present pose: its mass, centre of mass and inertia
(:class:`LockedMass`) are outputs, and the host adds them to its own.  What is left for the interface is what motion
relative to the base adds.  With ``g = [a; alpha]`` the acceleration of the base, ``q_o`` all coordinates but those of
the base and of the bus, ``M_bo`` their inertial coupling and ``w_p`` a wrench that acts on the payload from outside::

    M_oo q_o'' + C q_o' + K q_o = f_o - M_ob g - m_o s''
    wrench on the bus  W = w_p - d/dt P      with the relative momentum P = M_bo q_o' + m_b s'

The matrices are those of :class:`.linear_model.PlantModel`: a wrench on its bus is chosen such that the base moves as
prescribed.  So they hold for whatever that model contains, and the mass of its bus drops out.

Exchange.  Motion and reaction are means over a step, so that both sides see the same impulses.  The host steps first;
from the mean accelerations of that step the mechanism makes the same step, and expects, as if they stayed, its relative
momentum at the end of the next one.  The reaction for that next step is what leads from the impulse promised so far to
that momentum.  So the impulses given to the bus are those that the mechanism has taken, never more than one step's
change apart: no momentum is lost or made, and no force is late.  The impulse promised so far takes the places of the
base's translation and velocity in the state, which have no use here; ``tests/mechanism/test_exchange.py`` has the
limits of mass and step.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from .discretisation import make_held_step_map, zero_order_hold
from .dynamics import Dynamics, rigid_body_mass
from .linear_model import PlantModel
from .parameters import Bus
from .quantities import AXES, Array, Signal
from .rotations import skew
from .signals import N_EXTERNAL, N_INPUTS, N_OUTPUTS, servo_slices

#: Acceleration, angular acceleration and angular velocity of the base: what a host prescribes.
N_MOTION = 9
#: What the host's hub feels of the relative motion.
REACTION = (
    Signal("bus_force", AXES, "N", "With base = prescribed: force on the host's bus at the origin of B, in B", 0.1),
    Signal(
        "bus_torque", AXES, "N.m", "With base = prescribed: torque on the host's bus about the origin of B, in B", 0.1
    ),
)
#: Legs and payload as one rigid body, after their mass in kg.
LOCKED = (
    Signal("locked_com", AXES, "m", "Centre of mass of legs and payload at the present pose, in B", 0.1, None, False),
    Signal(
        "locked_inertia", ("xx", "xy", "xz", "yy", "yz", "zz"), "kg.m2",
        "Inertia of legs and payload at the present pose, about the origin of B, in B", 1.0, None, False,
    ),
)  # fmt: skip
#: Size of REACTION, mass and LOCKED.
N_HOST_OUTPUTS = 16
_WRENCH = slice(3, 9)  # of the inputs of PlantModel
_ACCELERATION = slice(0, 6)  # of its outputs: of the base, translation and rotation
_UPPER = np.triu_indices(3)


@dataclass(frozen=True, eq=False)
class LockedMass:
    """Legs and payload as one rigid body at a pose."""

    mass: float  # kg
    com_B: Array  # (3,) m
    inertia_B: Array  # (3, 3) kg.m2, about the origin of B

    @classmethod
    @np.errstate(over="raise", divide="raise", invalid="raise")
    def of(cls, dynamics: Dynamics) -> LockedMass:
        """Of the payload on the legs of ``dynamics``."""
        M = dynamics.locked
        mass = float(M[0, 0])
        moment = 0.5 * (M[3:, :3] - M[:3, 3:])  # m skew(com)
        return cls(mass, np.array([moment[2, 1], moment[0, 2], moment[1, 0]]) / mass, 0.5 * (M[3:, 3:] + M[3:, 3:].T))

    @property
    def matrix(self) -> Array:
        """(6, 6) mass matrix, B axes at the origin of B."""
        rho = skew(self.com_B)
        return rigid_body_mass(self.mass, self.com_B, self.inertia_B + self.mass * rho @ rho)

    @property
    def numbers(self) -> Array:
        """(10,) mass, centre of mass x, y, z, inertia xx, xy, xz, yy, yz, zz."""
        return np.concatenate([[self.mass], self.com_B, self.inertia_B[_UPPER]])


def stand_in_bus(bus: Bus) -> Bus:
    """A rigid bus that takes the place of one whose motion is prescribed: 1 kg and 1 kg.m2, its modes switched off."""
    return Bus(1.0, np.zeros(3), np.eye(3), tuple(replace(mode, frequency=0.0) for mode in bus.modes))


@dataclass(frozen=True, eq=False)
class HostedModel:
    """Maps of the plant with the ports for a host: inputs ``[external, motion, auxiliary]``, outputs ``[y, host's]``.

    ``motion`` (9,) is acceleration (m/s2), angular acceleration (rad/s2) and angular velocity (rad/s) of the base, in B
    at its origin.  The host's outputs (16,) are force and torque on the bus (N, N.m, in B at its origin) and
    :attr:`LockedMass.numbers`.
    """

    model: PlantModel
    prescribed: bool
    """Whether the base moves as ``motion`` says, and not by forces."""

    @cached_property
    def locked(self) -> LockedMass:
        """The mechanism as one body at the pose of the model."""
        return LockedMass.of(self.model.dynamics)

    def output_map(self) -> Array:
        """[C D], (N_OUTPUTS + 16, ...), see :meth:`.linear_model.PlantModel.output_map`; no wrench on the bus yet."""
        C, D = self._matrices[2:] if self.prescribed else self.model.matrices()[2:]
        return self._with_host(self._widened(np.hstack([C, D])))

    def step_map(self, h: float) -> Array:
        """``[y; host's; x](t + h)`` from ``[x; inputs](t)``."""
        if not self.prescribed:
            return self._with_host(self._widened(self.model.step_map(h)))
        A, B, C, D = self._matrices
        Ad, Bd = zero_order_hold(A, B, h)
        step = make_held_step_map(Ad, Bd, C, D)
        n, d = len(A), self.model.dynamics
        result = np.zeros((N_OUTPUTS + N_HOST_OUTPUTS + n, step.shape[1]))
        result[:N_OUTPUTS], result[N_OUTPUTS + N_HOST_OUTPUTS :] = step[:N_OUTPUTS], step[N_OUTPUTS:]
        states = result[N_OUTPUTS + N_HOST_OUTPUTS :]
        # The impulse promised: minus the relative momentum after one more step like this one, and h times what is
        # transmitted in that step; the state goes on as it does.
        promised, P = promised_impulse(d), relative_momentum(self.model)
        after, start = states.copy(), np.eye(*states.shape)
        of_state, of_input = self._transmitted
        impulse = -P @ Ad @ after + h * of_state @ (1.5 * after - 0.5 * start)
        impulse[:, n:] += h * of_input - P @ Bd
        reaction = slice(N_OUTPUTS, N_OUTPUTS + 6)
        result[reaction] = impulse / h + 0.5 * of_state @ (after + start)
        result[reaction, n:] += of_input
        result[reaction, promised] -= np.eye(6) / h
        states[promised] = impulse
        rate = self.rate_places
        states[rate] = 0.0
        states[rate, self._rate_columns] = np.eye(3)
        return self._with_locked(result)

    def split_map(self, h: float) -> tuple[Array, Array] | None:
        """As :meth:`step_map`: x(t + h) from [x; inputs](t), then y(t + h) from [x(t + h); inputs(t)].

        The outputs take few of the states each, where in :meth:`step_map` they take nearly all.  None where the motion
        is prescribed.
        """
        if self.prescribed:
            return None
        Ad, Bd, C, D = self.model.hold(h)
        return self._spread(Ad, Bd), self._with_locked(self._spread(C, D, N_HOST_OUTPUTS))

    @property
    def rate_places(self) -> slice:
        """Places of the base's angular velocity in the state."""
        n, (_, turn) = self.model.dynamics.n, self.model.dynamics.base_places()
        return slice(n + turn.start, n + turn.stop)

    @property
    def _rate_columns(self) -> slice:
        start = self.model.n_states + N_EXTERNAL + 6
        return slice(start, start + 3)

    def _with_locked(self, matrix: Array) -> Array:
        """The outputs of the locked mass, by the constant 1, which is the last input."""
        matrix[N_OUTPUTS + 6 : N_OUTPUTS + N_HOST_OUTPUTS, -1] = self.locked.numbers
        return matrix

    def _widened(self, matrix: Array) -> Array:
        """A map of PlantModel with columns for the motion, zero, where it has none."""
        at, n_columns = self.model.n_states + N_EXTERNAL, self.model.n_states + N_INPUTS + N_MOTION
        wide = np.zeros((len(matrix), n_columns))
        wide[:, :at], wide[:, at + n_columns - matrix.shape[1] :] = matrix[:, :at], matrix[:, at:]
        return wide

    def _spread(self, by_state: Array, by_input: Array, below: int = 0) -> Array:
        """A map from state and inputs, with columns of zeros for the motion, and rows of them below."""
        m, n = by_state.shape
        at, gap = n + N_EXTERNAL, N_MOTION
        wide = np.zeros((m + below, n + N_INPUTS + gap))
        wide[:m, :n] = by_state
        wide[:m, n:at], wide[:m, at + gap :] = by_input[:, :N_EXTERNAL], by_input[:, N_EXTERNAL:]
        return wide

    def _with_host(self, matrix: Array) -> Array:
        """A map whose rows begin with the outputs, with rows for the host's behind them: the locked mass, else zero."""
        result = np.zeros((len(matrix) + N_HOST_OUTPUTS, matrix.shape[1]))
        result[:N_OUTPUTS], result[N_OUTPUTS + N_HOST_OUTPUTS :] = matrix[:N_OUTPUTS], matrix[N_OUTPUTS:]
        return self._with_locked(result)

    @cached_property
    def _own(self) -> tuple[Array, Array, Array]:
        """On the own bus: the base's acceleration from state and input, and the wrench it takes per acceleration."""
        _, _, C, D = self.model.matrices()
        return C[_ACCELERATION], D[_ACCELERATION], np.asarray(np.linalg.inv(D[_ACCELERATION, _WRENCH]))

    @cached_property
    def _held(self) -> tuple[Array, Array, Array, Array, Array, Array]:
        """A, B, C, D with the base's acceleration at zero, and what a unit acceleration adds to x' and y."""
        A, B, C, D = self.model.matrices()
        by_state, by_input, inertia = self._own
        to_state, to_output = B[:, _WRENCH] @ inertia, D[:, _WRENCH] @ inertia
        A, B = A - to_state @ by_state, B - to_state @ by_input
        C, D = C - to_output @ by_state, D - to_output @ by_input
        B[:, _WRENCH], D[:, _WRENCH] = 0.0, 0.0  # zero already, but for rounding
        return A, B, C, D, to_state, to_output

    @cached_property
    def _transmitted(self) -> tuple[Array, Array]:
        """Wrench on the bus from state (6, n) and inputs (6, m), beside the change of relative momentum.

        What acts on the payload from outside, and convective forces, without those of the locked mass, which the host
        has.
        """
        d = self.model.dynamics
        by_state, by_input, inertia = self._own
        A, B, _, _, _, _ = self._held
        P = relative_momentum(self.model)
        by_input = by_input.copy()
        by_input[:, _WRENCH] = 0.0  # the host applies its own forces to its own hub
        of_state, of_input = inertia @ by_state + P @ A, inertia @ by_input + P @ B
        motion = np.zeros((6, N_MOTION))
        motion[:, 6:] = of_state[:, self.rate_places]
        of_state[:, np.r_[promised_impulse(d), self.rate_places]] = 0.0
        return of_state, _insert_motion(of_input, motion)

    @cached_property
    def _matrices(self) -> tuple[Array, Array, Array, Array]:
        """A, B, C, D with the base's motion prescribed; inputs with motion."""
        A, B, C, D, to_state, to_output = (matrix.copy() for matrix in self._held)
        promised, rate = promised_impulse(self.model.dynamics), self.rate_places
        motion_B, motion_D = np.zeros((len(A), N_MOTION)), np.zeros((len(C), N_MOTION))
        motion_B[:, :6], motion_D[:, :6] = to_state, to_output
        motion_B[:, 6:], motion_D[:, 6:] = A[:, rate], C[:, rate]
        # The base's translation and velocity have no place: the promised impulse is there.
        for matrix in (A, C):
            matrix[:, promised], matrix[:, rate] = 0.0, 0.0
        for matrix in (A, B, motion_B):
            matrix[promised], matrix[rate] = 0.0, 0.0
        return A, _insert_motion(B, motion_B), C, _insert_motion(D, motion_D)


def _insert_motion(inputs: Array, motion: Array) -> Array:
    return np.hstack([inputs[:, :N_EXTERNAL], motion, inputs[:, N_EXTERNAL:]])


def gyroscopic_rates(mass: Array, turn_B: Array) -> Array:
    """(6, 3): derivative by the angular velocity of the force and torque that a rigid body needs to turn steadily.

    ``[w x (w x S); w x (I w)]`` with first moment S and inertia I about the origin, from its mass matrix (6, 6), at
    ``turn_B`` (3,), rad/s.
    """
    moment = mass[3:, :3]  # skew(S)
    first, inertia = np.array([moment[2, 1], moment[0, 2], moment[1, 0]]), mass[3:, 3:]
    across = skew(turn_B)
    by_force = -across @ moment - skew(np.cross(turn_B, first))
    return np.vstack([by_force, across @ inertia - skew(inertia @ turn_B)])


def relative_momentum(model: PlantModel) -> Array:
    """(6, n states): momentum of the motion relative to the base from the state, N.s and N.m.s, B at its origin."""
    d, n = model.dynamics, model.dynamics.n
    others = d.active.copy()
    others[d.slices["q_b"]] = False
    rows = np.zeros((6, model.n_states))
    rows[:, n : 2 * n] = d.M[d.slices["q_b"]] * others
    rows[:, servo_slices(n)[1]] = d.m_c[d.slices["q_b"]]
    return rows


def promised_impulse(d: Dynamics) -> Array:
    """Places (6,) in the state of the impulse promised to the bus: those of the base's translation and its rate."""
    shift = np.arange(*d.base_places()[0].indices(d.n))
    return np.concatenate([shift, d.n + shift])
