"""Endless Gaussian noise with a given spectrum of force and torque, as a function of time and seed alone."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise

import numpy as np

from ..mechanism.quantities import Array
from ..numerics import library
from ..numerics.calls import Calls, Pair
from ..numerics.normal import Stream, make_key
from .sample_table import SampleTable, make_calls
from .spectrum import Inputs, Layer, Weight, crossfade, layers, ramp, share
from .synthesis import LayerLines, Synthesis, make_synthesis

_MOST_SPARE = 2  # blocks of a layer, as many as a source begins with
_MANY_CYCLES = 25.0
"""A line with so many cycles while it fades in or out needs no correction: of its impulse 4e-7 is left, since the steps
of :mod:`.spectrum` have four smooth derivatives.  Blocks of the fast layer, which has lines from 15 Hz on, then cost a
third; they are off the corrected ones by 1.6 % of a line at 15 Hz and by less above, while they fade."""


class _LayerTables:
    """What all blocks of a layer share, whatever the seed: 5 MB for 0.1 to 1000 Hz; ``amplitudes`` (sources, lines)."""

    def __init__(self, layer: Layer, rise_time: float, amplitudes: Array) -> None:
        self._rise_time = rise_time
        cycles = layer.frequencies.min() * min(rise_time, 0.5 * layer.period)
        self.lines = LayerLines(layer, 1 if cycles >= _MANY_CYCLES else 3, amplitudes)  # g'', or g'', g' and g
        self._elapsed = self._split(np.arange(layer.points) / layer.rate)
        """Time since the start of a block, (phases, points), s."""
        window = crossfade(np.arange(layer.points) / layer.rate, 0.5 * layer.period)
        phases = zip(*map(self._split, window), strict=True)
        self.windows = np.stack([self._stack(Weight(*rows)) for rows in phases])
        """What g'', g' and g of a block that does not rise are multiplied by, (phases, terms, points)."""
        self._weights = window
        self._rising: dict[tuple[float, int], Array] = {}
        # Sources in other threads take from these, too: each method of a deque is one step for them.
        self.spare: dict[bytes, deque[Synthesis]] = {}
        """By the instructions that are used."""
        self.spare_rows: deque[Array] = deque(maxlen=_MOST_SPARE)

    def is_rising(self, start: float) -> bool:
        """Whether sizes of a block that starts at ``start`` (s) are its own: they take some time."""
        return start < self._rise_time

    def get_sizes(self, start: float, phase: int) -> Array:
        """What g'', g' and g of a rising block that starts at ``start`` (s) are multiplied by, (terms, points)."""
        found = self._rising.get((start, phase))  # of the two blocks that every simulation begins with
        if found is None:
            rising = ramp(start + self._elapsed[phase], self._rise_time)
            window = Weight(*(self._split(weight)[phase] for weight in self._weights))
            found = self._stack(window.times(rising))
            if len(self._rising) < 2 * self.lines.phases:
                self._rising[start, phase] = found
        return found

    def _stack(self, weight: Weight) -> Array:
        return np.stack([weight.value, 2.0 * weight.rate, weight.curvature][: self.lines.n_terms])

    def _split(self, values: Array) -> Array:
        return np.ascontiguousarray(values.reshape(-1, self.lines.phases).T)


@lru_cache(maxsize=2)  # both layers of one source: a reset, or another source, saves 40 of 60 ms
def _make_tables(
    key: int, rate: float, period: float, numbers: bytes, rise_time: float, amplitudes: bytes
) -> _LayerTables:
    layer = Layer(key, rate, period, np.frombuffer(numbers, np.int64))
    return _LayerTables(layer, rise_time, np.frombuffer(amplitudes).reshape(-1, layer.numbers.size))


