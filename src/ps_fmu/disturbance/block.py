"""One block of Gaussian noise: random lines to samples, in parts of 20 to 60 us."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from ctypes import byref
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise

import numpy as np

from ..mechanism.quantities import Array
from ..numerics import library
from ..numerics.library import Arithmetic, Draws, find_address
from .polyphase import Polyphase
from .sample_table import SampleTable
from .smooth import Weight, crossfade, ramp
from .spectrum import Layer, share

_LINES = 2048  # drawn in a part by compiled functions: 35 us
_PLAIN_LINES = 256  # without them
_FIRST_LINES = 16  # the first of them, whose code has not run for a while: 60 us by that alone
_NUMBERS = 12_288  # random numbers of a part: 30 us
_ROWS = 500  # cleared in a part
_TOGETHER = 3  # transforms made at once: 25 us
_MOST_SPARE = 2  # blocks of a layer, as many as a source begins with
_MANY_CYCLES = 25.0
"""A line with so many cycles while it fades in or out needs no correction: of its impulse 4e-7 is left, since the steps
of :mod:`.smooth` have four smooth derivatives.  Blocks of the fast layer, which has lines from 15 Hz on, then cost a
third; they are off the corrected ones by 1.6 % of a line at 15 Hz and by less above, while they fade."""


class _LayerTables:
    """What all blocks of a layer share, whatever the spectrum and the seed: 5 MB for 0.1 to 1000 Hz."""

    def __init__(self, layer: Layer, rise_time: float) -> None:
        self._rise_time = rise_time
        self.polyphase = Polyphase(layer)
        self.share = share(layer)
        cycles = layer.frequencies.min() * min(rise_time, 0.5 * layer.period)
        self.n_terms = 1 if cycles >= _MANY_CYCLES else 3  # g'', or g'', g' and g
        orders = np.arange(self.n_terms)[:, np.newaxis]
        self.gains = self.polyphase.gain / (2j * np.pi * layer.frequencies) ** orders
        self._elapsed = self._split(np.arange(layer.points) / layer.rate)
        """Time since the start of a block, (phases, points), s."""
        window = crossfade(np.arange(layer.points) / layer.rate, 0.5 * layer.period)
        self._windows = [Weight(*rows) for rows in zip(*map(self._split, window), strict=True)]
        """By phase."""
        self._rising: dict[tuple[float, int], Array] = {}
        # Sources in other threads take from these, too: each method of a deque is one step for them.
        self.spare: dict[tuple[int, ...], deque[_Workspace]] = {}
        """By the shape of the factor."""
        self.spare_rows: dict[int, deque[Array]] = {}
        """By the number of channels."""

    def get_sizes(self, start: float, phase: int) -> Array:
        """What g'', g' and g of a block that starts at ``start`` (s) are multiplied by, (terms, points)."""
        if start >= self._rise_time:
            return self._stack(self._windows[phase])
        found = self._rising.get((start, phase))  # of the two blocks that every simulation begins with
        if found is None:
            rising = ramp(start + self._elapsed[phase], self._rise_time)
            found = self._stack(self._windows[phase].times(rising))
            if len(self._rising) < 2 * self.polyphase.phases:
                self._rising[start, phase] = found
        return found

    def _stack(self, weight: Weight) -> Array:
        return np.stack([weight.value, 2.0 * weight.rate, weight.curvature][: self.n_terms])

    def _split(self, values: Array) -> Array:
        return np.ascontiguousarray(values.reshape(-1, self.polyphase.phases).T)


@lru_cache(maxsize=2)  # both layers of one source: a reset, or another source, saves 40 of 60 ms
def _make_tables(key: int, rate: float, period: float, numbers: bytes, rise_time: float) -> _LayerTables:
    return _LayerTables(Layer(key, rate, period, np.frombuffer(numbers, np.int64)), rise_time)


