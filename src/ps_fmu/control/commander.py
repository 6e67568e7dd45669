"""Pointing commander: from target orientations to a table of coarse commands, section 2.3 of the paper.

A target is accepted when it and the path to it are reachable; otherwise the motion in hand goes on.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np

from ..mechanism.inverse_kinematics import (
    InversePose,
    Solver,
    descend,
    inverse_kinematics,
    stroke_margin,
    trilaterate,
    why_unreachable,
)
from ..mechanism.kinematics import Geometry, KinematicsError
from ..mechanism.parameters import Manipulator, Parameters
from ..mechanism.quantities import Array, Checked, group, quantity
from .profile import Limits, Profile, State, plan

# Bus modes from 0.45 Hz on and the 5 Hz suspension set these: 8.5 deg take 26 s and leave a 0.45 Hz mode with
# 4e-5 of the angle.
DEFAULT_LIMITS = Limits(max_rate=0.0125, max_acceleration=2e-3, max_jerk=5e-4, min_duration=10.0)  # rad, s

# Targets closer than this are one: hosts that interpolate their inputs vary them by rounding at every step.
TARGET_RESOLUTION = 1e-12  # rad

# Poses of a path that are tried.  Between two of them a leg can go beyond both by 4e-8 m (200 random paths
# through the workspace).
_PATH_POSES = 257


def is_geometric(name: str) -> bool:
    """Whether the kinematics needs a parameter of the manipulator."""
    return name.startswith(("nominal_translation", "coarse_stroke")) or "_joint." in name


@dataclass(frozen=True)
class Algorithm1(Checked):
    """Settings of the paper's Algorithm 1 (:func:`.inverse_kinematics.descend`)."""

    mu: float = quantity(
        "1", "Step size of Algorithm 1, which converges below 2/lambda_max(J J^T), about 0.81", above=0.0
    )
    epsilon: float = quantity(
        "m", "Error limit of Algorithm 1; 1e-6 m leaves up to 4e-4 deg, 1e-11 m below 1e-8 deg", above=0.0
    )
    max_iterations: int = quantity("1", "Iterations after which Algorithm 1 gives up", at_least=1)

    def solver(self) -> Solver:
        """Algorithm 1 with these settings, for :func:`.inverse_kinematics.inverse_kinematics`."""
        return partial(descend, mu=self.mu, epsilon=self.epsilon, max_iterations=self.max_iterations)


DEFAULT_ALGORITHM_1 = Algorithm1(mu=0.73, epsilon=1e-6, max_iterations=500)


@dataclass(frozen=True, eq=False)
class Decision:
    """What becomes of a target."""

    profile: Profile
    """The motion from now on: a new one, or the one in hand if the target was refused."""
    refusal: str | None
    """Why the target was refused; None: accepted."""
    retry: bool = False
    """Only the path is unreachable, from a start in motion: worth another try when the motion has ended."""


@dataclass(frozen=True, eq=False)
class Commander:
    """Plans motions and computes their commands; without state of its own.

    Its scalars are the parameters of the FMU.
    """

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

    @cached_property
    def solver(self) -> Solver:
        """The chosen method of inverse kinematics."""
        return self.algorithm_1.solver() if self.use_algorithm_1 else trilaterate

    def begin(self, target: Array) -> Decision:
        """Rest at the target; at the nominal pose if the target is unreachable."""
        refusal = self.refusal(target)
        return Decision(Profile.hold(target if refusal is None else np.zeros(3)), refusal)

    def redirect(self, profile: Profile, time: float, target: Array) -> Decision:
        """A new target at ``time`` (s), (3,) rad."""
        refusal = self.refusal(target)
        if refusal is not None:
            return Decision(profile, refusal)
        if same_target(target, profile.target):
            return Decision(profile, None)
        if self.follow:
            return Decision(Profile.hold(target, time), None)
        new = plan(time, profile.at(time), target, self.limits)
        refusal = self.refusal(new.at(np.linspace(time, new.end_time, _PATH_POSES)).position)
        if refusal is not None:
            return Decision(profile, f"on the way, {refusal}", retry=bool(profile.remaining(time) > 0.0))
        return Decision(new, None)

    def refusal(self, orientation: Array) -> str | None:
        """Why the first unreachable of these orientations, (..., 3) rad, is so; None: all are reachable."""
        try:
            return why_unreachable(self.geometry, self.pose(orientation))
        except KinematicsError as error:  # Algorithm 1 did not converge
            return str(error)

    def pose(self, orientation: Array) -> InversePose:
        """Inverse kinematics by the chosen method, (..., 3) rad."""
        return inverse_kinematics(self.geometry, orientation, self.solver)

    def table(self, profile: Profile, times: Array) -> Array:
        """Commands at the times (n,) s, one row each; a row depends on its own time alone.

        Returns
        -------
        (n, 15): coarse displacement (3, m), orientation (3, rad), its rate (3, rad/s), platform position in B
        (3, m), residual (m), smallest stroke margin (m), time until rest (s).
        """
        if len(times) > 1 and times[0] >= profile.end_time:
            # At rest all rows are one: 0.1 instead of 1.4 us each.
            return np.repeat(self.table(profile, times[:1]), len(times), axis=0)
        position, rate = profile.motion_at(times)
        pose = self.pose(position)
        # A path may touch an end of the stroke: what rounding and the sampled check let pass is cut off.
        coarse = np.clip(pose.coarse_displacement, *self.geometry.coarse_stroke)
        margin = np.min(stroke_margin(self.geometry, coarse), axis=-1)
        return np.column_stack([
            coarse, position, rate, pose.translation_B,
            pose.residual, margin, profile.remaining(times),
        ])  # fmt: skip


def same_target(a: Array, b: Array) -> bool:
    """Whether two targets, (3,) rad, are one."""
    return bool(np.all(np.abs(a - b) <= TARGET_RESOLUTION))


#: Numbers that a profile is kept in.
N_PROFILE = 18


def to_numbers(profile: Profile) -> Array:
    """A profile as N_PROFILE numbers, for the FMU state."""
    times = (profile.start_time, profile.brake, profile.transfer)
    return np.concatenate([times, *profile.start, profile.target])


def from_numbers(numbers: Array) -> Profile:
    """Inverse of :func:`to_numbers`."""
    start_time, brake, transfer = (float(number) for number in numbers[:3])
    *start, target = np.array(numbers[3:N_PROFILE]).reshape(5, 3)
    return Profile(start_time, brake, transfer, State(*start), target)
