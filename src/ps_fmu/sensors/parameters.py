"""Parameters of inertial sensors: what all of a kind share, and what each has of its own.

Figures of a data sheet belong to a kind.  The constant errors of each sensor are its own values, and a random part
from the spread of its kind: drawn from the seed, as a unit from the shelf has them.  The bandwidth is that of a
low-pass of first or second order, discretised exactly for an input held over a step.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ..mechanism.quantities import Array, Checked, Complex, ParameterError, check_number, quantity
from .errors import NoiseModel

DAMPING = float(np.sqrt(0.5))  # of the second order: Butterworth, -3 dB at the bandwidth


@dataclass(frozen=True)
class SensorLowpass:
    """``x' = A x + b u``, ``y = x_1``, static gain one; x has two components, of which the first order needs one."""

    bandwidth: float
    """At which the gain is -3 dB, Hz; 0: none, the output is the input."""
    order: int
    """1 or 2."""

    @property
    def matrices(self) -> tuple[Array, Array]:
        """A (2, 2) and b (2,); without bandwidth zeros."""
        omega = 2.0 * np.pi * self.bandwidth
        if self.order == 1 or not omega:
            return np.diag([-omega, 0.0]), np.array([omega, 0.0])
        return omega * np.array([[0.0, 1.0], [-1.0, -2.0 * DAMPING]]), np.array([0.0, omega])

    def discretise(self, h: float) -> tuple[Array, Array]:
        """(2, 2) and (2,): ``x(t + h) = Ad x(t) + bd u`` with u held over a step of ``h``, s.

        In closed form, so that an FMU needs no scipy.  Without bandwidth x_1 is the input.
        """
        if not self.bandwidth:
            return np.zeros((2, 2)), np.array([1.0, 0.0])
        omega = 2.0 * np.pi * self.bandwidth
        if self.order == 1:
            decay = float(np.exp(-omega * h))
            return np.array([[decay, 0.0], [0.0, 0.0]]), np.array([1.0 - decay, 0.0])
        damped, decay = omega * np.sqrt(1.0 - DAMPING**2), float(np.exp(-DAMPING * omega * h))
        cosine, sine = np.cos(damped * h), np.sin(damped * h) * omega / damped
        # States: the output and its rate over omega, so that both have the size of the input.
        Ad = decay * np.array([[cosine + DAMPING * sine, sine], [-sine, cosine - DAMPING * sine]])
        return Ad, np.array([1.0 - Ad[0, 0], -Ad[1, 0]])

    def response(self, s: Complex) -> Complex:
        """Gain at complex frequencies (...), rad/s, in continuous time."""
        s = np.asarray(s, dtype=complex)
        if not self.bandwidth:
            return np.ones_like(s)
        p = s / (2.0 * np.pi * self.bandwidth)
        return 1.0 / (p + 1.0) if self.order == 1 else 1.0 / (p * p + 2.0 * DAMPING * p + 1.0)

    def sampled_response(self, frequency: Array, h: float) -> Complex:
        """Gain at frequencies (n,), Hz, from an input held over steps of ``h``, s, to the output at their ends.

        A step later than the input: it holds the delay of an exchange once in a step.
        """
        Ad, bd = self.discretise(h)
        z = np.exp(2j * np.pi * np.asarray(frequency) * h)
        return np.asarray(np.linalg.solve(z[:, None, None] * np.eye(2) - Ad, bd[:, None].astype(complex))[:, 0, 0])


SMALL_ANGLE = 0.2  # rad: beyond it a misalignment is another direction
LARGEST_SCALE_ERROR = 0.5


class SensorKind(Checked):
    """Base of the two kinds: bandwidth, noise, range, resolution, and the spread of constant errors."""

    bandwidth: float
    order: int
    noise_density: float
    bias_instability: float
    random_walk: float
    range: float
    resolution: float
    bias_spread: float
    scale_factor_spread: float
    misalignment_spread: float

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.range and self.range < self.resolution:
            raise ParameterError("range", f"{self.range:g} is below the resolution, {self.resolution:g}")

    @property
    def lowpass(self) -> SensorLowpass:
        """Its bandwidth."""
        return SensorLowpass(self.bandwidth, self.order)

    @property
    def noise(self) -> NoiseModel:
        """Its random error."""
        return NoiseModel(self.noise_density, self.bias_instability, self.random_walk)


