"""Bus, six legs and payload as a nonlinear multibody system in Pinocchio: bodies, joints and closed loops only.

It shares the parameters with :mod:`ps_fmu.mechanism` and nothing else: no Jacobian, mass matrix or linearisation of
the paper.  Bus and payload float freely.  Each leg is two bodies: the lower part on a universal joint at the base, the
upper part on a prismatic joint along the leg; a point constraint closes the loop at the platform's spherical joint.
Modes of bus and truss are further bodies on springs and dampers (:mod:`.oscillators`), and a coarse leg with a soft rod
is one whose prismatic joint has a spring.

Pinocchio gives mass matrix, Coriolis and centrifugal forces and the Jacobians of points.  Of the 30 + k velocities,
with k oscillators, the 18 of payload and universal joints follow from the other 12 + k (:class:`LinearModel` orders
them) through the 18 rows of the loops, so that ``N``, (30 + k, 12 + k), spans the motions that are possible.  At rest
nothing is quadratic in the velocities and the springs are unloaded: ``N' M N`` and the springs ARE the linearisation,
without any difference quotient.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ps_fmu.mechanism.dynamics import Pose
from ps_fmu.mechanism.parameters import CoarseLeg, LegPart, Parameters
from support.multibody.linear import BASE, COARSE, FINE, LinearModel
from support.multibody.oscillators import Oscillator, of_bus_mode, of_truss_mode

Array = NDArray[np.float64]

N_LEGS = 6
N_RIGID = 12  # fine legs 3, base 6, coarse legs 3
CLOSED = 1e-13  # m; the loops count as closed
LARGEST_ITERATIONS = 20


class Prototype:
    """The multibody system.

    Configurations ``q`` and velocities ``v`` are Pinocchio's: bus, payload, then universal and prismatic joint of each
    leg, coarse 1..3 and fine 1..3, and the oscillators.  The coordinate of a prismatic joint is the length of the leg
    between its joints.

    Parameters
    ----------
    parameters: bodies, geometry, and the modes and rod stiffness that are not zero.
    leg_radius: both parts of a leg are given the axial inertia of a solid cylinder of this radius, m.
    """

    def __init__(self, parameters: Parameters, leg_radius: float = 0.0) -> None:
        import pinocchio as pin

        self._pin = pin
        self.parameters = parameters
        self.leg_radius = leg_radius
        geometry = parameters.manipulator.geometry
        model = pin.Model()
        model.gravity = pin.Motion.Zero()
        bus, payload = parameters.bus, parameters.payload
        on_bus = [of_bus_mode(mode) for mode in bus.modes if mode.active]
        on_payload = [of_truss_mode(mode) for mode in payload.truss_modes if mode.active]
        self.oscillators: tuple[Oscillator, ...] = (*on_bus, *on_payload)
        # Depth first, as the mass matrix algorithm needs it: the bus with its legs and modes, then the payload.
        self._bus = self._floating("bus", model, pin.Inertia(bus.mass, bus.com_B, bus.inertia_B), on_bus)
        self._axes_B: list[Array] = []  # of each leg at the nominal pose: x, y those of its universal joint, z along it
        self._lower: list[int] = []
        self._upper: list[int] = []
        legs: tuple[CoarseLeg, ...] = parameters.manipulator.coarse_legs + parameters.manipulator.fine_legs
        for i, leg in enumerate(legs):
            along_B = geometry.nominal_translation_B + leg.platform_joint_P - leg.base_joint_B
            axes_B = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), along_B).toRotationMatrix()
            placement = pin.SE3(axes_B, leg.base_joint_B)
            universal = pin.JointModelUniversal(np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0]))
            lower = model.addJoint(self._bus, universal, placement, f"universal_{i}")
            upper = model.addJoint(lower, pin.JointModelPZ(), pin.SE3.Identity(), f"prismatic_{i}")
            model.appendBodyToJoint(lower, self._part(leg.lower, leg.lower.com_distance), pin.SE3.Identity())
            model.appendBodyToJoint(upper, self._part(leg.upper, -leg.upper.com_distance), pin.SE3.Identity())
            self._axes_B.append(axes_B)
            self._lower.append(lower)
            self._upper.append(upper)
        on_bus_joints = self._oscillating(model, self._bus, on_bus)
        whole = pin.Inertia(payload.mass, payload.com_P, payload.inertia_P)
        self._payload = self._floating("payload", model, whole, on_payload)
        self._oscillating_joints = on_bus_joints + self._oscillating(model, self._payload, on_payload)
        self._ends: list[tuple[int, int]] = []  # frames at the spherical joint: that of the leg, that of the platform
        for i, (leg, upper) in enumerate(zip(legs, self._upper, strict=True)):
            places = (("tip", upper, np.zeros(3)), ("joint", self._payload, leg.platform_joint_P))
            tip, joint = (
                model.addFrame(pin.Frame(f"{name}_{i}", body, pin.SE3(np.eye(3), at), pin.FrameType.OP_FRAME))
                for name, body, at in places
            )
            self._ends.append((tip, joint))
        self.model, self.data = model, model.createData()

    def _floating(self, name: str, model: Any, whole: Any, oscillators: Sequence[Oscillator]) -> int:
        """A body that floats freely, without what its oscillators take of its mass and inertia."""
        pin = self._pin
        joint: int = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), name)
        for oscillator in oscillators:
            at = pin.SE3(np.eye(3), oscillator.position)
            whole = whole - at.act(self._moving(oscillator))
        model.appendBodyToJoint(joint, whole, pin.SE3.Identity())
        return joint

    def _oscillating(self, model: Any, carrier: int, oscillators: Sequence[Oscillator]) -> list[int]:
        pin = self._pin
        joints = []
        for oscillator in oscillators:
            kind = pin.JointModelPrismaticUnaligned if oscillator.slides else pin.JointModelRevoluteUnaligned
            at = pin.SE3(np.eye(3), oscillator.position)
            joint = model.addJoint(carrier, kind(oscillator.axis), at, f"oscillator_{model.njoints}")
            model.appendBodyToJoint(joint, self._moving(oscillator), pin.SE3.Identity())
            joints.append(joint)
        return joints

    def _moving(self, oscillator: Oscillator) -> Any:
        about_axis = oscillator.inertia * np.outer(oscillator.axis, oscillator.axis)
        return self._pin.Inertia(oscillator.mass, np.zeros(3), about_axis)

    def _part(self, part: LegPart, com_z: float) -> Any:
        axial = 0.5 * part.mass * self.leg_radius**2
        inertia = np.diag([part.radial_inertia, part.radial_inertia, axial])
        return self._pin.Inertia(part.mass, np.array([0.0, 0.0, com_z]), inertia)

    @cached_property
    def independent(self) -> NDArray[np.intp]:
        """(12 + k,) places in ``v`` of the motions that determine all others, in the order of :class:`LinearModel`."""
        lengths = [self.model.joints[joint].idx_v for joint in self._upper]
        base = self.model.joints[self._bus].idx_v + np.arange(6)
        oscillators = [self.model.joints[joint].idx_v for joint in self._oscillating_joints]
        return np.array([*lengths[3:], *base, *lengths[:3], *oscillators])

    @cached_property
    def dependent(self) -> NDArray[np.intp]:
        """(18,) places in ``v`` of the motions of payload and universal joints."""
        return np.setdiff1d(np.arange(self.model.nv), self.independent)

    def configuration(self, pose: Pose) -> Array:
        """``q`` of the platform at a pose relative to the base, the base at the origin."""
        q = self._pin.neutral(self.model)
        start = self.model.joints[self._payload].idx_q
        q[start : start + 7] = self._pin.SE3ToXYZQUAT(self._pin.SE3(pose.rotation_BP, pose.translation_B))
        geometry = self.parameters.manipulator.geometry
        for i in range(N_LEGS):
            tip_B = pose.translation_B + pose.rotation_BP @ geometry.platform_joints_P[i]
            along = self._axes_B[i].T @ (tip_B - geometry.base_joints_B[i])
            length = np.linalg.norm(along)
            x, y, z = along / length
            # Rx(a) Ry(b) turns the z axis to (sin b, -sin a cos b, cos a cos b).
            joint = self.model.joints[self._lower[i]].idx_q
            q[joint], q[joint + 1] = np.arctan2(-y, z), np.arcsin(x)
            q[self.model.joints[self._upper[i]].idx_q] = length
        return np.asarray(q)

    def lengths(self, q: Array) -> Array:
        """(6,) lengths of the legs, coarse 1..3 then fine 1..3, m."""
        return np.array([q[self.model.joints[joint].idx_q] for joint in self._upper])

    def gaps(self, q: Array) -> Array:
        """(18,) from the platform's joints to the tips of the legs, inertial axes, m: zero for closed loops."""
        self._pin.framesForwardKinematics(self.model, self.data, q)
        placement = self.data.oMf
        return np.concatenate([placement[tip].translation - placement[joint].translation for tip, joint in self._ends])

    def loops(self, q: Array) -> Array:
        """(18, 30 + k): rates of :meth:`gaps` from ``v``."""
        pin, model, data = self._pin, self.model, self.data
        pin.computeJointJacobians(model, data, q)
        pin.updateFramePlacements(model, data)
        rows = [
            pin.getFrameJacobian(model, data, tip, pin.LOCAL_WORLD_ALIGNED)[:3]
            - pin.getFrameJacobian(model, data, joint, pin.LOCAL_WORLD_ALIGNED)[:3]
            for tip, joint in self._ends
        ]
        return np.vstack(rows)

    def possible_motions(self, q: Array) -> Array:
        """``N``, (30 + k, 12 + k): all velocities from the independent ones."""
        loops = self.loops(q)
        n = len(self.independent)
        N = np.zeros((self.model.nv, n))
        N[self.independent] = np.eye(n)
        N[self.dependent] = -np.linalg.solve(loops[:, self.dependent], loops[:, self.independent])
        return N

    def moved(self, q: Array, motion: Array) -> Array:
        """The configuration after a small motion (30 + k,), m and rad; the loops open to second order."""
        return np.asarray(self._pin.integrate(self.model, q, motion))

    def closed(self, q: Array) -> Array:
        """The configuration with the same base and leg lengths whose loops are closed, by Newton's iteration."""
        for _ in range(LARGEST_ITERATIONS):
            gaps = self.gaps(q)
            if np.abs(gaps).max() < CLOSED:
                return q
            step = np.zeros(self.model.nv)
            step[self.dependent] = -np.linalg.solve(self.loops(q)[:, self.dependent], gaps)
            q = self.moved(q, step)
        raise RuntimeError(f"the loops stay open by {np.abs(gaps).max():.1e} m after {LARGEST_ITERATIONS} iterations")

    def independent_motion(self, q: Array) -> tuple[Array, Array, Array]:
        """Base position (3,) m and quaternion (4,), x y z w, inertial axes, and leg lengths (6,) m, fine legs first."""
        base, lengths = q[self._base], self.lengths(q)
        return base[:3], base[3:], np.concatenate([lengths[3:], lengths[:3]])

    def with_independent_motion(self, q: Array, position: Array, quaternion: Array, lengths: Array) -> Array:
        """The closed configuration near ``q`` with these values, as :meth:`independent_motion` returns them."""
        q = q.copy()
        q[self._base] = np.concatenate([position, quaternion / np.linalg.norm(quaternion)])
        for joint, length in zip(self._upper[3:] + self._upper[:3], lengths, strict=True):
            q[self.model.joints[joint].idx_q] = length
        return self.closed(q)

    @cached_property
    def _base(self) -> slice:
        start = self.model.joints[self._bus].idx_q
        return slice(start, start + 7)

    def linearise(self, pose: Pose) -> LinearModel:
        """About rest at a pose where the fine legs have their nominal length, so that no spring is loaded."""
        q = self.configuration(pose)
        N = self.possible_motions(q)
        mass = N.T @ self._mass(q) @ N
        manipulator = self.parameters.manipulator
        rods, carried = manipulator.coarse_rods, np.diag(mass)[COARSE]  # kg, what moves with one rod, all else held
        stiffness, damping = np.zeros(len(mass)), np.zeros(len(mass))
        stiffness[FINE] = [leg.stiffness for leg in manipulator.fine_legs]
        damping[FINE] = [leg.damping for leg in manipulator.fine_legs]
        stiffness[COARSE] = rods.axial_stiffness
        damping[COARSE] = 2.0 * rods.damping_ratio * np.sqrt(rods.axial_stiffness * carried)
        stiffness[N_RIGID:] = [oscillator.stiffness for oscillator in self.oscillators]
        damping[N_RIGID:] = [oscillator.damping for oscillator in self.oscillators]
        free = np.arange(len(mass))
        if rods.axial_stiffness == 0.0:  # rigid
            free = np.delete(free, COARSE)
        turning = self.model.joints[self._payload].idx_v + 3 + np.arange(3)
        # Pinocchio gives the payload's angular velocity in P.
        return LinearModel(mass, np.diag(damping), np.diag(stiffness), pose.rotation_BP @ N[turning], free)

    def accelerations(
        self, q: Array, v: Array, fine_forces: Array, coarse_accelerations: Array, base_wrench: Array | None = None
    ) -> Array:
        """(12,) accelerations of the independent motions: the nonlinear equations of motion.

        Those of the base are the derivatives of its velocities, in its own axes.

        Parameters
        ----------
        q, v: configuration and velocity, loops closed.
        fine_forces: (3,) N, extending the leg, besides spring and damper.
        coarse_accelerations: (3,) m/s2, prescribed second derivatives of the coarse lengths.
        base_wrench: (6,) force and torque on the base at its origin, its own axes, N and N.m; default: none.

        Raises
        ------
        ValueError: the prototype has modes or soft rods, for which only :meth:`linearise` is made.
        """
        manipulator = self.parameters.manipulator
        if self.oscillators or manipulator.coarse_rods.axial_stiffness > 0.0:
            raise ValueError("the equations of motion over time are for rigid bodies: leave out modes and soft rods")
        pin, model, data = self._pin, self.model, self.data
        N = self.possible_motions(q)
        M = self._mass(q)
        # N' of the independent motions: what closes the loops while none of them accelerates.
        pin.forwardKinematics(model, data, q, v, np.zeros(model.nv))
        pin.updateFramePlacements(model, data)
        apart = [
            pin.getFrameClassicalAcceleration(model, data, tip, pin.LOCAL_WORLD_ALIGNED).linear
            - pin.getFrameClassicalAcceleration(model, data, joint, pin.LOCAL_WORLD_ALIGNED).linear
            for tip, joint in self._ends
        ]
        bias = np.zeros(model.nv)
        bias[self.dependent] = -np.linalg.solve(self.loops(q)[:, self.dependent], np.concatenate(apart))
        quadratic = pin.nonLinearEffects(model, data, q, v)
        force = -N.T @ (quadratic + M @ bias)
        for i, leg in enumerate(manipulator.fine_legs):
            elongation = self.lengths(q)[3 + i] - manipulator.geometry.nominal_lengths[3 + i]
            rate = v[self.independent[i]]
            force[i] += fine_forces[i] - leg.stiffness * elongation - leg.damping * rate
        if base_wrench is not None:
            force[BASE] += base_wrench
        reduced = N.T @ M @ N
        free = slice(0, BASE.stop)
        found = np.empty(N_RIGID)
        found[COARSE] = coarse_accelerations
        found[free] = np.linalg.solve(reduced[free, free], force[free] - reduced[free, COARSE] @ coarse_accelerations)
        return found

    def rotations(self, q: Array) -> tuple[Array, Array]:
        """Of the base to inertial axes and of the platform to axes of the base, (3, 3) each."""
        self._pin.forwardKinematics(self.model, self.data, q)
        base, platform = (self.data.oMi[joint].rotation for joint in (self._bus, self._payload))
        return base.copy(), base.T @ platform

    def energy(self, q: Array, v: Array) -> float:
        """Kinetic energy and that of the fine legs' springs, J."""
        manipulator = self.parameters.manipulator
        stretch = self.lengths(q)[3:] - manipulator.geometry.nominal_lengths[3:]
        springs = 0.5 * sum(leg.stiffness * d**2 for leg, d in zip(manipulator.fine_legs, stretch, strict=True))
        return float(self._pin.computeKineticEnergy(self.model, self.data, q, v) + springs)

    def momentum(self, q: Array, v: Array) -> Array:
        """(6,) linear and angular momentum about the common centre of mass, inertial axes, N.s and N.m.s."""
        return np.array(self._pin.computeCentroidalMomentum(self.model, self.data, q, v).vector)

    def _mass(self, q: Array) -> Array:
        upper = np.triu(self._pin.crba(self.model, self.data, q))
        return np.asarray(upper + np.triu(upper, 1).T)
