"""From random numbers to the samples of a block of noise, phase by phase: compiled, or in numpy.

Both do the same; their results differ by rounding.  Each method but those of numpy takes some 30 us at most.
"""

from __future__ import annotations

from ctypes import byref
from typing import Any, ClassVar, Protocol

import numpy as np

from ..mechanism.quantities import Array, Complex
from ..numerics import library
from ..numerics.library import Arithmetic, find_address
from .polyphase import Polyphase
from .spectrum import Layer, share

_CHANNELS, _LANES = 6, 8  # as in numerics.h
_TOGETHER = 3  # transforms of numpy made at once: 25 us


class LayerLines:
    """The lines of a layer as all its blocks have them.

    Parameters
    ----------
    n_terms: how many integrals of a block are needed, from none on.

    Attributes
    ----------
    share: amplitude of each line (lines,).
    gains: what a line is multiplied by for each integral, (n_terms, lines).
    """

    def __init__(self, layer: Layer, n_terms: int) -> None:
        self.layer, self.n_terms = layer, n_terms
        self.polyphase = Polyphase(layer)
        self.share = share(layer)
        orders = np.arange(n_terms)[:, np.newaxis]
        self.gains: Complex = self.polyphase.gain / (2j * np.pi * layer.frequencies) ** orders


class Synthesis(Protocol):
    """Room for one block at a time, and what makes it.

    Attributes
    ----------
    draws: random numbers from 0 to below 1, (2, sources, lines), to be filled in.
    groups: in which the channels are transformed.
    """

    lines_at_once: ClassVar[int]
    draws: Array
    groups: int

    def draw(self, factor: Array, first: int, end: int) -> None:
        """Amplitudes of the lines from ``first`` to before ``end``, for a factor (6, sources), from ``draws``."""

    def store_samples(self, phase: int, group: int, sizes: Array, rows: Array) -> None:
        """The samples of a phase, for a group of channels, into the rows (all points, 6) of the block.

        ``sizes``: what each integral is multiplied by, (n_terms, points of the phase).
        """


def make_synthesis(lines: LayerLines, sources: int) -> Synthesis:
    """Compiled, where there is a library and it has transforms of this length."""
    arithmetic = library.find_arithmetic()
    if arithmetic is None or not _is_compiled(lines.polyphase.points):
        return PlainSynthesis(lines, sources)
    return CompiledSynthesis(lines, sources, arithmetic)


def _is_compiled(points: int) -> bool:
    """Even, without prime factors above 5."""
    for factor in (2, 3, 5):
        while points % (2 * factor) == 0:
            points //= factor
    return points == 2


class CompiledSynthesis:
    """As :class:`Synthesis`, in the library of :mod:`ps_fmu.numerics`."""

    lines_at_once: ClassVar[int] = 512

    def __init__(self, lines: LayerLines, sources: int, arithmetic: Arithmetic) -> None:
        layer, polyphase, n = lines.layer, lines.polyphase, lines.layer.numbers.size
        self.draws = np.empty((2, sources, n))
        self.groups = lines.n_terms  # each has six spectra: one integral of all channels, or three of two
        self._power = 2.0 / layer.period
        self._terms = library.allocate(self.groups * n * 2 * _LANES)
        self._room = library.allocate((polyphase.points + 2) * 2 * _LANES)
        runs = [library.Run(part.start, part.stop, bins.start, back) for part, (bins, back) in polyphase.runs]
        arrays = lines.share, lines.gains, polyphase.turns, polyphase.roots
        self._lines = library.Lines(
            *map(find_address, arrays), (library.Run * len(runs))(*runs),
            n, lines.n_terms, polyphase.phases, polyphase.points, len(runs),
        )  # fmt: skip
        self._kept = lines  # its arrays are in use
        self._places = find_address(self.draws), find_address(self._terms), find_address(self._room)
        self._draw: Any = arithmetic.draw_lines
        self._store_samples: Any = arithmetic.store_samples

    def draw(self, factor: Array, first: int, end: int) -> None:
        """As :meth:`Synthesis.draw`."""
        draws, terms, _ = self._places
        self._draw(
            byref(self._lines), draws, find_address(factor), factor.shape[1], self._power, terms, first, end
        )

    def store_samples(self, phase: int, group: int, sizes: Array, rows: Array) -> None:
        """As :meth:`Synthesis.store_samples`."""
        _, terms, room = self._places
        self._store_samples(byref(self._lines), terms, phase, group, find_address(sizes), room, find_address(rows))


class PlainSynthesis:
    """As :class:`Synthesis`, in numpy."""

    lines_at_once: ClassVar[int] = 256

    def __init__(self, lines: LayerLines, sources: int) -> None:
        n, self._shared = lines.layer.numbers.size, lines
        self.draws = np.empty((2, sources, n))
        self._together = _TOGETHER // lines.n_terms  # channels
        self.groups = _CHANNELS // self._together
        self._terms = np.empty((_CHANNELS, lines.n_terms, n), dtype=np.complex128)

    def draw(self, factor: Array, first: int, end: int) -> None:
        """As :meth:`Synthesis.draw`."""
        shared, chunk, (u, v) = self._shared, slice(first, end), self.draws
        # Box-Muller: E|c|^2 = 2/T, uniform phase.
        size = np.sqrt(-2.0 / shared.layer.period * np.log1p(-u[:, chunk]))
        lines = factor @ (size * np.exp(2j * np.pi * v[:, chunk]) * shared.share[chunk])
        np.multiply(lines[:, np.newaxis], shared.gains[:, chunk], out=self._terms[:, :, chunk])

    def store_samples(self, phase: int, group: int, sizes: Array, rows: Array) -> None:
        """As :meth:`Synthesis.store_samples`."""
        polyphase, channels = self._shared.polyphase, slice(group * self._together, (group + 1) * self._together)
        samples = polyphase.transform(polyphase.fold(self._terms[channels], phase))
        samples *= sizes
        rows[phase :: polyphase.phases, channels] = np.add.reduce(samples, axis=1).T