@dataclass(frozen=True, eq=False)
class AccelerometerKind(SensorKind):
    """What all accelerometers share."""

    bandwidth: float = quantity("Hz", "Frequency at which the gain is -3 dB; 0 = no limit", at_least=0.0)
    order: int = quantity("1", "Order of the low-pass: 1, or 2 (Butterworth)", at_least=1, at_most=2)
    noise_density: float = quantity(
        "m/s2/sqrt(Hz)", "White noise, one-sided density; velocity random walk times sqrt(2)", at_least=0.0
    )
    bias_instability: float = quantity(
        "m/s2", "Level B of flicker noise; the lowest Allan deviation is 0.664 B", at_least=0.0
    )
    random_walk: float = quantity("m/s2/sqrt(s)", "Acceleration random walk K", at_least=0.0)
    range: float = quantity("m/s2", "Largest magnitude of a reading; 0 = no limit", at_least=0.0)
    resolution: float = quantity("m/s2", "Quantisation step of a reading; 0 = none", at_least=0.0)
    bias_spread: float = quantity("m/s2", "Standard deviation of the constant bias among sensors", at_least=0.0)
    scale_factor_spread: float = quantity(
        "1", "Standard deviation of the relative error of the scale factor among sensors", at_least=0.0, at_most=0.1
    )
    misalignment_spread: float = quantity(
        "rad", "Standard deviation of the misalignment about each axis among sensors", at_least=0.0, at_most=0.05
    )


@dataclass(frozen=True, eq=False)
class RateSensorKind(SensorKind):
    """What the three rate sensors share, along x, y and z of B."""

    enabled: bool = quantity(
        "", "True: three rate sensors measure; false: their readings and estimated_angular_velocity are 0"
    )
    bandwidth: float = quantity("Hz", "Frequency at which the gain is -3 dB; 0 = no limit", at_least=0.0)
    order: int = quantity("1", "Order of the low-pass: 1, or 2 (Butterworth)", at_least=1, at_most=2)
    noise_density: float = quantity(
        "rad/s/sqrt(Hz)", "White noise, one-sided density; angle random walk times sqrt(2)", at_least=0.0
    )
    bias_instability: float = quantity(
        "rad/s", "Level B of flicker noise; the lowest Allan deviation is 0.664 B", at_least=0.0
    )
    random_walk: float = quantity("rad/s/sqrt(s)", "Rate random walk K", at_least=0.0)
    range: float = quantity("rad/s", "Largest magnitude of a reading; 0 = no limit", at_least=0.0)
    resolution: float = quantity("rad/s", "Quantisation step of a reading; 0 = none", at_least=0.0)
    bias_spread: float = quantity("rad/s", "Standard deviation of the constant bias among sensors", at_least=0.0)
    scale_factor_spread: float = quantity(
        "1", "Standard deviation of the relative error of the scale factor among sensors", at_least=0.0, at_most=0.1
    )
    misalignment_spread: float = quantity(
        "rad", "Standard deviation of the misalignment about each axis among sensors", at_least=0.0, at_most=0.05
    )


class OneSensor(Checked):
    """Base of a single sensor: its constant errors, and the true direction of its axis."""

    bias: float
    scale_factor_error: float
    misalignment_B: Array

    def __post_init__(self) -> None:
        super().__post_init__()
        if np.abs(self.misalignment_B).max() > SMALL_ANGLE:
            raise ParameterError(
                "misalignment", f"expected small angles, up to {SMALL_ANGLE:g} rad, got {self.misalignment_B.tolist()}"
            )
        limit = LARGEST_SCALE_ERROR
        check_number(self.scale_factor_error, "scale_factor_error", at_least=-limit, at_most=limit)


@dataclass(frozen=True, eq=False)
class Accelerometer(OneSensor):
    """One accelerometer with a single axis."""

    enabled: bool = quantity("", "True: there is a sensor at this position")
    position_B: Array = quantity("m", "Position of the sensor from the origin of B, in B", shape=(3,))
    direction_B: Array = quantity("1", "Direction of the sensitive axis, of any length above 0, in B", shape=(3,))
    bias: float = quantity("m/s2", "Constant error of the reading")
    scale_factor_error: float = quantity("1", "Relative error of the scale factor", at_least=-0.5, at_most=0.5)
    misalignment_B: Array = quantity("rad", "Small rotation of the true axis from the stated one, in B", shape=(3,))

    def __post_init__(self) -> None:
        super().__post_init__()
        length = float(np.linalg.norm(self.direction_B))
        if self.enabled and not length > 0.0:
            raise ParameterError("direction", "must not be zero")

    @property
    def axis_B(self) -> Array:
        """Unit vector of its stated direction, (3,)."""
        length = float(np.linalg.norm(self.direction_B))
        return np.asarray(self.direction_B / length) if length else np.zeros(3)


@dataclass(frozen=True, eq=False)
class RateSensor(OneSensor):
    """One rate sensor with a single axis."""

    AXES: ClassVar[int] = 3

    bias: float = quantity("rad/s", "Constant error of the reading")
    scale_factor_error: float = quantity("1", "Relative error of the scale factor", at_least=-0.5, at_most=0.5)
    misalignment_B: Array = quantity("rad", "Small rotation of the true axis from that of B, in B", shape=(3,))