class BlockShape:
    """What all blocks of a layer share.

    ``rise_time``: of the ramp from 0 at t = 0, s.
    """

    def __init__(self, layer: Layer, inputs: Inputs, rise_time: float) -> None:
        self.layer, self.factor = layer, np.ascontiguousarray(inputs.factor)
        amplitudes = share(layer) * inputs.root(layer.frequencies)
        self.tables = _make_tables(
            layer.key, layer.rate, layer.period, layer.numbers.tobytes(), rise_time, amplitudes.tobytes()
        )
        # Of the layer, not of the shape: a source that is reset need not fetch its memory from the system again.
        instructions = library.find_arithmetic().instructions
        self._spare = self.tables.spare.setdefault(instructions, deque(maxlen=1))
        self._spare_rows = self.tables.spare_rows
        synthesis = self.take_synthesis()
        self.n_parts = 3 + synthesis.n_parts
        """In which a block is made, at most, but for its rise."""
        self.give_back(synthesis)

    def take_synthesis(self) -> Synthesis:
        """What makes one block, to be given back: fresh memory costs as much time as what is done in it."""
        try:
            return self._spare.pop()
        except IndexError:
            return make_synthesis(self.tables.lines)

    def give_back(self, synthesis: Synthesis) -> None:
        """Keep room for the next block."""
        self._spare.append(synthesis)

    def take_rows(self) -> Array | None:
        """Rows of a block that is not used any more; None: there are none."""
        try:
            return self._spare_rows.pop()
        except IndexError:
            return None

    def recycle(self, table: SampleTable) -> None:
        """Keep the memory of a block that nobody uses any more."""
        self._spare_rows.append(table.values)


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

    @property
    def n_parts(self) -> int:
        """In which it is made, at most; the last is to keep it."""
        tables = self.shape.tables
        return self.shape.n_parts + (tables.lines.phases if tables.is_rising(self.start) else 0)

    def make(self) -> Iterator[Calls | None]:
        """Make it; yields None after each part, or calls."""
        shape, tables = self.shape, self.shape.tables
        synthesis = shape.take_synthesis()
        yield None
        spare = shape.take_rows()
        rows = np.empty((shape.layer.points, len(shape.factor))) if spare is None else spare
        sizes = tables.windows
        if tables.is_rising(self.start):
            sizes = np.empty_like(tables.windows)
            for phase in range(len(sizes)):
                sizes[phase] = tables.get_sizes(self.start, phase)
                yield None
        yield None
        yield from synthesis.make(self.key, shape.factor, sizes, rows, clear=spare is None)
        shape.give_back(synthesis)
        self.table = SampleTable(rows, shape.layer.rate, self.start)


_ROWS = 1024  # read by a call: 20 us, twice that where their memory is new
_KEPT = 3  # blocks per layer: two are alive at any time, and one is about to be


