"""Pointing commander: from target orientations to coarse commands, section 2.3 of the paper.

A target is accepted when it and the path to it are reachable; otherwise the motion in hand goes on.  Parameters are
here; the steps are C, ``native/control/commander.c``, and their motion profiles ``native/control/profile.c``.
"""

from __future__ import annotations

import ctypes
from ctypes import c_double, c_int64
from dataclasses import dataclass

from ..mechanism.inverse_kinematics import (
    N_GEOMETRY,
    TRILATERATION,
    Method,
    inverse_kinematics,
    make_algorithm_1,
    pack_geometry,
    why_unreachable,
)
from ..mechanism.kinematics import Geometry, KinematicsError
from ..mechanism.parameters import Manipulator, Parameters
from ..mechanism.quantities import Array, Checked, group, quantity


def is_geometric(name: str) -> bool:
    """Whether the kinematics needs a parameter of the manipulator."""
    return name.startswith(("nominal_translation", "coarse_stroke")) or "_joint." in name


@dataclass(frozen=True)
class Algorithm1(Checked):
    """Settings of the paper's Algorithm 1 (:mod:`.inverse_kinematics`)."""

    mu: float = quantity(
        "1", "Step size of Algorithm 1, which converges below 2/lambda_max(J J^T), about 0.81", above=0.0
    )
    epsilon: float = quantity(
        "m", "Error limit of Algorithm 1; 1e-6 m leaves up to 4e-4 deg, 1e-11 m below 1e-8 deg", above=0.0
    )
    max_iterations: int = quantity("1", "Iterations after which Algorithm 1 gives up", at_least=1)

    def method(self) -> Method:
        """Algorithm 1 with these settings, for :func:`.inverse_kinematics.inverse_kinematics`."""
        return make_algorithm_1(self.mu, self.epsilon, self.max_iterations)


DEFAULT_ALGORITHM_1 = Algorithm1(mu=0.73, epsilon=1e-6, max_iterations=500)


@dataclass(frozen=True)
class Limits(Checked):
    """What a profile may demand; each limit holds for the Euclidean norm over roll, pitch and yaw."""

    max_rate: float = quantity("rad/s", "Largest rate of the commanded orientation", above=0.0, display="deg/s")
    max_acceleration: float = quantity(
        "rad/s2", "Largest second derivative of the commanded orientation", above=0.0, display="deg/s2"
    )
    max_jerk: float = quantity("rad/s3", "Largest third derivative of the commanded orientation", above=0.0)
    min_duration: float = quantity("s", "Shortest duration of any motion", at_least=0.0)


# Bus modes from 0.45 Hz on and the 5 Hz suspension set these: 8.5 deg take 26 s and leave a 0.45 Hz mode with
# 4e-5 of the angle.
DEFAULT_LIMITS = Limits(max_rate=0.0125, max_acceleration=2e-3, max_jerk=5e-4, min_duration=10.0)  # rad, s


@dataclass(frozen=True, eq=False)
class Commander:
    """Its scalars are the parameters of the FMU."""

    manipulator: Manipulator = group(flat=True, keep=is_geometric)
    limits: Limits = group(flat=True)
    algorithm_1: Algorithm1 = group()
    use_algorithm_1: bool = quantity(
        "", "True: inverse kinematics by the paper's Algorithm 1; false: closed-form trilateration"
    )
    follow: bool = quantity(
        "", "True: the command follows the target at once, without a profile; for hosts with smooth targets"
    )

    @classmethod
    def from_parameters(cls, p: Parameters) -> Commander:
        """The commander of a parameter set, with the default limits and the closed-form kinematics."""
        return cls(p.manipulator, DEFAULT_LIMITS, DEFAULT_ALGORITHM_1, use_algorithm_1=False, follow=False)

    @property
    def geometry(self) -> Geometry:
        """Joints, nominal pose and stroke."""
        return self.manipulator.geometry

    @property
    def method(self) -> Method:
        """The chosen method of inverse kinematics."""
        return self.algorithm_1.method() if self.use_algorithm_1 else TRILATERATION

    def refusal(self, orientation: Array) -> str | None:
        """Why the first unreachable of these orientations, (..., 3) rad, is so; None: all are reachable."""
        try:
            return why_unreachable(self.geometry, inverse_kinematics(self.geometry, orientation, self.method))
        except KinematicsError as error:  # Algorithm 1 did not converge
            return str(error)

    def pack(self, resolution: float, *, target: int, memory: int, outputs: int) -> CommanderWords:
        """What the steps in C take: the resolution of the coarse commands (m) and places in the buffer."""
        limits = self.limits.max_rate, self.limits.max_acceleration, self.limits.max_jerk, self.limits.min_duration
        geometry = (c_double * N_GEOMETRY)(*pack_geometry(self.geometry))
        return CommanderWords(
            geometry, self.method, (c_double * 4)(*limits), resolution, self.follow, target, memory, outputs
        )


class CommanderWords(ctypes.Structure):
    """``Commander`` of ``native/control/commander.c``."""

    _fields_ = (
        ("geometry", c_double * N_GEOMETRY), ("method", Method), ("limits", c_double * 4), ("resolution", c_double),
        ("follow", c_int64), ("target", c_int64), ("memory", c_int64), ("outputs", c_int64),
    )  # fmt: skip


#: Numbers of ``Memory`` there, the state of the commander.
N_MEMORY = 18 + 1 + 1 + 3 + 1
