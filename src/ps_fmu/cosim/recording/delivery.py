"""Hand complete rows to the observers, and stop at values that are not finite."""

from __future__ import annotations

import math
import sys
import time as wall_clock
from collections.abc import Callable, Iterator, Sequence
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from ..clock import StepClock
from ..errors import SlaveError
from ..rows import Array, Column, Rows

EARLY_S = 1.0
"""Rows of an unfinished block are stored, too, when no block has come for so long [s]."""


class Observer(Protocol):
    """An object that takes the rows of a run, block by block."""

    def block(self, first_index: int, time: Array, values: Array) -> None:
        """Take the next rows: ``time`` (rows,) [s] and ``values`` (rows, columns).

        ``first_index`` counts rows from 0, the state after initialisation.  The arrays are valid during this call only:
        copy the values that you keep.
        """


@runtime_checkable
class EarlyObserver(Observer, Protocol):
    """One that stores rows, and takes those of an unfinished block when a whole one is long in coming."""

    def early(self, first_index: int, time: Array, values: Array) -> None:
        """Take rows, as in :meth:`Observer.block`, that are repeated in the next block or were taken before.

        There may be none: what is pending is to be stored all the same.
        """


@runtime_checkable
class LimitObserver(Observer, Protocol):
    """One that gets only blocks in which a value is beyond a limit: the largest magnitude is known anyway."""

    @property
    def ignored_magnitude(self) -> float:
        """Up to which values need not be looked at, in any unit."""


class Delivery:
    """Gives the rows of a run to the observers, each block when it is complete.

    Parameters
    ----------
    count_rows: how many rows of the block are complete, at any time, also while steps are run.
    """

    def __init__(
        self,
        rows: Rows,
        clock: StepClock,
        columns: Sequence[Column],
        observers: Sequence[Observer],
        count_rows: Callable[[], int],
    ) -> None:
        self.rows, self._clock, self._count_rows = rows, clock, count_rows
        self._columns = columns
        self._observers = [(one, _get_limit(one)) for one in observers]
        self._storing = [one for one in observers if isinstance(one, EarlyObserver)]
        self._last = wall_clock.perf_counter()

    def hand_over(self) -> None:
        """Give away the complete rows; a new block begins.  Raises what an observer raises, or :class:`SlaveError`."""
        self._last = wall_clock.perf_counter()
        if failure := self._serve_rows():
            raise failure

    def hand_over_early(self) -> None:
        """Give the rows of the block to those who store them, if the last block is long ago: FMUs are slow, or hang."""
        if not self._storing or wall_clock.perf_counter() - self._last < EARLY_S:
            return
        first, values = self.rows.first_index, self.rows.copy(self.rows.filled)
        values = values[: count_finite(values)]
        for observer in self._storing:
            observer.early(first, self._clock.times(first, len(values)), values)
        self._last = wall_clock.perf_counter()

    def conclude(self, error: BaseException) -> None:
        """Give away the complete rows and raise: ``error``, the reason why the run ends early, or a stronger one."""
        raise self._serve_rows(error) or error

    def store(self) -> None:
        """Give away the rows that are complete, also while steps are run, and have all be stored: the process ends."""
        self.rows.filled = self._count_rows()
        self._serve_rows()
        end = self.rows.first_index
        for observer in self._storing:
            observer.early(end, np.empty(0), np.empty((0, len(self._columns))))
        if self._storing:
            print(f"the rows up to t = {self._clock.time(end - 1):.9g} s are stored", file=sys.stderr, flush=True)

    def _serve_rows(self, error: BaseException | None = None) -> BaseException | None:
        """Give the complete rows to all observers, up to the first with a value that is not finite; begin a new block.

        Every observer is served even if another one fails.  Returns the first that applies: :class:`SlaveError` for a
        value that is not finite, with ``error`` as its consequence; ``error``, the reason why the run ends; what an
        observer raised; None.
        """
        first, (values, peak) = self.rows.first_index, self.rows.complete()
        self.rows.next_block()
        time = self._clock.times(first, len(values))
        usable = len(values) if math.isfinite(peak) else count_finite(values)
        failure: BaseException | None = error
        if usable < len(values):
            failure = _make_error(self._columns, values[usable], float(time[usable]))
            failure.__cause__ = error
        for observer, limit in self._observers if usable else ():
            if peak <= limit:
                continue
            try:
                observer.block(first, time[:usable], values[:usable])
            except BaseException as raised:
                raised.add_note(f"Raised by the observer {name_observer(observer)}.")
                if failure is None:
                    failure = raised
                else:
                    failure.add_note(f"The observer {name_observer(observer)} failed, too: {raised}")
        return failure