class GaussianNoise:
    """f(t) = d2/dt2 sum_i W w_i G_i: independent blocks of lines, faded into each other and in from rest.

    Block i lives for one period of its lines, fades in over the first half and out over the second (equal
    power); its lines have complex Gaussian amplitudes drawn from (seed, layer, i).  Hence any time can be
    computed on its own, nothing repeats, and a free body of mass m that f pushes from rest is at
    sum_i W w_i G_i / m: it never drifts.  Of fast lines W and w_i are left underived (:mod:`.gaussian` says why).

    Parameters
    ----------
    psd: one-sided spectrum of force and torque, (6, 6), N2/Hz, N2.m/Hz, N2.m2/Hz; or inputs with spectra of any shape.
    band: edges of the band, Hz.
    seed: 0 or greater.
    period: length of the slow blocks, s; the lower edge of the band is about 2/period wide.
    rise_time: of the ramp W from 0 at t = 0, s.
    """

    def __init__(
        self, psd: Array | Inputs, band: Array, seed: int, period: float = 100.0, rise_time: float = 2.0
    ) -> None:
        self._seed = seed
        self._layers = layers(band, period, half=False, overlap=True)
        inputs = Inputs.of(psd)
        self._shapes = {layer.key: BlockShape(layer, inputs, rise_time) for layer in self._layers}
        self._blocks: dict[int, dict[int, SampleTable]] = {layer.key: {} for layer in self._layers}

    def __call__(self, time: Array) -> Array:
        """Force (N) and torque (N.m) at ascending times (n,) in s, shape (n, 6)."""
        wrench = np.zeros((time.size, 6))
        for _ in self.add(wrench, time):
            pass
        return wrench

    def __del__(self) -> None:
        """The next source takes over the memory of the blocks: 2100 pages, 4 of 27 ms at its start."""
        for key, blocks in getattr(self, "_blocks", {}).items():
            for table in blocks.values():
                self._shapes[key].recycle(table)

    def count_parts(self, n: int) -> int:
        """How often :meth:`add` nearly always yields for so many times."""
        return len(self._layers) * -(-n // _ROWS)

    def add(self, wrench: Array, time: Array, *, clear: bool = False) -> Iterator[Calls | None]:
        """Add force and torque at ascending times (n,) in s to ``wrench`` (n, 6), in parts, or in calls.

        ``clear``: to zeros, whatever is there.
        """
        time = np.ascontiguousarray(time, dtype=np.float64)
        work: list[Pair] = []
        kept: list[object] = [wrench]
        for layer in self._layers:
            stretches = _find_stretches(layer, time)
            for index, part in stretches:
                known = self._blocks[layer.key]
                if len(stretches) > 1:  # once in a while, by code that is in no cache
                    yield None
                if work and not (index in known and index + 1 in known):
                    # A block that is made now may take the place of one that the calls read.
                    yield from Calls(work, *kept)
                    work, kept = [], [wrench]
                blocks = [self._get(layer, i).values for i in (index, index + 1)]
                begin, shifts = index * 0.5 * layer.period, [layer.points // 2, 0]
                made, used = make_calls(
                    wrench[part], time[part], blocks, shifts, begin, layer.rate, _ROWS, clear=clear
                )
                work += made
                kept += used
            clear = False
        yield from Calls(work, *kept)

    def prepare(self, time: Array) -> Iterator[int | Calls]:
        """Make the blocks for ascending times (n,) in s in small parts; yields how many are still to come, or calls.

        Makes none where more are needed than are kept.
        """
        needed = [
            (layer, sorted({i for index, _ in _find_stretches(layer, time) for i in (index, index + 1)}))
            for layer in self._layers
        ]
        missing = [
            (layer, index, self._begin(layer, index))
            for layer, indices in needed
            for index in indices
            if len(indices) <= _KEPT and index not in self._blocks[layer.key]
        ]
        left = sum(block.n_parts for _, _, block in missing)
        for layer, index, block in missing:
            last = left - block.n_parts
            for made in block.make():
                left -= 1 if made is None else 1 + made.left
                yield left if made is None else made.put_before(left - 1)
            left = last
            self._keep(layer, block, index)
            yield left

    def _get(self, layer: Layer, index: int) -> SampleTable:
        """Block ``index``; what another call needs may have replaced it."""
        return self._blocks[layer.key].get(index) or self._finish(layer, self._begin(layer, index), index)

    def _begin(self, layer: Layer, index: int) -> Block:
        """Block ``index``, which lives from (index - 1) to (index + 1) half periods."""
        key = make_key(Stream.GAUSSIAN, self._seed, layer.key, index % 2**32)
        return Block(self._shapes[layer.key], key, (index - 1) * 0.5 * layer.period)

    def _finish(self, layer: Layer, block: Block, index: int) -> SampleTable:
        for _ in block.make():
            pass
        return self._keep(layer, block, index)

    def _keep(self, layer: Layer, block: Block, index: int) -> SampleTable:
        known, recycle = self._blocks[layer.key], self._shapes[layer.key].recycle
        assert block.table is not None
        if index in known:  # another call has made it meanwhile
            recycle(block.table)
            return known[index]
        if len(known) >= _KEPT:
            # The oldest but for the neighbours, one of which may be in use: a source in another thread may take it.
            recycle(known.pop(next(i for i in known if abs(i - index) > 1)))
        known[index] = block.table
        return block.table


def _find_stretches(layer: Layer, time: Array) -> list[tuple[int, slice]]:
    """The parts of ascending times (n,) in which the same two blocks are alive, and the number of the older one."""
    if not time.size:
        return []
    hop = 0.5 * layer.period
    first, last = int(float(time[0]) // hop), int(float(time[-1]) // hop)
    if first == last:  # as nearly always
        return [(first, slice(0, time.size))]
    if last == first + 1:  # not by all quotients: those of 4096 times take 50 us
        edge = int(time.searchsorted(last * hop))  # but for rounding
        while float(time[edge - 1]) // hop >= last:
            edge -= 1
        while float(time[edge]) // hop < last:
            edge += 1
        return [(first, slice(0, edge)), (last, slice(edge, time.size))]
    hops = time // hop
    edges = [0, *(np.flatnonzero(np.diff(hops)) + 1).tolist(), time.size]
    return [(int(hops[start]), slice(start, end)) for start, end in pairwise(edges)]
