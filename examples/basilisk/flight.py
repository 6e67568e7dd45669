"""A spacecraft in Basilisk that carries the manipulator: free, or with reaction wheels that hold an attitude."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from Basilisk.architecture import messaging, sysModel
from Basilisk.fswAlgorithms import attTrackingError, inertial3D, mrpFeedback, rwMotorTorque
from Basilisk.simulation import extForceTorque, reactionWheelStateEffector, simpleNav, spacecraft
from Basilisk.utilities import SimulationBaseClass, macros, simIncludeRW
from coupling import NANOSECOND, Body, Manipulator, Mounting
from fmu import Array

DYNAMICS, SOFTWARE = "dynamics", "software"
SOFTWARE_STEP = 0.05  # s
#: Spin axes of four wheels, a pyramid of 45 deg.
WHEEL_AXES_H = np.array([[1.0, 0.0, 1.0], [0.0, 1.0, 1.0], [-1.0, 0.0, 1.0], [0.0, -1.0, 1.0]]) / np.sqrt(2.0)
WHEEL_SPEEDS = np.array([900.0, -1000.0, 1100.0, -1200.0])  # rpm, at the start


def make_cube(mass: float) -> Body:
    """A homogeneous cube of 150 kg/m3 with the manipulator on the middle of a face: in B."""
    side = (mass / 150.0) ** (1.0 / 3.0)  # m
    return Body(mass, np.array([0.0, 0.0, -0.5 * side]), mass * side**2 / 6.0 * np.eye(3))


def move_body(body: Body, mounting: Mounting) -> Body:
    """A body that is given in B, in the hub's frame H."""
    turn = mounting.rotation_HB
    return Body(body.mass, mounting.origin_H + turn @ body.com, turn @ body.inertia @ turn.T)


class Wrench(sysModel.SysModel):
    """Force and torque on the hub, a function of time, held over each step at its value in the step's middle.

    ``wrench(t)``: (6,) N and N.m, in B at its origin.
    """

    def __init__(self, wrench: Callable[[float], Array], step: float, mounting: Mounting) -> None:
        super().__init__()
        self.ModelTag = "wrench"
        self.forceOutMsg = messaging.CmdForceBodyMsg()
        self.torqueOutMsg = messaging.CmdTorqueBodyMsg()
        self._wrench, self._step, self._mounting = wrench, step, mounting

    def Reset(self, CurrentSimNanos: int) -> None:
        """Basilisk's, at the start."""
        self.UpdateState(CurrentSimNanos)

    def UpdateState(self, CurrentSimNanos: int) -> None:
        """Basilisk's, before the spacecraft steps up to this time."""
        wrench = self._wrench(CurrentSimNanos * NANOSECOND - 0.5 * self._step)
        force, torque = self._mounting.move_wrench(wrench)
        now, module = CurrentSimNanos, self.moduleID
        self.forceOutMsg.write(messaging.CmdForceBodyMsgPayload(forceRequestBody=force.tolist()), now, module)
        self.torqueOutMsg.write(messaging.CmdTorqueBodyMsgPayload(torqueRequestBody=torque.tolist()), now, module)


