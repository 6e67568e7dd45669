"""What is left of the payload's jitter behind an isolator with real accelerometers, in closed form.

With H(s) from true to estimated base motion, one factor for all accelerometers of a kind, and n the error of the
estimate, the fine forces are ``f = K_we (H s^2 q_b + n)``, and the payload's rotation in axes of P is::

    theta = (B + A F (E - C F)^-1 D) w_b + A (E - K_we H s^2 C)^-1 K_we n        F = K_we H s^2

times the sensitivity S = (E + L)^-1 of a line-of-sight loop, if there is one (:mod:`.line_of_sight`).  n has the
density ``P diag(S_k) P^T`` with the least-squares matrix P of the geometry and S_k of each sensor.

The frequencies are fixed, so that what the plant does is computed once for all high-pass filters and sensors.  H is
exact for the sampled filters at the communication step: a step late, as the exchange makes it.  What the step does
besides is the delay of the loop, 1.5 steps.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..control.pointing import PointingFilter
from ..disturbance import psd_at_origin
from ..mechanism.parameters import Bus, Noise
from ..mechanism.quantities import Array, Complex
from ..sensors.inertial import ACCELEROMETERS, InertialSensors
from .line_of_sight import Timing, hold_mean
from .loop import Loop
from .sampled import LOOP_DELAY
from .stability import count_poles
from .transfer_matrices import Practical, place_frequencies

Pointing = tuple[PointingFilter, Timing] | None
"""Controller and timing of a line-of-sight loop; None: there is none."""
LOWEST, HIGHEST = 1e-4, 2e3  # Hz, of the integrals: below, the high-passed errors add less than 1 %
_LINE = (1e-7, 5e3)  # Hz, of the curve that poles are counted by
_MANY = 400  # frequencies
AT_REST = 1e-3  # of the high-pass frequency: there the high-pass passes what is constant to 1e-6


@dataclass(frozen=True, eq=False)
class SensedIsolation:
    """Plant, isolator and disturbance at one pose, with what the plant does at fixed frequencies."""

    loop: Loop
    bus: Bus
    noise: Noise
    step: float
    """Of communication, s."""
    points: int = 1200
    """Of the grid of frequencies, besides those around the resonances."""
    lines: Array | None = None
    """Frequencies, (n,), Hz, in place of that grid: of the lines of a multisine."""

    @cached_property
    def frequency(self) -> Array:
        """(n,), Hz, dense around the resonances of the plant and at the edges of the disturbance's band."""
        if self.lines is not None:
            return self.lines
        grid = place_frequencies(self.loop.plant_poles(), LOWEST, HIGHEST, self.points, 40)
        edges = np.concatenate([self.noise.band * (1.0 - 1e-9), self.noise.band * (1.0 + 1e-9)])
        return np.unique(np.concatenate([grid, edges[(edges > LOWEST) & (edges < HIGHEST)]]))

    def solve(self, sensors: InertialSensors | None, highpass: float, pointing: Pointing = None) -> Responses:
        """The transfer matrices to the payload's rotation; :meth:`is_stable` says whether they mean anything.

        Parameters
        ----------
        sensors: None: the isolator is off.
        highpass: frequency of its high-pass, Hz.
        pointing: controller and timing of a line-of-sight loop; None: there is none.
        """
        (A, B, _, D), eye = self._find_plant(self._s), np.eye(3)
        loops = self._close(self._s, sensors, highpass, pointing)
        to_wrench, to_noise = B + A @ loops.inner @ loops.F @ D, A @ loops.inner @ loops.K
        to_target: Complex = np.zeros((len(self._s), 3, 3), dtype=complex)
        if pointing is not None:
            S = np.linalg.inv(eye + loops.L)
            to_noise, to_wrench, to_target = S @ to_noise, S @ to_wrench, S @ loops.L
        return Responses(self, to_wrench, to_noise, to_target, sensors, highpass, pointing)

    def is_stable(self, sensors: InertialSensors | None, highpass: float, pointing: Pointing = None) -> bool:
        """Whether the closed loops have no pole in the right half-plane; arguments as in :meth:`solve`."""
        at_rest = 0 if pointing is None else 3 * pointing[0].integrators

        def characteristic(s: Complex) -> Complex:
            loops = self._close(s, sensors, highpass, pointing)
            outer = np.linalg.det(np.eye(3) + loops.L) * (s / (s + 1.0)) ** at_rest
            return np.asarray(outer / np.linalg.det(loops.inner))

        return count_poles(characteristic, self._line) == 0

    def _close(self, s: Complex, sensors: InertialSensors | None, highpass: float, pointing: Pointing) -> _Loops:
        """What closes the loops at s (n,), rad/s."""
        A, _, C, _ = self._find_plant(s)
        K = F = np.zeros((len(s), 3, 6), dtype=complex)
        inner, L = np.tile(np.eye(3, dtype=complex), (len(s), 1, 1)), np.zeros((1, 3, 3), dtype=complex)
        if sensors is not None:
            K = self._control(s, highpass)
            F = K * (s**2 * sensing_response(sensors, s.imag / (2.0 * np.pi), self.step))[:, None, None]
            inner = np.linalg.inv(np.eye(3) - F @ C)
        if pointing is not None:
            control, timing = pointing
            L = A @ inner @ control.response(s) * timing.factor(s)[:, None, None]
        return _Loops(np.asarray(K), np.asarray(F), np.asarray(inner), np.asarray(L))

    @cached_property
    def wrench_density(self) -> Array:
        """Of the disturbance at the origin of B, one-sided, (n, 6, 6)."""
        low, high = self.noise.band
        within = (self.frequency >= low) & (self.frequency <= high)
        return np.asarray(within[:, None, None] * psd_at_origin(self.noise.wrench_psd_B, self.bus.com_B))

    @cached_property
    def _s(self) -> Complex:
        return np.asarray(2j * np.pi * self.frequency)

    @cached_property
    def _line(self) -> Array:
        """Frequencies, Hz, of the curve that poles are counted by."""
        return place_frequencies(self.loop.plant_poles(), *_LINE, 150, 8)

    def _find_plant(self, s: Complex) -> tuple[Complex, Complex, Complex, Complex]:
        """A, B in axes of P, C and D, at s (n,), rad/s.  Kept where there are many frequencies: they come again."""
        key = s.tobytes()
        if (known := self._known.get(key)) is not None:
            return known
        A, B, C, D = Practical(self.loop.model.dynamics).all(s)
        to_P = self.loop.model.dynamics.pose.rotation_BP.T
        found = np.asarray(to_P @ A), np.asarray(to_P @ B), C, D
        if len(s) > _MANY:
            self._known[key] = found
        return found

    @cached_property
    def _known(self) -> dict[bytes, tuple[Complex, Complex, Complex, Complex]]:
        return {}

    def _control(self, s: Complex, highpass: float) -> Complex:
        """K_we(s) with its delay, from acceleration to force, (n, 3, 6)."""
        controller = self.loop.controller
        tuned = replace(controller, filters=replace(controller.filters, highpass_frequency=highpass))
        delayed = np.exp(-s * (self.loop.delay + LOOP_DELAY * self.step))
        return np.asarray(tuned.response(s) * delayed[:, None, None])


