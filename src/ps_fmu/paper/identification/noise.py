"""The disturbance's power spectral density, from Table 2.

The variances are linear in the density S (6, 6), and S = L L^T with a lower triangular L keeps it positive
semi-definite.  The passive RMS are met; the active ones, which no density explains altogether, as far as that leaves
room.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from ...mechanism.parameters import Array, Parameters
from ...theory.loop import loop_at
from ...theory.transmissibility import variance_weights
from ..figures.table2.runs import ORIENTATIONS
from .fit import Identifiability, roundings, targets

KEYS = tuple(f"table2.{orientation}_passive_{axis}" for orientation in ORIENTATIONS for axis in (1, 2, 3))
ACTIVE_KEYS = tuple(key.replace("passive", "active") for key in KEYS)
REJECTION_KEYS = tuple(key.replace("passive", "rejection") for key in KEYS)

LOWER = np.tril_indices(6)
TOLERANCE = 0.01  # relative, of a passive RMS
PASSIVE_SPREAD, ACTIVE_SPREAD = 0.003, 0.3  # relative errors that weigh the same
PRIOR = 0.01  # weight of small entries: decides between densities that are equally good
SPREAD = 0.3  # standard deviation of the starting values, where 1 alone makes the RMS
POINTS = 1500  # of the frequency grid while fitting: variances within 5e-4


@dataclass(frozen=True, eq=False)
class Weights:
    """What turns a density into variances, (12, 6, 6) each, in the order of :data:`KEYS`.

    See :func:`.variance_weights`.
    """

    passive: Array
    active: Array


def compute_weights(p: Parameters, points: int | None = None) -> Weights:
    """Weights of the original support module (OSM); ``points`` of the frequency grid, None: as for Table 2."""
    loops = [loop_at(p, np.radians(orientation)) for orientation in ORIENTATIONS.values()]
    passive, active = (
        np.concatenate([variance_weights(loop, p.bus, p.noise.band, active=on, points=points) for loop in loops])
        for on in (False, True)
    )
    return Weights(passive, active)


def rms(weights: Array, psd: Array) -> Array:
    """RMS, (12,), rad, for weights (12, 6, 6) and a density (6, 6)."""
    return np.asarray(np.sqrt(np.einsum("kij,ij->k", weights, psd)))


def fit(given: Weights, seed: int) -> Array | None:
    """The density (6, 6) that meets the passive RMS within :data:`TOLERANCE` and comes nearest to the active ones.

    None if there is no such density with these weights.
    """
    passive, active = targets(KEYS), targets(ACTIVE_KEYS)
    # Without units: wrenches over the one that alone would make the RMS.
    unit = 1.0 / np.sqrt(np.einsum("kii->ki", given.passive / passive[:, None, None] ** 2).mean(axis=0))
    units = np.outer(unit, unit)

    def density(entries: Array) -> Array:
        L = np.zeros((6, 6))
        L[LOWER] = entries
        return L @ L.T * units

    def error(entries: Array) -> Array:
        psd = density(entries)
        return np.concatenate(
            [
                (rms(given.passive, psd) / passive - 1.0) / PASSIVE_SPREAD,
                np.log(rms(given.active, psd) / active) / ACTIVE_SPREAD,
                PRIOR * entries,
            ]
        )

    start = np.random.default_rng(seed).normal(0.0, SPREAD, len(LOWER[0]))
    psd = density(least_squares(error, start, max_nfev=1000).x)
    missed = np.abs(rms(given.passive, psd) / passive - 1.0)
    return psd if missed.max() <= TOLERANCE else None


def identifiability(given: Weights, psd: Array) -> Identifiability:
    """What passive and active RMS fix of the 21 entries of the density.

    Range of S_ij: the root of S_ii S_jj as found.
    """
    size = np.sqrt(np.diag(psd))
    times = np.where(LOWER[0] == LOWER[1], 1.0, 2.0)  # S_ij and S_ji are one entry
    both = np.concatenate([given.passive, given.active])
    slope = (both * np.outer(size, size))[:, *LOWER] * times / (2.0 * rms(both, psd)[:, None])
    return Identifiability(slope / roundings(KEYS + ACTIVE_KEYS)[:, None])
