"""Deterministic multisine with a given 6x6 spectrum: the same RMS in every period, whatever the seed."""

from __future__ import annotations

import numpy as np

from ..mechanism.quantities import Array, Complex
from ..numerics.normal import Stream, make_key
from .phases import orthogonal_phases
from .sample_table import SampleTable
from .smooth import ramp
from .spectrum import Layer, factor, layers

_MARGIN = 4  # grid points beyond both ends of the start-up, for interpolation


class Multisine:
    """f(t) = d2/dt2 (W G): lines of fixed amplitude at (k + 1/2)/T, their phases seeded and orthogonal.

    Lines at half-integer multiples of 1/T are orthogonal over any window of length T, and the lowest one does
    not sit on the edge of the band.  Above 20 Hz lines are at (k + 1/2)/(5 s) whatever T is: a mode there with
    a bandwidth below 0.2 Hz meets single lines.  All repeats after 2 T if T is a multiple of 5 s.

    Parameters
    ----------
    psd: one-sided spectrum of force and torque, (6, 6), N2/Hz, N2.m/Hz, N2.m2/Hz.
    band: edges of the band, Hz.
    seed: 0 or greater; sets the phases, not the RMS.
    period: T, the window of the analysis, s.
    rise_time: of the ramp W from 0 at t = 0, s.
    """

    def __init__(
        self, psd: Array, band: Array, seed: int, period: float = 100.0, rise_time: float = 2.0
    ) -> None:
        self._rise_time = rise_time
        self._steady: list[SampleTable] = []
        self._start: list[SampleTable] = []
        inputs = factor(psd)
        for layer in layers(band, period, half=True, overlap=False):
            self._add(layer, inputs, seed)

    def __call__(self, time: Array) -> Array:
        """Force (N) and torque (N.m) at ascending times (n,) in s, shape (n, 6)."""
        wrench = np.zeros((time.size, 6))
        first, risen = np.searchsorted(time, [0.0, self._rise_time])
        for start, steady in zip(self._start, self._steady, strict=True):
            wrench[first:risen] += start(time[first:risen])
            wrench[risen:] += steady(time[risen:])
        return wrench

    def _add(self, layer: Layer, inputs: Array, seed: int) -> None:
        lines = _amplitudes(layer, inputs, seed)
        g, g_1, g_2 = (layer.sample(lines, integrals) for integrals in (2, 1, 0))
        self._steady.append(SampleTable(g_2, layer.rate))
        # While W rises: d2/dt2 (W G), exactly zero at the start.
        index = np.arange(-_MARGIN, int(np.ceil(self._rise_time * layer.rate)) + _MARGIN + 1)
        weight = ramp(index / layer.rate, self._rise_time)
        rows = np.mod(index, layer.points)
        rising = weight.second_derivative(g[rows], g_1[rows], g_2[rows])
        self._start.append(SampleTable(rising, layer.rate, index[0] / layer.rate))


def multisine_lines(psd: Array, band: Array, seed: int, period: float = 100.0) -> tuple[Array, Complex]:
    """Frequencies (n,), Hz, and complex amplitudes (n, 6), N, N.m, of a :class:`Multisine` that has risen."""
    inputs, found = factor(psd), layers(band, period, half=True, overlap=False)
    frequency = np.concatenate([layer.frequencies for layer in found])
    return frequency, np.concatenate([_amplitudes(layer, inputs, seed).T for layer in found])


def _amplitudes(layer: Layer, inputs: Array, seed: int) -> Complex:
    """Complex amplitudes of force and torque, (6, lines)."""
    random = np.random.Generator(np.random.Philox(np.random.SeedSequence(make_key(Stream.MULTISINE, seed, layer.key))))
    phases = orthogonal_phases(layer.frequencies, inputs.shape[1], random)
    spacing = 2.0 / layer.period  # Hz; only odd multiples of 1/period are lines
    return np.asarray(inputs @ (np.sqrt(2.0 * spacing) * np.exp(1j * phases)))
