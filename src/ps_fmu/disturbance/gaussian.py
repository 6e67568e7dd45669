"""Endless Gaussian noise with a given 6x6 spectrum, as a function of time and seed alone."""

from __future__ import annotations

import numpy as np

from ..mechanism.quantities import Array
from .sample_table import SampleTable
from .smooth import crossfade, ramp
from .spectrum import Layer, Sampler, factor, layers, share

_KEPT = 2  # blocks per layer: as many as are alive at any time


class GaussianNoise:
    """f(t) = d2/dt2 sum_i W w_i G_i: independent blocks of lines, faded into each other and in from rest.

    Block i lives for one period of its lines, fades in over the first half and out over the second (equal
    power); its lines have complex Gaussian amplitudes drawn from (seed, layer, i).  Hence any time can be
    computed on its own, nothing repeats, and a free body of mass m that f pushes from rest is at
    sum_i W w_i G_i / m: it never drifts.

    Parameters
    ----------
    psd: one-sided spectrum of force and torque, (6, 6), N2/Hz, N2.m/Hz, N2.m2/Hz.
    band: edges of the band, Hz.
    seed: 0 or greater.
    period: length of the slow blocks, s; the lower edge of the band is about 2/period wide.
    rise_time: of the ramp W from 0 at t = 0, s.
    """

    def __init__(
        self, psd: Array, band: Array, seed: int, period: float = 100.0, rise_time: float = 2.0
    ) -> None:
        self._factor = factor(psd)
        self._seed = seed
        self._rise_time = rise_time
        self._layers = layers(band, period, half=False, overlap=True)
        self._windows = {layer.key: crossfade(_elapsed(layer), 0.5 * layer.period) for layer in self._layers}
        self._samplers = {layer.key: Sampler(layer, len(self._factor)) for layer in self._layers}
        self._blocks: dict[int, dict[int, SampleTable]] = {layer.key: {} for layer in self._layers}

    def __call__(self, time: Array) -> Array:
        """Force (N) and torque (N.m) at ascending times (n,) in s, shape (n, 6)."""
        wrench = np.zeros((time.size, 6))
        for layer in self._layers:
            hop = 0.5 * layer.period
            # Only blocks that the times fall into: steps of a thousand seconds must not make all in between.
            places = np.unique(time // hop).tolist()
            for index in sorted({int(place) + later for place in places for later in (0, 1)}):
                block = self._block(layer, index)
                first, end = np.searchsorted(time, [block.start, block.end])
                wrench[first:end] += block(time[first:end])
        return wrench

    def _block(self, layer: Layer, index: int) -> SampleTable:
        known = self._blocks[layer.key]
        if index not in known:
            if len(known) == _KEPT:
                del known[next(iter(known))]  # the oldest
            known[index] = self._synthesise(layer, index)
        return known[index]

    def _synthesise(self, layer: Layer, index: int) -> SampleTable:
        """Block ``index``, which lives from (index - 1) to (index + 1) half periods."""
        key = np.random.SeedSequence((self._seed, layer.key, index % 2**32))
        random = np.random.Generator(np.random.Philox(key))
        u, v = random.random((2, self._factor.shape[1], layer.numbers.size))
        # Box-Muller: E|c|^2 = 2/T, uniform phase.
        c = np.sqrt(-2.0 / layer.period * np.log1p(-u)) * np.exp(2j * np.pi * v)
        lines = self._factor @ (c * share(layer))
        start, weight, sample = (index - 1) * 0.5 * layer.period, self._windows[layer.key], self._samplers[layer.key]
        if start < self._rise_time:
            weight = weight.times(ramp(start + _elapsed(layer), self._rise_time))
        # Weight.second_derivative in place, from g'' (no integral) to g (two).
        rows = sample(lines, 0) * weight.value
        for integrals, size in ((1, 2.0 * weight.rate), (2, weight.curvature)):
            part = sample(lines, integrals)
            part *= size
            rows += part
        return SampleTable(np.ascontiguousarray(rows.T), layer.rate, start)


def _elapsed(layer: Layer) -> Array:
    """Time since the start of a block, on the grid of a layer, s."""
    return np.asarray(np.arange(layer.points) / layer.rate)
