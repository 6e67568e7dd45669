"""Tables of rows, for models whose outputs, or some inputs of whose map, are functions of time."""

from __future__ import annotations

import weakref
from abc import abstractmethod
from collections.abc import Generator
from inspect import isgeneratorfunction
from typing import Any

import numpy as np

from .ahead import RowParts, TableAhead, finish
from .buffer import Array
from .guard import ModelError
from .state import SlaveClock
from .values import Values

_CHUNK = 256  # rows asked for at a time
_FIRST_ROWS = 16  # of the first table after a change of step: hosts with a new step each time pay little


class Tables(Values):
    """The table that steps take their rows from, and the one after it."""

    def _allocate(self) -> None:
        super()._allocate()
        self._table = np.empty((0, self.r.size or self.y.size))
        self._next_rows = _FIRST_ROWS
        self._ahead = TableAhead()

    # --- For models ---------------------------------------------------------------------

    def discard_rows(self) -> None:
        """The rest of the table is out of date: ask ``rows`` again before the next step."""
        self._table = self._table[:0]
        self._ahead.drop()
        self._core.block = self._core.count
        self._next_rows = _FIRST_ROWS
        self._renew()

    def times(self, t: float, h: float, n: int) -> Array:
        """Times of the rows of ``rows(t, h, n)``, shape (n,), s: the same for a row in whichever table."""
        first = round((t - self._core.origin) / h)
        return np.asarray(self._core.origin + np.arange(first + 1.0, first + n + 1.0) * h)

    # --- Behind it ----------------------------------------------------------------------

    @abstractmethod
    def _renew(self) -> None:
        """The plain step is out of date: the next step makes a new one."""

    def _get_time(self) -> float:
        """Present time on the grid of whole steps, s."""
        return self._core.origin + self._core.count * self._core.step

    def _is_used_up(self) -> bool:
        return self.block_rows > 0 and self._core.count - self._core.block >= len(self._table)

    def _is_at_end_of_rows(self) -> bool:
        """Whether the table has no row for the next step, or a part of the next table is to be made before it."""
        core = self._core
        return core.count - core.block >= core.n_rows

    def _limit_rows(self, n: int, h: float) -> int:
        """Rows of a table for steps of h (s), where ``n`` are wanted."""
        return max(1, min(n, self.block_rows, self.most_rows(h)))

    def _fill_table(self) -> None:
        core = self._core
        n = self._limit_rows(self._next_rows, core.step)
        made = self._ahead.take((self._core.origin, core.count, core.step, n))
        self._table = self._compute_rows(n) if made is None else made
        core.block = core.count
        self._next_rows = self._limit_rows(4 * n, core.step)
        if isgeneratorfunction(type(self).rows) or self._next_rows > _CHUNK:
            first = core.count + n
            me: Any = weakref.proxy(self)
            start = core.origin + first * core.step
            parts = type(self)._compute_rows_in_parts(me, start, core.step, self._next_rows)
            self._ahead.begin((core.origin, first, core.step, self._next_rows), parts)
        self._work_ahead()

    def _work_ahead(self) -> None:
        """Do a part of the work for the next table; the parts are spread evenly over the rows of this one."""
        core, rows = self._core, len(self._table)
        row = core.count - core.block
        parts = self._ahead.advance()
        core.n_rows = row + max(1, (rows - row) // (parts + 1)) if parts else rows

    def _compute_rows(self, n: int) -> Array:
        rows = finish(self._compute_rows_in_parts(self._get_time(), self._core.step, n))
        self._check_finite_rows(rows)
        return rows

    def _compute_rows_in_parts(self, t: float, h: float, n: int) -> RowParts:
        """Rows of a table; where the model makes them at once, so many in a part that it takes little time.

        ``self`` is a weak proxy for work ahead: the slave keeps this generator, and would else be in a cycle with it.
        """
        make_rows = self.__class__.rows  # type() of a proxy is another class
        if isgeneratorfunction(make_rows):
            rows = make_rows(self, t, h, n)
            assert isinstance(rows, Generator)
            made = yield from rows  # in a line of its own: a method of the slave would wait with it, and keep the slave
            return self._check_shape(made, n)
        chunks = []
        for first in range(0, n, _CHUNK):
            if n > _CHUNK:
                yield -(-(n - first) // _CHUNK)
            size = min(_CHUNK, n - first)
            chunks.append(self._check_shape(finish(self.rows(t + first * h, h, size)), size))
        return chunks[0] if len(chunks) == 1 else np.concatenate(chunks)

    def _check_shape(self, rows: Array, n: int) -> Array:
        table = np.ascontiguousarray(rows, dtype=np.float64)
        expected = (n, self._table.shape[1])
        if table.shape != expected:
            raise ValueError(f"{type(self).__name__}.rows is of shape {table.shape}; expected {expected}")
        return table

    def _check_row(self) -> None:
        """Raise ModelError if it is the row that a step was refused for: of tables made ahead, steps look at each."""
        row = self._core.count - self._core.block
        if self.block_rows and 0 <= row < len(self._table):
            self._check_finite_rows(self._table[row])

    def _check_finite_rows(self, rows: Array) -> None:
        if not np.isfinite(rows).all():
            raise ModelError(f"{type(self).__name__}.rows contains numbers that are not finite")

    def _put_table(self, table: Array, block: int) -> None:
        """Go on with a table that begins at count ``block``."""
        self._table, self._core.block = table, block
        if self.block_rows:
            self._core.n_rows = 0  # the next step looks at once how far the work ahead is
        self._next_rows = min(4 * len(table), self.block_rows) if len(table) else _FIRST_ROWS
        self._renew()

    def _compute_table_again(self, clock: SlaveClock) -> Array:
        """The table that was current at ``clock``, computed from the buffer as it is now."""
        if clock.rows == 0:
            return self._table[:0]
        self._core.origin = clock.origin
        self._core.count, self._core.step = clock.block, clock.step
        return self._compute_rows(clock.rows)
