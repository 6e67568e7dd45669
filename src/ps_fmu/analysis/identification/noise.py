"""The disturbance's power spectral density, from the passive RMS of Table 2.

The variances are linear in the density S (6, 6).  S = L L^T with a lower triangular L keeps it positive semi-definite.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ...manipulator.parameters import Array, Parameters
from .fit import Identifiability, IdentificationError, roundings, targets
from .geometry import ORIENTATIONS

POSES = ("nominal", "roll", "pitch", "yaw")  # of Table 2, in the order of ORIENTATIONS
KEYS = tuple(f"table2.{pose}_passive_{axis}" for pose in POSES for axis in (1, 2, 3))
REJECTION_KEYS = tuple(key.replace("passive", "rejection") for key in KEYS)

LOWER = np.tril_indices(6)
TOLERANCE = 0.01  # relative, of an RMS
SPREAD = 0.3  # standard deviation of the starting values, where 1 alone makes the RMS


def weights(p: Parameters, *, active: bool) -> Array:
    """What turns a density into variances, (12, 6, 6), in the order of :data:`KEYS`.

    See :func:`.transmissibility.variance_weights`.

    Parameters
    ----------
    p: the original support module (OSM).
    """
    from ...manipulator.stability import loop_at
    from ...manipulator.transmissibility import variance_weights

    loops = (loop_at(p, np.radians(orientation)) for orientation in ORIENTATIONS)
    return np.concatenate([variance_weights(loop, p.bus, p.noise.band, active=active) for loop in loops])


def rms(weights: Array, psd: Array) -> Array:
    """RMS, (12,), rad, for weights (12, 6, 6) and a density (6, 6)."""
    return np.asarray(np.sqrt(np.einsum("kij,ij->k", weights, psd)))


@dataclass(frozen=True, eq=False)
class Scaled:
    """The problem without units: variances over the published ones, wrenches over the one that makes them alone."""

    weights: Array
    """(12, 6, 6)."""
    unit: Array
    """(6,), N or N.m per root Hz."""


def scaled(weights: Array) -> Scaled:
    """See :class:`Scaled`."""
    relative = weights / targets(KEYS)[:, None, None] ** 2
    unit = 1.0 / np.sqrt(np.einsum("kii->ki", relative).mean(axis=0))
    return Scaled(relative * np.outer(unit, unit), unit)


def fit(weights: Array, seed: int) -> Array:
    """The positive semi-definite density (6, 6) that comes nearest to the twelve passive RMS values.

    Raises
    ------
    IdentificationError: it misses one by more than :data:`TOLERANCE`.
    """
    from scipy.optimize import least_squares

    problem = scaled(weights)

    def error(entries: Array) -> Array:
        return rms(problem.weights, _square(entries)) - 1.0

    start = np.random.default_rng(seed).normal(0.0, SPREAD, len(LOWER[0]))
    found = least_squares(error, start, max_nfev=1000)
    psd = _square(found.x) * np.outer(problem.unit, problem.unit)
    missed = np.abs(rms(weights, psd) / targets(KEYS) - 1.0)
    if missed.max() > TOLERANCE:
        raise IdentificationError(
            f"{KEYS[int(missed.argmax())]}: no spectral density found; the nearest is {100.0 * missed.max():.2g} % "
            f"off, at most {100.0 * TOLERANCE:g} % is accepted; try another seed"
        )
    return np.asarray(psd)


def identifiability(weights: Array, psd: Array) -> Identifiability:
    """What the passive RMS fix of the 21 entries of the density; range of S_ij: the root of S_ii S_jj as found."""
    size = np.sqrt(np.diag(psd))
    times = np.where(LOWER[0] == LOWER[1], 1.0, 2.0)  # S_ij and S_ji are one entry
    slope = (weights * np.outer(size, size))[:, *LOWER] * times / (2.0 * rms(weights, psd)[:, None])
    return Identifiability(slope / roundings(KEYS)[:, None])


def with_psd(p: Parameters, psd: Array) -> Parameters:
    """Parameters with another density."""
    return replace(p, noise=replace(p.noise, wrench_psd_B=psd))


def _square(entries: Array) -> Array:
    L = np.zeros((6, 6))
    L[LOWER] = entries
    return L @ L.T
