"""The practical plant: manipulator, payload, bus, servos and optics, as a linear system about a centre.

State ``x`` (49 with the paper's modes), input ``u`` and output ``y``::

    x = [q, q', s, s', r]    q as in :mod:`.dynamics` (20), s: coarse-actuator displacement (3) from nominal length,
                             r: its reference (3)
    u = [f_f, w_b, f_a, w_p, r', t, t2, 1]   fine forces (3, N), base wrench (6, B at its origin), further fine forces
                             that are added (3, N), payload wrench (6, in P at its origin), rate of the coarse reference
                             (3, m/s), time from the centre (s) and its square, constant 1
    y = see :mod:`.signals`

The coarse actuators are second-order servos that follow ``r`` whatever the load, so that their acceleration drives
the rest through ``m_c``: a slew shakes payload and bus.  The reference moves at a constant rate over a step.  Were it
to jump at each step, the accelerations sampled at the ends of the steps would not be those between them, and an
isolator that integrates them would drift away.

Velocity and position of the base are components in B, which turns: ``v' = a - w x v``, ``p' = v - w x p`` with the
inertial acceleration ``a`` of the origin.  Masses are those of the pose at the centre.  Convective forces
(:mod:`.convection`) and what turns with B are linear about the speeds of the centre, and the constant input carries
what they are there: nothing at all for a centre at rest.  What is quadratic in the distance from the centre may be
added as a function of time along the expected way (:mod:`.curvature`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from .centre import Centre
from .compiled import N_MOVING_INPUTS, Mechanism
from .compiled import Place as CompiledPlace
from .convection import COARSE, FINE, TURN, convective_forces
from .discretisation import make_held_step_map, zero_order_hold
from .dynamics import Dynamics, FlexibleSystem, Pose
from .kinematics import Jacobians, KinematicsError, forward_kinematics, jacobians
from .parameters import Bus, CoarseServo, Manipulator, Optics, Parameters, Payload
from .quantities import Array, ParameterError, group
from .rotations import IDENTITY, GimbalLockError, orientation_rate_map, roll_pitch_yaw, rotation_from_vector
from .signals import ADDED, N_INPUTS, N_OUTPUTS, TIME, count_states, servo_slices

_ONE = slice(N_INPUTS - 1, N_INPUTS)
_SHORT = 1e-4  # m, for differences


Matrices = tuple[Array, Array, Array, Array]
"""A, B, C, D of ``x' = A x + B u``, ``y = C x + D u``."""


@dataclass(frozen=True, eq=False)
class PlantModel:
    """Continuous-time matrices of the plant about a centre.

    Parameters
    ----------
    dynamics: at the pose of the centre.
    rpy: (3,) nominal roll, pitch, yaw at the centre, by its coarse legs alone, rad.
    convection: (n, 9) of :func:`.convection.convective_forces` with the speeds of the centre; None: it is at rest.
    tangent: A, B, C, D without ``curvature``.
    servo: see :mod:`.parameters`.
    curvature: (states and outputs, 2) what is added to ``x'`` and ``y`` by the time from the centre and its square.
    """

    centre: Centre
    dynamics: Dynamics
    rpy: Array
    convection: Array | None
    tangent: Matrices
    servo: CoarseServo
    curvature: Array | None = None

    @property
    def n_states(self) -> int:
        """Size of ``x``."""
        return count_states(self.dynamics.n)

    def matrices(self) -> Matrices:
        """A, B, C, D of ``x' = A x + B u``, ``y = C x + D u``."""
        return self._matrices

    @cached_property
    def _matrices(self) -> Matrices:
        A, B, C, D = self.tangent
        if self.curvature is not None:
            B, D = B.copy(), D.copy()
            B[:, TIME], D[:, TIME] = self.curvature[: len(A)], self.curvature[len(A) :]
        return A, B, C, D

    def curve(self, curvature: Array) -> PlantModel:
        """The same with another ``curvature``."""
        return PlantModel(self.centre, self.dynamics, self.rpy, self.convection, self.tangent, self.servo, curvature)

    def output_map(self) -> Array:
        """[C D]: outputs from state and input at the same instant."""
        _, _, C, D = self.matrices()
        return np.hstack([C, D])

    def step_map(self, h: float) -> Array:
        """[y; x](t + h) from [x; u](t), see :func:`.discretisation.make_held_step_map`."""
        return make_held_step_map(*self.hold(h))

    def hold(self, h: float) -> Matrices:
        """Ad, Bd, C, D of a step of h (s): ``x(t + h) = Ad x(t) + Bd u(t)``, ``y(t + h) = C x(t + h) + D u(t)``."""
        A, B, C, D = self.matrices()
        Ad, Bd = zero_order_hold(A, B, h)
        Bd[:, ADDED] = Bd[:, 0:3]  # they act as the other fine forces, to the last bit
        # Inputs are means over the step, the outputs those at its end.
        if self.curvature is not None:
            D = D.copy()
            D[:, _ONE.start] += D[:, TIME] @ [h / 2.0, h**2 / 6.0]
            D[:, TIME.start] += h * D[:, TIME.start + 1]
        return Ad, Bd, C, D