@dataclass(frozen=True, eq=False)
class _Loops:
    """What closes the loops of isolator and tracker, at n frequencies."""

    K: Complex
    """From acceleration to force, (n, 3, 6); 0: the isolator is off."""
    F: Complex
    """From base displacement to force, (n, 3, 6)."""
    inner: Complex
    """(E - F C)^-1, (n, 3, 3)."""
    L: Complex
    """Transfer of the line-of-sight loop, (n, 3, 3) or (1, 3, 3): there is none."""


@dataclass(frozen=True, eq=False)
class Responses:
    """Transfer matrices to the payload's rotation (rad, P) at the frequencies of an isolation, and what they pass."""

    isolation: SensedIsolation
    to_wrench: Complex
    """From the wrench on the base (N, N.m; B at its origin), (n, 3, 6)."""
    to_noise: Complex
    """From the error of the estimated base motion (m/s2, rad/s2; B), (n, 3, 6)."""
    to_target: Complex
    """From the rotation of the target, or minus the tracker's noise (rad, P), (n, 3, 3); 0 without a loop."""
    sensors: InertialSensors | None
    highpass: float
    pointing: Pointing

    @cached_property
    def disturbance_density(self) -> Array:
        """Of the rotation by the disturbance, one-sided, (n, 3, 3), rad2/Hz."""
        return _pass(self.to_wrench, self.isolation.wrench_density)

    def noise_density(self, sensors: InertialSensors) -> Array:
        """Of the rotation by the sensors' noise, one-sided, (n, 3, 3), rad2/Hz."""
        return _pass(self.to_noise, estimate_density(sensors, self.isolation.frequency, self.isolation.step))

    def tracker_density(self, noise_equivalent_angle_P: Array, sample_time: float) -> Array:
        """Of the rotation by the tracker's noise (3,), rad in each sample (s apart), one-sided, (n, 3, 3), rad2/Hz."""
        return _pass(self.to_target, np.diag(2.0 * sample_time * np.asarray(noise_equivalent_angle_P) ** 2))

    def covariance(self, density: Array) -> Array:
        """Integral of a density (n, 3, 3) over the frequencies, (3, 3), rad2."""
        return np.asarray(np.trapezoid(density, self.isolation.frequency, axis=0))

    def covariance_of_lines(self, wrench: Complex) -> Array:
        """Of the rotation under sines at the frequencies, complex amplitudes (n, 6), N, N.m; (3, 3), rad2."""
        rotation = np.einsum("nij,nj->ni", self.to_wrench, wrench)
        return np.asarray(0.5 * (rotation.T @ rotation.conj()).real)

    def scatter(self, random: Array, steady: Array, duration: float) -> float:
        """Relative standard deviation of the RMS of the line of sight over a record of so many s.

        ``random`` and ``steady``: densities (n, 3, 3), rad2/Hz, of Gaussian noise and of a multisine that repeats over
        the record.  With their sum S the mean square over T has the variance (integral of S^2 - S_steady^2) / T (J. S.
        Bendat, A. G. Piersol, Random Data, 8.2, for Gaussian noise alone).  Valid where it is small.
        """
        frequency, both = self.isolation.frequency, (random + steady)[:, :2, :2]
        squares = [np.einsum("nij,nij->n", S, S) for S in (both, steady[:, :2, :2])]
        variance = np.trapezoid(squares[0] - squares[1], frequency) / duration
        return float(0.5 * np.sqrt(variance) / np.trapezoid(np.trace(both, axis1=1, axis2=2), frequency))

    def offset(self, bias: Array) -> Array:
        """Rotation (3,), rad, in which a constant error of the estimate (6,), m/s2 and rad/s2, ends."""
        rest = replace(self.isolation, lines=np.array([AT_REST * self.highpass]))
        return np.asarray(rest.solve(self.sensors, self.highpass, self.pointing).to_noise[0].real @ bias)


