"""From random numbers to the samples of a block of noise, phase by phase: every P-th sample by a transform of its own.

With N = P n, sample number P m + j of ``Re sum_k c_k exp(2 pi i k (P m + j) / N)`` is sample number m of
``Re sum_k (c_k exp(2 pi i k j / N)) exp(2 pi i k m / n)``: a transform of n points, in which lines above n/2 appear as
their aliases.  One of 2500 points takes 15 us, one of 50 000 takes 400 us.

The compiled transform takes even numbers of points without prime factors above 5; numpy's takes all others.  Each part
takes some 30 us at most.
"""

from __future__ import annotations

from collections.abc import Iterator
from ctypes import pointer
from itertools import pairwise
from typing import Any

import numpy as np

from ..mechanism.quantities import Array, Complex
from ..numerics import calls, library
from ..numerics.calls import CallList, Calls
from ..numerics.library import find_address
from ..numerics.normal import make_words, seed
from .spectrum import Layer

_MOST_POINTS = 2500  # of a transform
_FEWEST_POINTS = 500  # with fewer, parts cost more than they compute: one transform for all samples instead


class LayerLines:
    """The lines of a layer as all its blocks have them, and their samples phase by phase.

    Parameters
    ----------
    n_terms: how many integrals of a block are needed, from none on.
    share: amplitude of each line of each independent source, (sources, lines).

    Attributes
    ----------
    gains: what a line is multiplied by for each integral, (n_terms, lines).
    phases: P.  Phase j has the samples j, j + P, ...
    points: n, samples of a phase.
    turns: exp(2 pi i k j / N) of line k and phase j, (phases, lines).
    roots: exp(2 pi i m / n), (points,).
    runs: lines that go to bins side by side, their bins, and whether their conjugates go there.
    """

    def __init__(self, layer: Layer, n_terms: int, share: Array) -> None:
        self.layer, self.n_terms, self.share = layer, n_terms, np.ascontiguousarray(share)
        total, numbers = layer.points, layer.numbers
        self.points = _choose_points(total)
        self.phases = total // self.points
        roots = np.exp(2j * np.pi / total * np.arange(total))
        self.turns = roots[np.outer(np.arange(self.phases), numbers) % total]
        self.roots = np.ascontiguousarray(roots[:: self.phases])
        # Runs of lines that go to bins side by side: up from 0 to n/2, then down again, and so on.
        runs = 2 * numbers // self.points
        edges = [0, *(np.flatnonzero(np.diff(runs)) + 1).tolist(), numbers.size]
        self.runs = [
            (slice(first, end), self._find_bins(int(numbers[first]), int(numbers[end - 1]), int(runs[first])))
            for first, end in pairwise(edges)
        ]
        once = (2 * numbers) % self.points == 0  # a transform counts a line at 0 or n/2 once, all others twice
        orders = np.arange(n_terms)[:, np.newaxis]
        gain = np.where(once, 1.0, 0.5) * self.points
        self.gains: Complex = gain / (2j * np.pi * layer.frequencies) ** orders

    def _find_bins(self, first: int, last: int, run: int) -> tuple[slice, bool]:
        """The bins of the lines from ``first`` to ``last``, and whether their conjugates go there."""
        n = self.points
        if run % 2 == 0:
            shift = run // 2 * n
            return slice(first - shift, last - shift + 1), False
        shift = (run + 1) // 2 * n
        end = shift - last - 1
        return slice(shift - first, end if end >= 0 else None, -1), True

    @property
    def bins(self) -> int:
        """Of the spectrum of a phase."""
        return self.points // 2 + 1

    def fold(self, lines: Complex, phase: int) -> Complex:
        """The spectra of a phase (..., bins), for amplitudes (..., lines) that are multiplied by one of the gains."""
        turned = lines * self.turns[phase]
        spectra = np.zeros((*lines.shape[:-1], self.bins), dtype=np.complex128)
        for part, (bins, is_mirrored) in self.runs:
            spectra[..., bins] += turned[..., part].conj() if is_mirrored else turned[..., part]
        return spectra

    def transform(self, spectra: Complex) -> Array:
        """Samples (..., n) of a phase from its spectra (..., bins)."""
        return np.asarray(np.fft.irfft(spectra, self.points, axis=-1))


def _choose_points(total: int) -> int:
    """The largest divisor that makes small transforms."""
    found = [n for n in range(_FEWEST_POINTS, _MOST_POINTS + 1) if total % n == 0]
    return max(found, default=total)


_CHANNELS, _LANES = 6, 8  # as in numerics.h
_BEHIND = 3  # numbers that the compiled function may write behind the last
_NUMBERS = 12_288  # random numbers of a part, a multiple of four: 30 us
_LINES = 512  # drawn in a part
_CLEARED = 3000  # numbers
# In numpy:
_TOGETHER = 3  # transforms made at once: 25 us
_PLAIN_LINES = 256
_FIRST_LINES = 16  # drawn in the first part, whose code has not run for a while: 60 us by that alone
_ROWS = 500  # cleared in a part


def make_synthesis(lines: LayerLines) -> Synthesis:
    """Compiled, where the library has transforms of this length.  Raises NotCompiledError."""
    return CompiledSynthesis(lines) if _is_compiled(lines.points) else PlainSynthesis(lines)


def _is_compiled(points: int) -> bool:
    """Even, without prime factors above 5."""
    for factor in (2, 3, 5):
        while points % (2 * factor) == 0:
            points //= factor
    return points == 2