def count_finite(values: Array) -> int:
    """Rows before the first with a value that is not finite."""
    finite = np.isfinite(values)
    return len(values) if finite.all() else int(np.argmin(finite.all(axis=1)))


def _get_limit(observer: Observer) -> float:
    return observer.ignored_magnitude if isinstance(observer, LimitObserver) else -math.inf


def name_observer(observer: Observer) -> str:
    """What messages call it: its class, or what it says itself."""
    return str(getattr(observer, "observer_name", type(observer).__name__))


def _make_error(columns: Sequence[Column], row: Array, time: float) -> SlaveError:
    wrong = [column for column, value in zip(columns, row, strict=True) if not np.isfinite(value)]
    bad = [column.name for column in wrong]
    named = ", ".join(bad[:5]) + (f" and {len(bad) - 5} more" if len(bad) > 5 else "")
    component = wrong[0].component or bad[0].partition(".")[0]
    return SlaveError(
        f"{component}: not a finite number at t = {time:.9g} s: {named}; the rows before are kept",
        component=component,
        function="fmi2GetReal",
        time=time,
        variables=bad,
    )


# --- Rows of a netCDF variable that has one dimension -----------------------------------------------------------------
#
# ``variable[first:last]`` asks for the length of the time dimension, which netCDF finds by looking at every variable of
# the group: with 95 of them that takes 45 us of 60 us.  The methods that netCDF4 itself calls next do without.  It does
# not document them; where there are none, the documented way serves.
#
# Whoever opens, reads, writes or closes a dataset holds :data:`...reduction.columns.NETCDF_LOCK`.

BLOCK_ROWS = 10_000
"""About so many rows are read at once; each time costs some 40 us for each column."""
MOST_BLOCK_ROWS = 1_000_000
"""However long the chunks of a file are, which another program may have written."""


def read_chunk_rows(variable: Any) -> int:
    """Rows of a chunk of a variable in its file; 1 if it is stored in one piece."""
    chunks = variable.chunking()
    return int(chunks[0]) if isinstance(chunks, list) else 1


def iterate_blocks(rows: int, chunk: int, about: int = BLOCK_ROWS) -> Iterator[tuple[int, int]]:
    """First row of each block of so many rows, and the one behind its last.

    A block has whole chunks of the file, so that none is read twice: as many as ``about`` rows hold, at least one.
    """
    size = min(chunk * max(1, about // chunk), MOST_BLOCK_ROWS)
    for first in range(0, rows, size):
        yield first, min(first + size, rows)


def write_rows(variable: Any, first: int, values: NDArray[Any]) -> None:
    """Write ``values`` (n,) from row ``first`` on; they become of the variable's type."""
    values = np.ascontiguousarray(values, dtype=variable.dtype)
    put = getattr(variable, "_put", None)
    if put is None:
        variable[first : first + len(values)] = values
    elif len(values):
        put(values, [first], [len(values)], [1])


def read_rows(variable: Any, first: int, last: int) -> NDArray[Any]:
    """Rows from ``first`` up to ``last``, which is left out; there are so many."""
    get = getattr(variable, "_get", None)
    if get is None or first >= last:
        return np.asarray(variable[first:last])
    return np.asarray(get([first], [last - first], [1]))