class Flight:
    """One run: build it, :meth:`push` or :meth:`hold_attitude`, then :meth:`run`.

    Parameters
    ----------
    manipulator: on the hub.
    hub: without the manipulator, in H.
    step: of dynamics and FMUs, s.
    omega_H: angular velocity at the start, rad/s.
    """

    def __init__(self, manipulator: Manipulator, hub: Body, step: float, omega_H: Array | None = None) -> None:
        self._manipulator, self._step = manipulator, step
        self._sim = SimulationBaseClass.SimBaseClass()
        self._sim.SetProgressBar(False)
        process = self._sim.CreateNewProcess("flight")
        process.addTask(self._sim.CreateNewTask(DYNAMICS, macros.sec2nano(step)))
        process.addTask(self._sim.CreateNewTask(SOFTWARE, macros.sec2nano(SOFTWARE_STEP)))
        self._craft = spacecraft.Spacecraft()
        self._craft.ModelTag = "craft"
        manipulator.load_hub(self._craft, hub)
        whole = hub + manipulator.locked_H()
        self._inertia_H = whole.inertia
        turning = np.zeros(3) if omega_H is None else omega_H
        # The origin of H is at rest at the inertial origin, or the common centre of mass is.
        self._craft.hub.r_CN_NInit = whole.com.reshape(3, 1).tolist()
        self._craft.hub.v_CN_NInit = [[0.0], [0.0], [0.0]]
        self._craft.hub.omega_BN_BInit = turning.reshape(3, 1).tolist()
        manipulator.scStateInMsg.subscribeTo(self._craft.scStateOutMsg)
        self._kept = [self._add_effector(manipulator, 40)]  # Basilisk does not keep its modules alive
        self._sim.AddModelToTask(DYNAMICS, self._craft, 30)
        self._sim.AddModelToTask(DYNAMICS, manipulator, 20)

    def _add_effector(self, source: Manipulator | Wrench, priority: int) -> extForceTorque.ExtForceTorque:
        effector = extForceTorque.ExtForceTorque()
        effector.cmdForceBodyInMsg.subscribeTo(source.forceOutMsg)
        effector.cmdTorqueInMsg.subscribeTo(source.torqueOutMsg)
        self._craft.addDynamicEffector(effector)
        self._sim.AddModelToTask(DYNAMICS, effector, priority)
        return effector

    def push(self, wrench: Callable[[float], Array], mounting: Mounting) -> None:
        """Let a wrench act on the hub, see :class:`Wrench`."""
        source = Wrench(wrench, self._step, mounting)
        self._sim.AddModelToTask(DYNAMICS, source, 50)
        self._kept += [source, self._add_effector(source, 41)]

    def hold_attitude(self, sigma_RN: Array) -> None:
        """Four unbalanced wheels and an attitude controller that turns the hub to ``sigma_RN`` (MRP)."""
        factory = simIncludeRW.rwFactory()
        for axis, speed in zip(WHEEL_AXES_H, WHEEL_SPEEDS, strict=True):
            factory.create(
                "Honeywell_HR16", axis.tolist(), maxMomentum=50.0, Omega=speed, RWModel=messaging.JitterSimple
            )  # N.m.s, rpm
        wheels = reactionWheelStateEffector.ReactionWheelStateEffector()
        factory.addToSpacecraft("wheels", wheels, self._craft)
        self._sim.AddModelToTask(DYNAMICS, wheels, 35)

        navigation = simpleNav.SimpleNav()
        navigation.scStateInMsg.subscribeTo(self._craft.scStateOutMsg)
        reference = inertial3D.inertial3D()
        reference.sigma_R0N = sigma_RN.tolist()
        error = attTrackingError.attTrackingError()
        error.attNavInMsg.subscribeTo(navigation.attOutMsg)
        error.attRefInMsg.subscribeTo(reference.attRefOutMsg)
        control = mrpFeedback.mrpFeedback()
        control.guidInMsg.subscribeTo(error.attGuidOutMsg)
        vehicle = messaging.VehicleConfigMsg().write(
            messaging.VehicleConfigMsgPayload(ISCPntB_B=self._inertia_H.ravel().tolist())
        )
        control.vehConfigInMsg.subscribeTo(vehicle)
        # Closed loop of 0.04 Hz, damping ratio 1: theta = 4 sigma for small angles.
        natural, inertia = 2.0 * np.pi * 0.04, float(np.trace(self._inertia_H)) / 3.0  # rad/s, kg.m2
        control.K, control.P, control.Ki = 4.0 * inertia * natural**2, 2.0 * inertia * natural, -1.0  # no integral
        control.integralLimit = 0.0
        motors = rwMotorTorque.rwMotorTorque()
        motors.controlAxes_B = np.eye(3).ravel().tolist()
        motors.vehControlInMsg.subscribeTo(control.cmdTorqueOutMsg)
        parameters = factory.getConfigMessage()
        motors.rwParamsInMsg.subscribeTo(parameters)
        control.rwParamsInMsg.subscribeTo(parameters)
        control.rwSpeedsInMsg.subscribeTo(wheels.rwSpeedOutMsg)
        wheels.rwMotorCmdInMsg.subscribeTo(motors.rwMotorTorqueOutMsg)
        for priority, module in zip((9, 8, 7, 6, 5), (navigation, reference, error, control, motors), strict=True):
            self._sim.AddModelToTask(SOFTWARE, module, priority)
        self._kept += [factory, wheels, navigation, reference, error, control, motors, vehicle, parameters]

    def run(self, duration: float) -> None:
        """Fly for ``duration``, s."""
        self._sim.InitializeSimulation()
        self._sim.ConfigureStopTime(macros.sec2nano(duration))
        self._sim.ExecuteSimulation()