class CompiledSynthesis:
    """Room for one block at a time, and what makes it: calls of the library of :mod:`ps_fmu.numerics`."""

    def __init__(self, lines: LayerLines) -> None:
        layer, n, sources = lines.layer, lines.layer.numbers.size, len(lines.share)
        draws = np.empty(2 * sources * n + _BEHIND)
        groups = lines.n_terms  # each has six spectra: one integral of all channels, or three of two
        terms = library.allocate(groups * n * 2 * _LANES)
        room = library.allocate((lines.points + 2) * 2 * _LANES)
        runs = [library.Run(part.start, part.stop, bins.start, back) for part, (bins, back) in lines.runs]
        arrays = lines.share, lines.gains, lines.turns, lines.roots
        shared = library.Lines(
            *map(find_address, arrays), (library.Run * len(runs))(*runs),
            n, lines.n_terms, lines.phases, lines.points, len(runs),
        )  # fmt: skip
        self._kept = lines, draws, terms, room, shared  # they are in use
        self._block = calls.NoiseBlock(
            pointer(shared), None, find_address(draws), find_address(terms), find_address(room),
            sources=sources, power=2.0 / layer.period,
        )  # fmt: skip
        a: Any = library.find_arithmetic()
        clearing = self._split(a.clear_rows, layer.points * _CHANNELS, _CLEARED)
        self._n_clearing = len(clearing)
        self._calls = CallList([
            *clearing,
            *self._split(a.draw_numbers, 2 * sources * n, _NUMBERS),
            *self._split(a.draw_some_lines, n, _LINES),
            *((a.store_phase, calls.Part(pointer(self._block), k, 0)) for k in range(lines.phases * groups)),
        ])  # fmt: skip
        self.n_parts = 1 + len(self._calls)

    def _split(self, function: int, n: int, size: int) -> list[tuple[int, calls.Part]]:
        """Calls for n items, so many at a time."""
        return [
            (function, calls.Part(pointer(self._block), first, min(first + size, n))) for first in range(0, n, size)
        ]

    def make(
        self, key: tuple[int, ...], factor: Array, sizes: Array, rows: Array, *, clear: bool
    ) -> Iterator[Calls]:
        """Make the samples of a block, in parts.

        Parameters
        ----------
        key: whole numbers that its random numbers belong to.
        factor: (6, sources), of the lines.
        sizes: what each integral is multiplied by, (phases, n_terms, points of a phase).
        rows: for all points, (points, 6).
        clear: the memory of the rows is new: it comes from the system with its first use.
        """
        words, block = make_words(key), self._block
        block.factor, block.rows, block.sizes = map(find_address, (factor, rows, sizes))
        block.words, block.n_words = words, len(words)
        yield from Calls(self._calls, self, sizes, factor, rows, first=0 if clear else self._n_clearing)


class PlainSynthesis:
    """As :class:`CompiledSynthesis`, in numpy, for transforms of any length."""

    def __init__(self, lines: LayerLines) -> None:
        n, self._shared = lines.layer.numbers.size, lines
        self._draws = np.empty((2, len(lines.share), n))
        self._together = _TOGETHER // lines.n_terms  # channels
        self._groups = _CHANNELS // self._together
        self._terms = np.empty((_CHANNELS, lines.n_terms, n), dtype=np.complex128)
        self._edges = [0, *range(min(_FIRST_LINES, n), n, _PLAIN_LINES), n]
        n_stored = lines.phases * self._groups
        n_cleared = -(-lines.layer.points // _ROWS)
        self.n_parts = 2 + -(-self._draws.size // _NUMBERS) + len(self._edges) - 1 + n_cleared + n_stored

    def make(
        self, key: tuple[int, ...], factor: Array, sizes: Array, rows: Array, *, clear: bool
    ) -> Iterator[None]:
        """As :meth:`CompiledSynthesis.make`."""
        # 10 us for these three lines, but 150 us where their code has not run for a while.
        sequence = seed(make_words(key))
        yield
        philox = np.random.Philox(sequence)
        yield
        random, numbers = np.random.Generator(philox), self._draws.reshape(-1)
        for first in range(0, numbers.size, _NUMBERS):
            random.random(out=numbers[first : first + _NUMBERS])
            yield
        for first, end in pairwise(self._edges):
            self._draw(factor, first, end)
            yield
        for first in range(0, len(rows) if clear else 0, _ROWS):
            rows[first : first + _ROWS] = 0.0
            yield
        for phase in range(len(sizes)):
            for group in range(self._groups):
                self._store_samples(phase, group, sizes[phase], rows)
                yield

    def _draw(self, factor: Array, first: int, end: int) -> None:
        """Amplitudes of the lines from ``first`` to before ``end``."""
        shared, chunk, (u, v) = self._shared, slice(first, end), self._draws
        # Box-Muller: E|c|^2 = 2/T, uniform phase.
        size = np.sqrt(-2.0 / shared.layer.period * np.log1p(-u[:, chunk]))
        lines = factor @ (size * np.exp(2j * np.pi * v[:, chunk]) * shared.share[:, chunk])
        np.multiply(lines[:, np.newaxis], shared.gains[:, chunk], out=self._terms[:, :, chunk])

    def _store_samples(self, phase: int, group: int, sizes: Array, rows: Array) -> None:
        """The samples of a phase, for a group of channels."""
        lines, channels = self._shared, slice(group * self._together, (group + 1) * self._together)
        samples = lines.transform(lines.fold(self._terms[channels], phase))
        samples *= sizes
        rows[phase :: lines.phases, channels] = np.add.reduce(samples, axis=1).T


Synthesis = CompiledSynthesis | PlainSynthesis
"""Room for one block at a time, and what makes it in ``n_parts`` parts."""
