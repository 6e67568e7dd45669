"""Random errors of an inertial sensor in the terms of IEEE Std 952 and 1293: spectra and Allan variances.

White noise (velocity or angle random walk N), bias instability B and the random walk K of acceleration or rate.  All
spectra here are one-sided, as data sheets state them; those of the standards are two-sided.

Flicker noise of level B is a sum of first-order Gauss-Markov processes, one for each decade of correlation time.  Its
spectrum is within 6 % of B^2 / (pi f) between the ends of :data:`CORRELATION_TIMES`, and flat below.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..mechanism.quantities import Array

#: Of the Gauss-Markov processes, s: flicker noise from 2e-4 to 2 Hz.
CORRELATION_TIMES = np.array([0.1, 1.0, 10.0, 100.0, 1000.0])
#: Largest Allan deviation of flicker noise over its level B: IEEE Std 952-1997, annex C.
PLATEAU = float(np.sqrt(2.0 * np.log(2.0) / np.pi))  # 0.664


@dataclass(frozen=True)
class NoiseModel:
    """Random error of one sensor; its unit is q: m/s2 of an accelerometer, rad/s of a rate sensor."""

    density: float
    """White noise, one-sided, q/sqrt(Hz): sqrt(2) N."""
    instability: float
    """Bias instability B, q; the Allan deviation has its plateau at 0.664 B."""
    random_walk: float
    """K, q/sqrt(s)."""

    @property
    def variance(self) -> float:
        """Of each Gauss-Markov process, q2.

        The sum over correlation times tau of 4 v tau / (1 + (2 pi f tau)^2) is B^2 / (pi f) on average over a decade.
        """
        return self.instability**2 * float(np.log(10.0)) / np.pi

    def spectrum(self, frequency: Array) -> Array:
        """One-sided density at frequencies (n,) above 0 Hz, (n,), q2/Hz, of the error before it is sampled."""
        f = np.asarray(frequency)[..., None]
        tau = CORRELATION_TIMES
        flicker = (4.0 * self.variance * tau / (1.0 + (2.0 * np.pi * f * tau) ** 2)).sum(axis=-1)
        walk = 2.0 * (self.random_walk / (2.0 * np.pi * f[..., 0])) ** 2
        return np.asarray(self.density**2 + flicker + walk)

    def allan_variance(self, interval: Array) -> Array:
        """Allan variance over averaging times (n,), s, (n,), q2: N^2/t, Gauss-Markov processes, K^2 t/3."""
        t = np.asarray(interval)[..., None]
        ratio = CORRELATION_TIMES / t
        ends = 3.0 - 4.0 * np.exp(-1.0 / ratio) + np.exp(-2.0 / ratio)
        flicker = (2.0 * self.variance * ratio * (1.0 - 0.5 * ratio * ends)).sum(axis=-1)
        t = t[..., 0]
        return np.asarray(0.5 * self.density**2 / t + flicker + self.random_walk**2 * t / 3.0)
