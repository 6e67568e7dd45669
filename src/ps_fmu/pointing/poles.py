"""Poles of a system from its free motion."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

LARGEST_HANKEL = 200  # rows and columns of blocks
LEAST_SHARE = 1e-2  # of the largest mode in the band: what is smaller is what a high order makes of rounding


def free_poles(motion: Array, step_s: float, order: int) -> Complex:
    """Poles, rad/s, of a free motion (n, signals) in samples ``step_s`` apart, by the eigensystem realisation.

    The order is that of the model: more than there are modes, and some are spurious.
    """
    from control import eigensys_realization

    size = min((len(motion) - 1) // 2, LARGEST_HANKEL)
    scaled = np.ascontiguousarray(motion.T[:, None, :] / np.abs(motion).max())
    model, _ = eigensys_realization(scaled, order, m=size, n=size)
    return np.asarray(np.log(np.linalg.eigvals(model.A).astype(complex)) / step_s)


def rightmost(poles: Complex, band: tuple[float, float]) -> complex:
    """The pole farthest to the right in a band of frequencies, Hz, above the real axis; nan if there is none."""
    within = poles[_inside(poles, band)]
    return complex(within[within.real.argmax()]) if within.size else complex(math.nan, math.nan)


def slowest_mode(motion: Array, step_s: float, order: int, band: tuple[float, float]) -> complex:
    """Rightmost pole, rad/s, of a free motion (n, signals) in a band, Hz, among those that matter in the motion."""
    poles = free_poles(motion, step_s, order)
    shapes = np.exp(np.outer(np.arange(len(motion)) * step_s, poles))
    shapes /= np.abs(shapes).max(axis=0)
    amplitude = np.abs(np.linalg.lstsq(shapes, motion, rcond=None)[0]).max(axis=1)
    inside = _inside(poles, band)
    return rightmost(poles[amplitude > LEAST_SHARE * amplitude[inside].max(initial=0.0)], band)


def _inside(poles: Complex, band: tuple[float, float]) -> NDArray[np.bool_]:
    cycles = poles.imag / (2.0 * math.pi)  # Hz
    return np.asarray((cycles > band[0]) & (cycles < band[1]))