class Place(NamedTuple):
    """Where the platform is; at one pose or many."""

    pose: Pose
    jacobians: Jacobians


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
        return count_states(self.system.n)

    @property
    def n_coordinates(self) -> int:
        """Number of coordinates ``q``."""
        return self.system.n

    @property
    def most_coordinates(self) -> int:
        """Number of coordinates ``q`` with a mode in each place."""
        return 12 + len(self.bus.modes) + len(self.payload.truss_modes) + len(self.payload.modes)

    def linearise(self, coarse_displacement: Array, attitude: Array = IDENTITY) -> PlantModel:
        """The model about rest at coarse displacements (3,), m, with fine legs at nominal length.

        ``attitude`` (4,): quaternion from B to inertial axes there.  Raises as :meth:`linearise_about`.
        """
        return self.linearise_about(Centre.at_rest(coarse_displacement, attitude))

    def linearise_about(self, centre: Centre) -> PlantModel:
        """The model about a centre, see :meth:`linearise_about_all`."""
        return self.linearise_about_all([centre])[0]

    def linearise_about_all(self, centres: Sequence[Centre]) -> list[PlantModel]:
        """The models about centres, each to the bits that it has by itself.

        Newton's iteration always starts from the nominal pose, so that the same centre gives the same bits whatever
        came before: a restored FMU state continues exactly.

        Raises
        ------
        ParameterError: no usable pose has these leg lengths; since they are within the stroke, it names the stroke.
        """
        found = self._linearise(centres, np.zeros((0, 6)))
        return [found.make_model(k) for k in range(len(centres))]

    def linearise_on_way(
        self, centre: Centre, ends: Sequence[Centre], beside: Array
    ) -> tuple[PlantModel, list[Matrices], Place]:
        """The model about a centre; matrices of those about the ends of a way; and where the platform is beside these.

        ``beside`` (m, 6): other displacements of the legs, m.  Raises as :meth:`linearise_about_all`.
        """
        found = self._linearise([centre, *ends], beside)
        return found.make_model(0), found.matrices[1:], found.beside

    def _linearise(self, centres: Sequence[Centre], beside: Array) -> _Linearised:
        try:
            places = self._find_places(centres, beside)
        except (KinematicsError, GimbalLockError) as error:
            at = "; ".join(_list_mm(centre.coarse) for centre in centres)
            raise ParameterError(
                "coarse_stroke", f"too large: no usable pose with the coarse legs at ({at}) mm from nominal; {error}"
            ) from error
        return self._find_matrices(centres, *places)

    def _find_places(self, centres: Sequence[Centre], beside: Array) -> tuple[Place, Array, Pose, Place]:
        """Where the platform is by all legs; nominal roll, pitch and yaw, and pose, by the coarse legs alone.

        Then where it is by the displacements ``beside``.  All at once takes little more than one.
        """
        geometry, k = self.manipulator.geometry, len(centres)
        deformed = [i for i, centre in enumerate(centres) if centre.fine.any()]
        n = k + len(deformed)
        moved = np.zeros((n + len(beside), 6))  # all legs of each centre, then the coarse ones of some, then the others
        for i, centre in enumerate(centres):
            moved[i, :3], moved[i, 3:] = centre.coarse, centre.fine
        moved[k:n, :3], moved[n:] = moved[deformed, :3], beside
        # To second order; not as products of matrices, whose bits may depend on how many poses there are.
        first, second = self._by_legs
        first = first + np.add.reduce(second * moved[:, None, None, :], axis=-1)
        motion = np.add.reduce(first * moved[:, None, :], axis=-1)
        start = geometry.nominal_translation_B + motion[:, :3], rotation_from_vector(motion[:, 3:])
        found = forward_kinematics(geometry, geometry.nominal_lengths + moved, *start)
        t, R = found.translation_B, found.R
        J, rpy = jacobians(geometry, t, R, found.legs), roll_pitch_yaw(R[:n])
        orientation_rate_map(rpy)  # it refuses what has no angles
        present = Place(Pose(t[:k], R[:k]), J[:k])
        at = list(range(k))
        for place, i in enumerate(deformed, k):
            at[i] = place
        return present, rpy[at], Pose(t[at], R[at]), Place(Pose(t[n:], R[n:]), J[n:])

    @cached_property
    def _by_legs(self) -> tuple[Array, Array]:
        """(6, 6) and (6, 6, 6): motion of the platform by displacements of the legs at the nominal pose.

        Half of the second derivatives are by differences of the first ones, to 1e-6 of them.  With both Newton's
        iteration starts nearer to the pose, and takes a step or two less.
        """
        geometry = self.manipulator.geometry
        at = geometry.nominal_translation_B
        J = jacobians(geometry, at, np.eye(3)).J_pl
        moved = _SHORT * np.concatenate([J.T, -J.T])
        there = jacobians(geometry, at + moved[:, :3], rotation_from_vector(moved[:, 3:])).J_pl
        change = (there[:6] - there[6:]) / (2.0 * _SHORT)  # (leg, motion, leg)
        # Symmetric: what a turn adds to the rate of a rotation vector is not.
        return J, 0.25 * (change.transpose(1, 0, 2) + change.transpose(1, 2, 0))

    def _find_matrices(
        self, centres: Sequence[Centre], present: Place, rpy: Array, nominal: Pose, beside: Place
    ) -> _Linearised:
        d = self.system.at(*present)
        matrices = []
        for k, centre in enumerate(centres):
            self.mechanism.damp_rods(d.M[k])
            matrices.append(self._find_matrices_about(centre, _find_place(d.pose[k], nominal[k], centre), d))
        stacked = Centre.stack(centres)
        convection = convective_forces(self.system, d, stacked.speeds) if stacked.speeds.any() else None
        return _Linearised(self, centres, d, rpy, convection, matrices, beside)

    def _find_matrices_about(self, centre: Centre, place: CompiledPlace, d: Dynamics) -> Matrices:
        x, still, (s, ds, r) = find_state(centre, d), np.zeros(N_MOVING_INPUTS), servo_slices(d.n)
        resting = x.copy()
        resting[d.n : 2 * d.n], resting[ds], resting[r] = 0.0, 0.0, x[s]
        x[r] = x[s] + self.servo.damping_ratio / (np.pi * self.servo.frequency) * x[ds]  # it does not accelerate
        t_b, _ = d.base_places()
        resting[d.n + t_b.start : d.n + t_b.stop] = centre.velocity_B
        held = still.copy()
        held[0:3] = d.K.diagonal()[d.slices["d_f"]] * centre.fine
        point = self.mechanism.evaluate(place, resting, held)
        A, B, C, D, _, _ = self.mechanism.linearise(point)
        outputs = point.read("outputs", N_OUTPUTS) - D @ held
        if centre.speeds.any():
            # Of what moves, how accelerations change with the speeds.
            point = self.mechanism.evaluate(place, x, still)
            by_state, _, to_outputs, _, _, _ = self.mechanism.linearise(point)
            places = np.arange(d.n, 2 * d.n)
            moving = np.concatenate([np.r_[t_b, ds], *(places[d.slices[group]] for group in ("d_f", "q_b", "e_c"))])
            A[:, moving], C[:, moving] = by_state[:, moving], to_outputs[:, moving]
            outputs = point.read("outputs", N_OUTPUTS)
            left = point.read("rates", self.n_states) - A @ x
        else:
            left = np.zeros(len(A))
        to_rates, to_outputs = np.zeros((len(A), N_INPUTS)), np.zeros((N_OUTPUTS, N_INPUTS))
        given = slice(0, TIME.start)
        to_rates[:, given], to_outputs[:, given] = B[:, given], D[:, given]
        to_rates[:, _ONE.start], to_outputs[:, _ONE.start] = left, outputs - C @ x
        return A, to_rates, C, to_outputs

    @cached_property
    def mechanism(self) -> Mechanism:
        """Its bodies, servos and optics in any motion; the damping of the rods is that of the last pose."""
        return Mechanism(self.manipulator, self.payload, self.bus, self.servo, self.optics)

    @cached_property
    def system(self) -> FlexibleSystem:
        """Its bodies and modes."""
        return FlexibleSystem(self.manipulator, self.payload, self.bus)

    def within_stroke(self, command: Array) -> Array:
        """The command (3,), m, with each leg kept within its stroke."""
        low, high = self.manipulator.coarse_stroke
        return np.minimum(np.maximum(command, low), high)

    def turning_centre(self, model: PlantModel, x: Array) -> Centre:
        """A centre where everything turns as one body as the state ``x`` of a model about rest says."""
        t_b, r_b = model.dynamics.base_places()
        n = model.dynamics.n
        speeds = np.concatenate([np.zeros(3), x[n + r_b.start : n + r_b.stop], np.zeros(3)])
        return replace(model.centre, speeds=speeds, velocity_B=x[n + t_b.start : n + t_b.stop].copy())

    @np.errstate(over="raise", divide="raise", invalid="raise")
    def initial_state(self, model: PlantModel, angular_velocity_B: Array | None = None) -> Array:
        """At the pose of ``model``, undeformed, the common centre of mass at rest.

        ``angular_velocity_B`` (3,), rad/s, in B: everything turns as one body; default: it is at rest.
        """
        d = model.dynamics
        x = np.zeros(model.n_states)
        s, _, r = servo_slices(d.n)
        x[s] = x[r] = model.centre.coarse
        if angular_velocity_B is not None and angular_velocity_B.any():
            t_b, r_b = d.base_places()
            x[d.n + r_b.start : d.n + r_b.stop] = angular_velocity_B
            x[d.n + t_b.start : d.n + t_b.stop] = -d.M[t_b, r_b] @ angular_velocity_B / d.M[t_b.start, t_b.start]
        return x


