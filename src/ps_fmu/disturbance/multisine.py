"""Deterministic multisine with a given spectrum of force and torque: the same RMS in every period, whatever the seed.

Its phases are chosen so that the inputs stay uncorrelated in what they move.  Inputs that share their lines leave cross
terms in the variance: inputs l and m contribute sum_k g_k exp(i (phase_lk - phase_mk)), where g_k is the squared gain
from wrench to motion.  That of a free body is w_k^-4: a dozen lines carry nearly all of the variance, and random phases
scatter the RMS by 7-13 %.

The phases start at random and are moved as little as possible (Gauss-Newton with the smallest step) until these sums
vanish over each group of neighbouring lines: their real parts with the weights w^-4 (below resonances a gain is real
up to a common sign), real and imaginary parts with equal weights (near them).  Then the RMS of the identified
spacecraft is within 0.3 % of that of independent inputs, whatever the seed.
"""

from __future__ import annotations

from ctypes import addressof
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from ..mechanism.quantities import Array, Complex
from ..numerics import library
from ..numerics.normal import Stream, make_key
from .kind import Source
from .sample_table import SampleTable
from .spectrum import Inputs, Layer, layers, ramp

_MARGIN = 4  # grid points beyond both ends of the start-up, for interpolation


class Multisine(Source):
    """f(t) = d2/dt2 (W G): lines of fixed amplitude at (k + 1/2)/T, their phases seeded and orthogonal.

    Lines at half-integer multiples of 1/T are orthogonal over any window of length T, and the lowest one does
    not sit on the edge of the band.  Above 20 Hz lines are at (k + 1/2)/(5 s) whatever T is: a mode there with
    a bandwidth below 0.2 Hz meets single lines.  All repeats after 2 T if T is a multiple of 5 s.

    Parameters
    ----------
    psd: one-sided spectrum of force and torque, (6, 6), N2/Hz, N2.m/Hz, N2.m2/Hz; or inputs with spectra of any shape.
    band: edges of the band, Hz.
    seed: 0 or greater; sets the phases, not the RMS.
    period: T, the window of the analysis, s.
    rise_time: of the ramp W from 0 at t = 0, s.
    """

    function: ClassVar[str] = "add_multisine"

    def __init__(
        self, psd: Array | Inputs, band: Array, seed: int, period: float = 100.0, rise_time: float = 2.0
    ) -> None:
        inputs = Inputs.of(psd)
        tables = [
            _make_tables(layer, inputs, seed, rise_time) for layer in layers(band, period, half=True, overlap=False)
        ]
        pairs = (library.RisingTable * len(tables))(
            *(library.RisingTable(rising.words, steady.words) for rising, steady in tables)
        )
        self.words = library.Multisine(addressof(pairs), len(tables), rise_time)
        self.words.kept = pairs, tables


def _make_tables(layer: Layer, inputs: Inputs, seed: int, rise_time: float) -> tuple[SampleTable, SampleTable]:
    """What is read while W rises, d2/dt2 (W G), exactly zero at the start, and afterwards."""
    lines = _amplitudes(layer, inputs, seed)
    g, g_1, g_2 = (layer.sample(lines, integrals) for integrals in (2, 1, 0))
    index = np.arange(-_MARGIN, int(np.ceil(rise_time * layer.rate)) + _MARGIN + 1)
    weight = ramp(index / layer.rate, rise_time)
    rows = np.mod(index, layer.points)
    rising = weight.second_derivative(g[rows], g_1[rows], g_2[rows])
    return SampleTable(rising, layer.rate, index[0] / layer.rate), SampleTable(g_2, layer.rate)


def multisine_lines(
    psd: Array | Inputs, band: Array, seed: int, period: float = 100.0
) -> tuple[Array, Complex]:
    """Frequencies (n,), Hz, and complex amplitudes (n, 6), N, N.m, of a :class:`Multisine` that has risen."""
    inputs, found = Inputs.of(psd), layers(band, period, half=True, overlap=False)
    frequency = np.concatenate([layer.frequencies for layer in found])
    return frequency, np.concatenate([_amplitudes(layer, inputs, seed).T for layer in found])


def _amplitudes(layer: Layer, inputs: Inputs, seed: int) -> Complex:
    """Complex amplitudes of force and torque, (6, lines)."""
    random = np.random.Generator(np.random.Philox(np.random.SeedSequence(make_key(Stream.MULTISINE, seed, layer.key))))
    phases = orthogonal_phases(layer.frequencies, inputs.factor.shape[1], random)
    spacing = 2.0 / layer.period  # Hz; only odd multiples of 1/period are lines
    return np.asarray(inputs.factor @ (inputs.root(layer.frequencies) * np.sqrt(2.0 * spacing) * np.exp(1j * phases)))


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
