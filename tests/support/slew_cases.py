"""Six motions that a linear model about one pose cannot follow, and what a nonlinear multibody program says of them.

Bodies are rigid, the command comes in one step, and forces are held for a millisecond: the plant FMU and the program
then have the same inputs.  ``tests/data/slews.json`` is made by :mod:`support.multibody.slews`.
"""

import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ps_fmu.mechanism.inverse_kinematics import inverse_kinematics
from ps_fmu.mechanism.parameters import CoarseServo, Parameters

from .mechanics import rigid

REFERENCE = Path(__file__).parents[1] / "data" / "slews.json"
STEP = 1e-3  # s, of the plant and its inputs
EVERY = 20  # steps between two entries of the reference
Array = NDArray[np.float64]


def shake(t: float) -> Array:
    """Force (N) and torque (N.m) on the bus in B at its origin over the step that begins at ``t``, s."""
    hz, phase = np.array([7.0, 11.0, 17.0, 5.0, 3.0, 13.0]), np.array([0.0, 1.0, 0.0, 0.0, 2.0, 0.0])
    return np.array([3.0, 2.0, 1.5, 1.0, 1.2, 0.8]) * np.sin(2.0 * np.pi * hz * t + phase)


def leave_alone(t: float) -> Array:
    """No force, no torque."""
    return np.zeros(6)


def turn_over(t: float) -> Array:
    """Torque to about 2 deg/s about x over 2 s, then to the same about y."""
    return np.array([0.0, 0.0, 0.0, 150.0 * (t < 1.9995), 145.0 * (1.9995 < t < 3.9995), 0.0])


@dataclass(frozen=True, eq=False)
class Case:
    """One motion, from rest at zero roll, pitch, yaw or with everything turning as one body."""

    parameters: Parameters
    target_deg: tuple[float, float, float]
    wrench: Callable[[float], Array]
    duration: float  # s
    turn_deg_s: tuple[float, float, float] = (0.0, 0.0, 0.0)

    @property
    def command(self) -> Array:
        """(3,) m, of the coarse legs."""
        geometry = self.parameters.manipulator.geometry
        return np.asarray(inverse_kinematics(geometry, np.radians(self.target_deg)).coarse_displacement)

    @property
    def start_values(self) -> dict[str, float]:
        """Of the plant FMU, names for :class:`support.models.Host`."""
        p, axes = self.parameters, "xyz"
        return {
            **{f"bus__mode_{i}__frequency": 0.0 for i in range(1, 7)},
            **{f"payload__truss_mode_{i}__frequency": 0.0 for i in (1, 2)},
            "coarse_rods__axial_stiffness": 0.0,
            "coarse_stroke__min": -0.03,  # m: three axes at once need 24 mm
            "coarse_stroke__max": 0.03,
            "servo__rate_limit": p.servo.rate_limit,
            "bus__mass": p.bus.mass,
            **{f"bus__com__{axis}": float(p.bus.com_B[i]) for i, axis in enumerate(axes)},
            **{f"bus__inertia__{axis}{axis}": float(p.bus.inertia_B[i, i]) for i, axis in enumerate(axes)},
            **{f"initial_angular_velocity__{axis}": np.radians(self.turn_deg_s[i]) for i, axis in enumerate(axes)},
        }


SLOW = rigid()
FAST = replace(SLOW, servo=CoarseServo(frequency=5.0, damping_ratio=1.0, rate_limit=0.05))
BUS = replace(SLOW.bus, mass=60.0, com_B=np.array([0.0, 0.0, -0.3]), inertia_B=np.diag([4.0, 4.5, 3.5]))
LIGHT = replace(FAST, bus=BUS)
CASES = {
    "4 deg in 2 s": Case(SLOW, (4.0, 0.0, 0.0), shake, 2.2),
    "8.5 deg in 0.6 s": Case(FAST, (8.5, 0.0, 0.0), shake, 1.0),
    "8.5 deg in 0.6 s, bus of 60 kg": Case(LIGHT, (8.5, 0.0, 0.0), shake, 1.0),
    "3, 5, -8 deg in 0.7 s, bus of 60 kg": Case(LIGHT, (3.0, 5.0, -8.0), shake, 1.0),
    "bus at 1 deg/s, yaw 10 deg in 0.5 s": Case(FAST, (0.0, 0.0, 10.0), leave_alone, 1.0, (0.2, 0.5, 0.85)),
    "torque to 2 deg/s about x, then y": Case(SLOW, (0.0, 0.0, 0.0), turn_over, 5.0),
}


def load_reference() -> dict[str, dict[str, Array]]:
    """Of each case: time (n,), base_attitude, payload_attitude (n, 4), fine_displacement, base_acceleration (n, 3)."""
    cases = json.loads(REFERENCE.read_text())["cases"]
    return {name: {key: np.array(values) for key, values in case.items()} for name, case in cases.items()}