class _Linearised(NamedTuple):
    """Many models of a plant, before they are made one by one."""

    plant: Plant
    centres: Sequence[Centre]
    dynamics: Dynamics
    rpy: Array
    convection: Array | None
    matrices: list[Matrices]
    beside: Place

    def make_model(self, k: int) -> PlantModel:
        centre, plant = self.centres[k], self.plant
        forces = None if self.convection is None or not centre.speeds.any() else self.convection[k]
        return PlantModel(centre, self.dynamics[k], self.rpy[k], forces, self.matrices[k], plant.servo)


def _list_mm(displacements: Array) -> str:
    return ", ".join(f"{1e3 * displacement:.4g}" for displacement in displacements)


def _find_place(pose: Pose, nominal: Pose, centre: Centre) -> CompiledPlace:
    by_coarse = nominal.translation_B, nominal.rotation_BP
    return CompiledPlace.of(pose.translation_B, pose.rotation_BP, by_coarse, centre.attitude)


def find_state(centre: Centre, d: Dynamics) -> Array:
    """The state at a centre; references of the servos are zero."""
    x = np.zeros(count_states(d.n))
    d_f, (t_b, r_b), (s, ds, _) = d.slices["d_f"], d.base_places(), servo_slices(d.n)
    x[d_f], x[t_b], x[r_b], x[s] = centre.fine, centre.position_B, centre.rotation_B, centre.coarse
    of_q = x[d.n : 2 * d.n]
    of_q[d_f], of_q[t_b], of_q[r_b] = centre.speeds[FINE], centre.velocity_B, centre.speeds[TURN]
    x[ds] = centre.speeds[COARSE]
    return x


def momentum(model: PlantModel, x: Array) -> Array:
    """Linear and angular momentum of everything, (6,), B axes about its origin: the q_b rows of ``M q' + m_c s'``."""
    d, n = model.dynamics, model.dynamics.n
    q_b = d.slices["q_b"]
    return np.asarray(d.M[q_b] @ (x[n : 2 * n] * d.active) + d.m_c[q_b] @ x[servo_slices(n)[1]])
