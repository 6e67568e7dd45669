"""What residual jitter does to an image: transfer functions and encircled energy.

The motion of the line of sight over an exposure T, without its mean and trend, has the covariance that
``ResidualJitter(T)`` gives; it blurs the image like a Gaussian.  Angles in rad, spatial frequencies in cycles/rad; or
any other unit of length and its inverse, for example m and cycles/m in the focal plane.

The transfer function exp(-2 pi^2 (sx^2 u^2 + sy^2 v^2)) is that of Pittelkau and McKinley, Opt. Eng. 55 (2016) 063108.
Some texts have lost the square of pi.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

_NODES = 16  # of a cell of the integral over spatial frequencies


def jitter_otf(u: ArrayLike, v: ArrayLike, covariance: ArrayLike) -> Array:
    """Optical transfer function of Gaussian jitter at spatial frequencies u and v, cycles/rad; real, 0 to 1.

    ``covariance`` (2, 2), rad^2, of the motion about the two axes, with their correlation:
    ``exp(-2 pi^2 (C_xx u^2 + 2 C_xy u v + C_yy v^2))``.
    """
    C = _covariance(covariance)
    u, v = np.asarray(u, dtype=float), np.asarray(v, dtype=float)
    return np.asarray(np.exp(-2.0 * np.pi**2 * (C[0, 0] * u * u + 2.0 * C[0, 1] * u * v + C[1, 1] * v * v)))


def jitter_mtf(frequency: ArrayLike, covariance: ArrayLike, direction: float = 0.0) -> Array:
    """Modulation transfer function along a direction, rad from the first axis, at frequencies, cycles/rad."""
    frequency = np.asarray(frequency, dtype=float)
    return np.abs(jitter_otf(frequency * math.cos(direction), frequency * math.sin(direction), covariance))


def aperture_mtf(frequency: ArrayLike, wavelength: float, diameter: float) -> Array:
    """Diffraction-limited MTF of a clear circular aperture at frequencies, cycles/rad; 0 from diameter/wavelength on.

    ``(2 / pi) (acos(x) - x sqrt(1 - x^2))``, x = frequency wavelength / diameter; lengths in m.
    """
    x = np.minimum(np.abs(np.asarray(frequency, dtype=float)) * wavelength / diameter, 1.0)
    return np.asarray(2.0 / np.pi * (np.arccos(x) - x * np.sqrt(1.0 - x * x)))


def jitter_encircled_energy(radius: ArrayLike, covariance: ArrayLike) -> Array:
    """Share of the energy of a point, blurred by jitter alone, within a radius, rad, of its centre.

    The mean of 1 - exp(-r^2 / (2 s^2)) over the directions psi, s^2 = a cos^2 psi + b sin^2 psi, a and b the variances
    along the principal axes.  Without any jitter it is 1.
    """
    r = np.asarray(radius, dtype=float)
    smaller, larger = np.maximum(np.linalg.eigvalsh(_covariance(covariance)), 0.0)
    if larger == 0.0:
        return np.ones(r.shape)
    # A periodic integrand: the plain sum over equal angles converges faster than any power of their number, once they
    # are dense against its narrowest part, which is as wide as the ratio of the axes.
    narrowest = max(math.sqrt(smaller / larger), 1e-3)
    count = round(64.0 + 16.0 / narrowest)
    angle = (np.arange(count) + 0.5) * (np.pi / count)
    variance = larger * np.cos(angle) ** 2 + smaller * np.sin(angle) ** 2
    return np.asarray(-np.expm1(-0.5 * r[..., None] ** 2 / variance).mean(axis=-1))


def encircled_energy(radius: ArrayLike, covariance: ArrayLike, wavelength: float, diameter: float) -> Array:
    """Share of the energy of a point within a radius, rad, through a clear circular aperture and under jitter.

    ``2 pi r int OTF(f) J1(2 pi r f) df`` up to diameter/wavelength, OTF the product of that of the aperture and of the
    mean of that of the jitter over directions, ``exp(-pi^2 f^2 (a + b)) I0(pi^2 f^2 (a - b))``, a and b the variances
    along the principal axes.  Without jitter it is 1 - J0^2 - J1^2 of pi r diameter / wavelength.

    Parameters
    ----------
    radius: rad, of any shape.
    covariance: (2, 2), rad^2, of the jitter over the exposure.
    wavelength, diameter: m.
    """
    from scipy.special import i0e, j1

    r = np.asarray(radius, dtype=float)
    smaller, larger = np.maximum(np.linalg.eigvalsh(_covariance(covariance)), 0.0)
    cutoff = diameter / wavelength
    # Two cells for each period of J1, and 8 at least; towards the cutoff the aperture's MTF ends like a power 3/2.
    cells = 8 + math.ceil(2.0 * cutoff * float(np.max(r, initial=0.0)))
    nodes, weights = np.polynomial.legendre.leggauss(_NODES)
    edges = cutoff * np.sin(0.5 * np.pi * np.linspace(0.0, 1.0, cells + 1))
    width = np.diff(edges)[:, None]
    f = (edges[:-1, None] + 0.5 * width * (nodes + 1.0)).ravel()
    weight = (0.5 * width * weights).ravel()
    spread = np.pi**2 * f * f
    # i0e has the growing factor exp(-(larger - smaller) spread) in it.
    blurred = aperture_mtf(f, wavelength, diameter) * np.exp(-2.0 * spread * smaller) * i0e(spread * (larger - smaller))
    return np.asarray(2.0 * np.pi * r * (j1(2.0 * np.pi * r[..., None] * f) @ (weight * blurred)))


def _covariance(covariance: ArrayLike) -> Array:
    C = np.asarray(covariance, dtype=float)
    if C.shape != (2, 2) or not np.allclose(C, C.T, rtol=1e-9, atol=0.0):
        raise ValueError(f"covariance: expected a symmetric matrix (2, 2), got {C.tolist()}")
    if float(np.linalg.eigvalsh(C)[0]) < -1e-12 * float(np.trace(C)):
        raise ValueError(f"covariance: expected no negative eigenvalue, got {C.tolist()}")
    return C
