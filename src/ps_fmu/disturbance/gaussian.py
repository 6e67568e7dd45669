"""Endless Gaussian noise with a given spectrum of force and torque, as a function of time and seed alone.

Samples of a block are made phase by phase, every P-th sample by a transform of its own.  With N = P n, sample number
P m + j of ``Re sum_k c_k exp(2 pi i k (P m + j) / N)`` is sample number m of
``Re sum_k (c_k exp(2 pi i k j / N)) exp(2 pi i k m / n)``: a transform of n points, in which lines above n/2 appear as
their aliases.  One of 2500 points takes 10 us, one of 50 000 takes 400 us: so steps can make the next block in parts.
"""

from __future__ import annotations

from ctypes import addressof
from functools import lru_cache
from itertools import pairwise
from typing import ClassVar

import numpy as np

from ..mechanism.quantities import Array, Complex
from ..numerics import library
from ..numerics.library import find_address
from ..numerics.normal import Stream, make_key, make_words
from .kind import Source
from .spectrum import Inputs, Layer, Weight, crossfade, layers, share

_MOST_POINTS = 2500  # of a transform
_CHANNELS, _LANES = 6, 8  # as in numerics.h
_BEHIND = 3  # numbers that the compiled function may write behind the last
_MANY_CYCLES = 25.0
"""A line with so many cycles while it fades in or out needs no correction: of its impulse 4e-7 is left, since the steps
of :mod:`.spectrum` have four smooth derivatives.  Blocks of the fast layer, which has lines from 15 Hz on, then cost a
third; they are off the corrected ones by 1.6 % of a line at 15 Hz and by less above, while they fade."""


class LayerLines:
    """What all blocks of a layer share, whatever the seed: 5 MB for 0.1 to 1000 Hz.

    Parameters
    ----------
    n_terms: how many integrals of a block are needed: g'', or g'', g' and g.
    amplitudes: of each line of each independent source, (sources, lines).

    Attributes
    ----------
    gains: what a line is multiplied by for each integral, (n_terms, lines).
    phases: P.  Phase j has the samples j, j + P, ...
    points: n, samples of a phase.
    turns: exp(2 pi i k j / N) of line k and phase j, (phases, lines).
    roots: exp(2 pi i m / n), (points,).
    windows: what the integrals of a block that does not rise are multiplied by, (phases, n_terms, points).
    """

    def __init__(self, layer: Layer, n_terms: int, amplitudes: Array) -> None:
        self.layer, self.n_terms, self.amplitudes = layer, n_terms, np.ascontiguousarray(amplitudes)
        total, numbers = layer.points, layer.numbers
        self.points = max(n for n in range(2, _MOST_POINTS + 1, 2) if total % n == 0)
        self.phases = total // self.points
        roots = np.exp(2j * np.pi / total * np.arange(total))
        self.turns = roots[np.outer(np.arange(self.phases), numbers) % total]
        self.roots = np.ascontiguousarray(roots[:: self.phases])
        # Runs of lines that go to bins side by side: up from 0 to n/2, then down again, and so on.
        runs = 2 * numbers // self.points
        edges = [0, *(np.flatnonzero(np.diff(runs)) + 1).tolist(), numbers.size]
        self._runs = (library.Run * (len(edges) - 1))()
        for found, (first, end) in zip(self._runs, pairwise(edges), strict=True):
            place, mirrored = int(numbers[first]) % self.points, int(runs[first]) % 2
            found.first, found.end, found.mirrored = first, end, mirrored
            found.bin = self.points - place if mirrored else place
        once = (2 * numbers) % self.points == 0  # a transform counts a line at 0 or n/2 once, all others twice
        orders = np.arange(n_terms)[:, np.newaxis]
        gain = np.where(once, 1.0, 0.5) * self.points
        self.gains: Complex = gain / (2j * np.pi * layer.frequencies) ** orders
        self.windows = self._make_windows()
        arrays = self.amplitudes, self.gains, self.turns, self.roots
        self.words = library.Lines(
            *map(find_address, arrays), addressof(self._runs),
            numbers.size, n_terms, self.phases, self.points, len(self._runs),
        )  # fmt: skip

    def _make_windows(self) -> Array:
        layer = self.layer
        window = crossfade(np.arange(layer.points) / layer.rate, 0.5 * layer.period)
        phases = zip(*(weight.reshape(-1, self.phases).T for weight in window), strict=True)
        weights = [Weight(*rows) for rows in phases]
        return np.array([[w.value, 2.0 * w.rate, w.curvature][: self.n_terms] for w in weights])