def sensing_response(sensors: InertialSensors, frequency: Array, h: float) -> Complex:
    """From true base motion held over steps of ``h``, s, to the estimate at their ends, (n,), frequencies in Hz.

    Bandwidth, hold between samples and latency.  What sampling folds down is left out.
    """
    f = np.asarray(frequency)
    late = np.exp(-2j * np.pi * f * sensors.latency)
    return np.asarray(sensors.accelerometer.lowpass.sampled_response(f, h) * _held(sensors, f, h) * late)


def estimate_density(sensors: InertialSensors, frequency: Array, h: float) -> Array:
    """Of the error of acceleration and angular acceleration, one-sided, (n, 6, 6), through the lever arms.

    Noise of the sensors and, as white noise, rounding to the resolution q: q^2/12 in each sample.
    """
    f = np.asarray(frequency)
    interval = sensors.sample_time or h
    of_one = sensors.accelerometer.noise.spectrum(f) + sensors.accelerometer.resolution**2 * interval / 6.0
    P = sensors.estimator[:6, :ACCELEROMETERS]
    return np.asarray((of_one * np.abs(_held(sensors, f, h)) ** 2)[:, None, None] * (P @ P.T))


def estimated_bias(sensors: InertialSensors) -> Array:
    """Error of acceleration and angular acceleration that the constant biases make, (6,), m/s2 and rad/s2."""
    return np.asarray(sensors.estimator[:6] @ sensors.bias)


def line_of_sight(covariance: Array) -> float:
    """RMS of the rotation of the line of sight, which is z of P, from the covariance (3, 3) of the rotation: rad."""
    return float(np.sqrt(covariance[0, 0] + covariance[1, 1]))


def with_noise(sensors: InertialSensors, density: float) -> InertialSensors:
    """The same sensors with white noise of a density, m/s2/sqrt(Hz), alone: no drift, no rounding."""
    kind = replace(sensors.accelerometer, noise_density=density, bias_instability=0.0, random_walk=0.0, resolution=0.0)
    return replace(sensors, accelerometer=kind)


def _held(sensors: InertialSensors, f: Array, h: float) -> Complex:
    """A value that stays for a sample time, on the grid of steps."""
    return hold_mean(np.asarray(2j * np.pi * f * h), sensors.sample_time / h)


def _pass(G: Complex, density: Array) -> Array:
    return np.asarray((G @ density @ np.swapaxes(G.conj(), -1, -2)).real)