class BlockShape:
    """What all blocks of a layer share.

    Parameters
    ----------
    factor: (6, r), see :func:`.spectrum.factor`.
    rise_time: of the ramp from 0 at t = 0, s.
    """

    def __init__(self, layer: Layer, factor: Array, rise_time: float) -> None:
        self.layer, self.factor = layer, factor
        self.arithmetic = library.find_arithmetic()
        self.tables = _make_tables(layer.key, layer.rate, layer.period, layer.numbers.tobytes(), rise_time)
        # Of the layer, not of the shape: a source that is reset need not fetch its memory from the system again.
        self._spare = self.tables.spare.setdefault(factor.shape, deque(maxlen=1))
        self._spare_rows = self.tables.spare_rows.setdefault(len(factor), deque(maxlen=_MOST_SPARE))

    @property
    def n_parts(self) -> int:
        """In which a block is made, at most."""
        channels, sources = self.factor.shape
        chunks = 1 + -(-self.layer.numbers.size // self.lines_at_once)
        draws = -(-2 * sources * self.layer.numbers.size // _NUMBERS)
        clearing = -(-self.layer.points // _ROWS)
        groups = -(-channels * self.tables.n_terms // _TOGETHER)
        return 7 + draws + chunks + clearing + self.tables.polyphase.phases * groups

    @property
    def lines_at_once(self) -> int:
        """Lines that are drawn in a part."""
        return _PLAIN_LINES if self.arithmetic is None else _LINES

    def take_workspace(self) -> _Workspace:
        """Room for one block, which has to be given back: fresh memory costs as much time as what is done in it."""
        try:
            return self._spare.pop()
        except IndexError:
            return _Workspace(len(self.factor), self.factor.shape[1], self.layer, self.tables)

    def give_back(self, workspace: _Workspace) -> None:
        """Keep room for the next block."""
        self._spare.append(workspace)

    def take_rows(self) -> Array | None:
        """Rows of a block that is not used any more; None: there are none."""
        try:
            return self._spare_rows.pop()
        except IndexError:
            return None

    def recycle(self, table: SampleTable) -> None:
        """Keep the memory of a block that nobody uses any more."""
        self._spare_rows.append(table.values)


class _Workspace:
    """Random numbers, amplitudes and what they are multiplied to, for one block at a time."""

    def __init__(self, channels: int, sources: int, layer: Layer, tables: _LayerTables) -> None:
        n = layer.numbers.size
        self.draws = np.empty((2, sources, n))
        self.terms = np.empty((channels, tables.n_terms, n), dtype=np.complex128)
        self.spectra = np.empty((_TOGETHER, tables.polyphase.bins), dtype=np.complex128)


@dataclass(eq=False)
class Block:
    """A block that is being made.

    Parameters
    ----------
    key: of its random numbers.
    start: s.
    """

    shape: BlockShape
    key: tuple[int, ...]
    start: float

    table: SampleTable | None = None
    """When :meth:`make` has ended."""

    def make(self) -> Iterator[None]:
        """Make it; yields after each part, at most ``shape.n_parts`` times."""
        shape, tables, polyphase = self.shape, self.shape.tables, self.shape.tables.polyphase
        workspace = shape.take_workspace()
        terms = workspace.terms
        yield from self._draw(workspace)
        spare = shape.take_rows()
        rows = np.empty((shape.layer.points, len(terms))) if spare is None else spare
        if spare is None:
            for first in range(0, len(rows), _ROWS):  # the memory comes with its first use
                rows[first : first + _ROWS] = 0.0
                yield
        together = _TOGETHER // tables.n_terms  # channels
        for phase in range(polyphase.phases):
            sizes = tables.get_sizes(self.start, phase)
            if phase == 0:
                yield
            for first in range(0, len(terms), together):
                group = terms[first : first + together]
                flat = group.reshape(-1, group.shape[-1])
                spectra = workspace.spectra[: len(flat)]
                polyphase.fold(flat, phase, spectra, shape.arithmetic)
                if phase == first == 0:  # code and numbers are in no cache yet: it takes three times as long
                    yield
                samples = polyphase.transform(spectra).reshape(len(group), tables.n_terms, -1)
                if phase == first == 0:
                    yield
                _store(samples, sizes, rows[phase :: polyphase.phases, first : first + together], shape.arithmetic)
                yield
        shape.give_back(workspace)
        self.table = SampleTable(rows, shape.layer.rate, self.start)

    def _draw(self, workspace: _Workspace) -> Iterator[None]:
        """Amplitudes of the lines with all gains, from random numbers."""
        # 10 us for these three lines, but 150 us where their code has not run for a while.
        yield
        sequence = np.random.SeedSequence(self.key)
        yield
        philox = np.random.Philox(sequence)
        yield
        random, numbers = np.random.Generator(philox), workspace.draws.reshape(-1)
        for first in range(0, numbers.size, _NUMBERS):
            random.random(out=numbers[first : first + _NUMBERS])
            yield
        shape, n = self.shape, workspace.draws.shape[2]
        draw = _draw_plainly if shape.arithmetic is None else _make_drawing(shape, workspace, shape.arithmetic)
        for first, end in pairwise([0, *range(min(_FIRST_LINES, n), n, shape.lines_at_once), n]):
            draw(shape, workspace, first, end)
            yield


_Drawing = Callable[[BlockShape, _Workspace, int, int], None]


def _make_drawing(shape: BlockShape, workspace: _Workspace, arithmetic: Arithmetic) -> _Drawing:
    """As :func:`_draw_plainly`, compiled."""
    draws, terms, tables = workspace.draws, workspace.terms, shape.tables
    factor = np.ascontiguousarray(shape.factor)
    addresses = map(find_address, (draws, factor, tables.share, tables.gains, terms))
    (channels, sources), (n_terms, n) = factor.shape, tables.gains.shape
    whole = Draws(*addresses, sources, channels, n, n_terms, 2.0 / shape.layer.period)
    function = arithmetic.draw_lines

    def draw(shape: BlockShape, workspace: _Workspace, first: int, end: int, kept: Array = factor) -> None:
        function(byref(whole), first, end)

    return draw


def _draw_plainly(shape: BlockShape, workspace: _Workspace, first: int, end: int) -> None:
    """The terms of some lines from their random numbers, by Box-Muller: E|c|^2 = 2/T, uniform phase."""
    chunk, (u, v) = slice(first, end), workspace.draws
    c = np.sqrt(-2.0 / shape.layer.period * np.log1p(-u[:, chunk])) * np.exp(2j * np.pi * v[:, chunk])
    lines = shape.factor @ (c * shape.tables.share[chunk])
    np.multiply(lines[:, np.newaxis], shape.tables.gains[:, chunk], out=workspace.terms[:, :, chunk])


def _store(samples: Array, sizes: Array, rows: Array, arithmetic: Arithmetic | None) -> None:
    """Multiply samples (m, terms, points) by the sizes of their terms (terms, points); sums go to rows (points, m)."""
    if arithmetic is None:
        rows[...] = np.add.reduce(samples * sizes, axis=1).T
        return
    place, stride = rows.__array_interface__["data"][0], rows.strides[0] // rows.itemsize
    arithmetic.weigh(find_address(samples), find_address(sizes), *samples.shape, place, stride)