@lru_cache(maxsize=2)  # both layers of one source: a reset, or another source, saves 40 of 60 ms
def _make_lines(
    key: int, rate: float, period: float, numbers: bytes, rise_time: float, amplitudes: bytes
) -> LayerLines:
    layer = Layer(key, rate, period, np.frombuffer(numbers, np.int64))
    cycles = layer.frequencies.min() * min(rise_time, 0.5 * layer.period)
    n_terms = 1 if cycles >= _MANY_CYCLES else 3
    return LayerLines(layer, n_terms, np.frombuffer(amplitudes).reshape(-1, layer.numbers.size))


class GaussianNoise(Source):
    """f(t) = d2/dt2 sum_i W w_i G_i: independent blocks of lines, faded into each other and in from rest.

    Block i lives for one period of its lines, fades in over the first half and out over the second (equal
    power); its lines have complex Gaussian amplitudes drawn from (seed, layer, i).  Hence any time can be
    computed on its own, nothing repeats, and a free body of mass m that f pushes from rest is at
    sum_i W w_i G_i / m: it never drifts.  Of fast lines W and w_i are left underived.

    Parameters
    ----------
    psd: one-sided spectrum of force and torque, (6, 6), N2/Hz, N2.m/Hz, N2.m2/Hz; or inputs with spectra of any shape.
    band: edges of the band, Hz.
    seed: 0 or greater.
    period: length of the slow blocks, s; the lower edge of the band is about 2/period wide.
    rise_time: of the ramp W from 0 at t = 0, s.
    """

    function: ClassVar[str] = "add_noise"

    def __init__(
        self, psd: Array | Inputs, band: Array, seed: int, period: float = 100.0, rise_time: float = 2.0
    ) -> None:
        inputs, found = Inputs.of(psd), layers(band, period, half=False, overlap=True)
        words, self._kept = (library.NoiseLayer * len(found))(), list[object]()
        for layer, each in zip(found, words, strict=True):
            self._describe(layer, inputs, seed, rise_time, each)
        self.shortest_hop = min(0.5 * layer.period for layer in found)
        """Time from one block of a layer to the next, s."""
        self.words = library.Noise(addressof(words), len(words))
        self.words.kept = words

    def _describe(
        self, layer: Layer, inputs: Inputs, seed: int, rise_time: float, words: library.NoiseLayer
    ) -> None:
        """The layer for compiled functions, with room for its blocks: touched here, since fresh memory costs time."""
        amplitudes = share(layer) * inputs.root(layer.frequencies)
        lines = _make_lines(
            layer.key, layer.rate, layer.period, layer.numbers.tobytes(), rise_time, amplitudes.tobytes()
        )
        n, sources = layer.numbers.size, len(amplitudes)
        rooms = {
            "draws": np.empty(2 * sources * n + _BEHIND),
            # Each group has six spectra: one integral of all channels, or three of two.
            "terms": library.allocate(lines.n_terms * n * 2 * _LANES),
            "room": library.allocate((lines.points + 2) * 2 * _LANES),
            "sizes": np.empty(lines.n_terms * lines.points),
            "factor": np.ascontiguousarray(inputs.factor),
            "windows": lines.windows,
        }
        blocks = [np.full((layer.points, _CHANNELS), 0.0) for _ in range(library.BLOCKS)]
        key = make_words(make_key(Stream.GAUSSIAN, seed, layer.key, 0))  # the block follows
        for name, array in rooms.items():
            setattr(words, name, find_address(array))
        words.lines, words.rows[:], words.number[:] = lines.words, list(map(find_address, blocks)), [library.NONE] * 3
        words.words, words.n_words, words.sources, words.making = addressof(key), len(key), sources, library.NONE
        words.power, words.rate, words.period, words.rise_time = 2.0 / layer.period, layer.rate, layer.period, rise_time
        self._kept += [lines, rooms, blocks, key]
