"""What reaches the payload, in closed form: from base motion (Fig 8), and from a disturbance wrench (Table 2).

With the practical plant and the controller of a :class:`.loop.Loop`, ``f = K_we s^2 exp(-s tau) q_b``::

    passive   theta_p = G_P q_b                              theta_p = B w_b
    active    theta_p = (G_P + (A - G_P C) F) q_b            theta_p = (B + A F (E - C F)^-1 D) w_b

with F the controller from base displacement to force.  All rotations are in axes of the platform P.  Active, an
unstable loop is refused: :class:`.stability.UnstableError`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..mechanism.parameters import Bus, Noise
from ..mechanism.quantities import Array, Complex
from .loop import Loop
from .transfer_matrices import Practical, place_frequencies


def from_base(loop: Loop, s: ArrayLike, *, active: bool) -> Complex:
    """Transmissibility, base motion (m, rad; B) to payload rotation (rad; P), (..., 3, 6): Fig 8."""
    plant, s = Practical(loop.model.dynamics), np.asarray(s, dtype=complex)
    A, B, C, D = plant.all(s)
    G_P = B @ np.linalg.inv(D)
    if active:
        G_P = G_P + (A - G_P @ C) @ _force(loop, s)
    return np.asarray(_to_platform(loop) @ G_P)


def from_wrench(loop: Loop, s: ArrayLike, *, active: bool) -> Complex:
    """Disturbance wrench (N, N.m; in B at its origin) to payload rotation (rad; P), (..., 3, 6)."""
    plant, s = Practical(loop.model.dynamics), np.asarray(s, dtype=complex)
    A, B, C, D = plant.all(s)
    if active:
        F = _force(loop, s)
        B = B + A @ F @ np.linalg.solve(np.eye(6) - C @ F, D)
    return np.asarray(_to_platform(loop) @ B)


def singular_values_db(matrix: Complex) -> Array:
    """Singular values, largest first, (..., 3), dB; translations in m and rotations in rad count alike."""
    return np.asarray(20.0 * np.log10(np.linalg.svd(matrix, compute_uv=False)))


def _force(loop: Loop, s: Complex) -> Complex:
    """F(s) of a loop that is stable: base displacement to fine force, (..., 3, 6)."""
    loop.require_stable()
    gain = s * s * np.exp(-s * loop.delay)
    return np.asarray(loop.controller.response(s) * gain[..., None, None])


def _to_platform(loop: Loop) -> Array:
    return loop.model.dynamics.pose.rotation_BP.T


_POINTS = 6000  # of the frequency grid


@dataclass(frozen=True, eq=False)
class Jitter:
    """Stationary jitter under band-limited noise; axes of P."""

    covariance: Array
    """(3, 3), rad2, of the payload's rotation."""
    focal_length: float
    """m."""

    @property
    def rms(self) -> Array:
        """(3,), rad."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def image_covariance(self) -> Array:
        """(2, 2), m2, of the image point: focal length times (theta_y, -theta_x)."""
        turn = self.focal_length * np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
        return np.asarray(turn @ self.covariance @ turn.T)

    @property
    def radius_rms(self) -> float:
        """Root-mean-square distance of the image point from its mean, m."""
        return float(np.sqrt(np.trace(self.image_covariance)))


def jitter(loop: Loop, bus: Bus, noise: Noise, focal_length: float, *, active: bool) -> Jitter:
    """Jitter from the power spectral density of the wrench, by an integral over its band.

    The trapezoidal rule on :func:`jitter_density`.
    """
    frequency, density = jitter_density(loop, bus, noise, active=active)
    return Jitter(np.asarray(np.trapezoid(density, frequency, axis=0)), focal_length)


def jitter_density(loop: Loop, bus: Bus, noise: Noise, *, active: bool) -> tuple[Array, Array]:
    """One-sided density of the payload's rotation: frequencies (n,), Hz, and Re G S G^H (n, 3, 3), rad2/Hz; P.

    S (6, 6) is that of the wrench, moved from the centre of mass of the bus to the origin of B.  The frequencies are
    dense around the modes of plant and loop.
    """
    from ..disturbance import psd_at_origin  # here: a run that asks whether a loop is stable needs none of it

    frequency = _grid(loop, *noise.band)
    G = from_wrench(loop, 2j * np.pi * frequency, active=active)
    S = psd_at_origin(noise.wrench_psd_B, bus.com_B)
    return frequency, np.asarray((G @ S @ np.swapaxes(G.conj(), -1, -2)).real)


def variance_weights(loop: Loop, bus: Bus, band: Array, *, active: bool, points: int | None = None) -> Array:
    """W (3, 6, 6) with which a flat density S of the wrench gives the variances of the jitter, in axes of P.

    ``variance_k = sum_ij W_kij S_ij``, rad2, for S (6, 6), one-sided, at the centre of mass of the bus over ``band``
    (2,), Hz: what :func:`jitter` has on the diagonal, as a linear function of the density.  ``points``: frequencies
    of the integral besides those around the resonances; 600 leave an error of 0.3 %.
    """
    from ..disturbance import to_origin

    frequency = _grid(loop, *band, points=points or _POINTS)
    G = from_wrench(loop, 2j * np.pi * frequency, active=active) @ to_origin(bus.com_B)
    products = (G[..., :, None] * G[..., None, :].conj()).real
    return np.asarray(np.trapezoid(products, frequency, axis=0))


def jitter_of_lines(loop: Loop, frequency: Array, wrench: Complex, focal_length: float, *, active: bool) -> Jitter:
    """Jitter under sines of ``frequency`` (n,), Hz, and complex amplitude ``wrench`` (n, 6), N, N.m; B at its origin.

    Over a time in which the sines are orthogonal to each other; the steady state.
    """
    G = from_wrench(loop, 2j * np.pi * frequency, active=active)
    rotation = np.einsum("nij,nj->ni", G, wrench)
    return Jitter(0.5 * (rotation.T @ rotation.conj()).real, focal_length)


def _grid(loop: Loop, low: float, high: float, *, points: int = _POINTS) -> Array:
    """Frequencies, Hz, logarithmic over the band and crowded around the poles of plant and loop."""
    return place_frequencies(np.concatenate([loop.plant_poles(), loop.with_delay(0.0).poles()]), low, high, points)
