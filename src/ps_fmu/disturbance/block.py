"""One block of Gaussian noise: random lines to samples, in parts."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from ..mechanism.quantities import Array
from ..numerics import library
from ..numerics.calls import Calls
from .sample_table import SampleTable
from .smooth import Weight, crossfade, ramp
from .spectrum import Layer
from .synthesis import LayerLines, Synthesis, make_synthesis

_MOST_SPARE = 2  # blocks of a layer, as many as a source begins with
_MANY_CYCLES = 25.0
"""A line with so many cycles while it fades in or out needs no correction: of its impulse 4e-7 is left, since the steps
of :mod:`.smooth` have four smooth derivatives.  Blocks of the fast layer, which has lines from 15 Hz on, then cost a
third; they are off the corrected ones by 1.6 % of a line at 15 Hz and by less above, while they fade."""


class _LayerTables:
    """What all blocks of a layer share, whatever the spectrum and the seed: 5 MB for 0.1 to 1000 Hz."""

    def __init__(self, layer: Layer, rise_time: float) -> None:
        self._rise_time = rise_time
        cycles = layer.frequencies.min() * min(rise_time, 0.5 * layer.period)
        self.lines = LayerLines(layer, 1 if cycles >= _MANY_CYCLES else 3)  # g'', or g'', g' and g
        self.polyphase = self.lines.polyphase
        self._elapsed = self._split(np.arange(layer.points) / layer.rate)
        """Time since the start of a block, (phases, points), s."""
        window = crossfade(np.arange(layer.points) / layer.rate, 0.5 * layer.period)
        phases = zip(*map(self._split, window), strict=True)
        self.windows = np.stack([self._stack(Weight(*rows)) for rows in phases])
        """What g'', g' and g of a block that does not rise are multiplied by, (phases, terms, points)."""
        self._weights = window
        self._rising: dict[tuple[float, int], Array] = {}
        # Sources in other threads take from these, too: each method of a deque is one step for them.
        self.spare: dict[tuple[bytes, int], deque[Synthesis]] = {}
        """By the instructions that are used and the number of independent sources."""
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
            if len(self._rising) < 2 * self.polyphase.phases:
                self._rising[start, phase] = found
        return found

    def _stack(self, weight: Weight) -> Array:
        return np.stack([weight.value, 2.0 * weight.rate, weight.curvature][: self.lines.n_terms])

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
        self.layer, self.factor = layer, np.ascontiguousarray(factor)
        self.tables = _make_tables(layer.key, layer.rate, layer.period, layer.numbers.tobytes(), rise_time)
        # Of the layer, not of the shape: a source that is reset need not fetch its memory from the system again.
        instructions = library.find_arithmetic().instructions
        self._spare = self.tables.spare.setdefault((instructions, factor.shape[1]), deque(maxlen=1))
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
            return make_synthesis(self.tables.lines, self.factor.shape[1])

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
        return self.shape.n_parts + (tables.polyphase.phases if tables.is_rising(self.start) else 0)

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
