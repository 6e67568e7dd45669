"""Stepping a slave: communication points, maps, tables, events."""

from __future__ import annotations

from collections.abc import Callable
from math import inf, isfinite

import numpy as np
from pythonfmu.enums import Fmi2Status

from .buffer import Array, aligned
from .guard import ModelError, Refused, describe, escape, report
from .state import Clock, Phase
from .values import Values

SAME_STEP = 1e-6  # relative: step sizes this close are one; hosts form them as differences of times
SAME_TIME = 1e-3  # of a step: hosts add up times with rounding
_MOST_MAPS = 8  # step sizes remembered: enough for hosts that alternate a few
_FIRST_ROWS = 16  # of the first table after a change of step: hosts with a new step each time pay little


class Stepper(Values):
    """Makes steps: a fast path for the plain ones, and all else by :meth:`_careful_step`.

    The fast path is open as long as the host goes on at the expected time with the same step size and nothing is due;
    ``_step_slack`` is negative when it is closed.

    Times are counted in integers (``origin + count * step``) wherever the model sees them, so that they do not
    collect rounding; the host's own times are only compared with each other.
    """

    def _allocate(self) -> None:
        super()._allocate()
        layout = self.layout
        self._source = self._buffer.data[layout.source]
        self._target = self._buffer.data[layout.target]
        self._work = aligned(self._target.size)
        self._kept = np.empty_like(self._buffer.data)
        # A closure, since its names cost least to look up.  False: not finite, or no row left; nothing is changed.
        self._plain_step: Callable[[], bool] | None = None
        self._next_step: Callable[[], bool] = self._due_step
        self._maps: list[tuple[float, Array]] = []
        self._table = np.empty((0, self.y.size))
        self._block = 0  # count at the start of the table
        self._next_rows = _FIRST_ROWS
        self._ready = False  # setup_experiment was called
        self._pending = False  # event() is due
        self._start, self._stop = 0.0, inf
        self._time = self._origin = self._step = 0.0
        self._count = 0
        self._time_slack = 0.0
        self._last_start = 0.0
        self._close()

    # --- For models ---------------------------------------------------------------------

    def remap(self) -> None:
        """The map is out of date (new pose, new parameter): ask ``step_map`` again before the next step."""
        self._maps.clear()
        self._plain_step = None
        self._next_step = self._due_step

    def discard_rows(self) -> None:
        """The rest of the table is out of date: ask ``rows`` again before the next step."""
        self._table = self._table[:0]
        self._block = self._count
        self._next_rows = _FIRST_ROWS
        self._plain_step = None
        self._next_step = self._due_step

    def request_event(self) -> None:
        """Have ``event`` called before the next step; for ``configure`` of models that start in motion."""
        self._pending = True
        self._next_step = self._due_step

    @property
    def step_size(self) -> float:
        """Size of the present step, s; for ``finish_step``."""
        return self._step

    @property
    def start_time(self) -> float:
        """Start time of the experiment, s."""
        return self._start

    def times(self, t: float, h: float, n: int) -> Array:
        """Times of the rows of ``rows(t, h, n)``, shape (n,), s: the same for a row in whichever table."""
        first = round((t - self._origin) / h)
        return np.asarray(self._origin + np.arange(first + 1.0, first + n + 1.0) * h)

    # --- For hosts ----------------------------------------------------------------------

    def do_step(self, current_time: float, step_size: float) -> bool:
        """One step; False (fmi2Discard) if it was refused: then nothing has changed, and the log says why.

        Any other exception is a fault of the model (fmi2Error); nothing has changed then either.
        """
        try:
            if (
                abs(current_time - self._time) <= self._time_slack
                and abs(step_size - self._step) <= self._step_slack
                and current_time <= self._last_start
                and self._next_step()
            ):
                self._time = current_time + step_size
                self._count += 1
            else:
                self._careful_step(current_time, step_size)
            return True
        except (ModelError, Refused) as error:
            self._refuse_step(error)
            return False
        except BaseException as error:
            escape(self, error)
            raise

    # --- Behind it ----------------------------------------------------------------------

    def _close(self) -> None:
        """Close the fast path: the next step is a careful one."""
        self._step_slack = -1.0

    def _not_finite(self) -> str:
        """The outputs and states that are not finite after a map, and how large what they come from is."""
        bad = np.flatnonzero(~np.isfinite(self._work)).tolist()
        names = [self.layout.describe(place) for place in bad[:5]]
        more = " ..." if len(bad) > 5 else ""
        return f"{', '.join(names)}{more}; largest operand {np.abs(self._source).max():g}"

    def _refuse_step(self, error: Exception) -> None:
        text = f"{self.label}: step from t = {self._time:.9g} s refused: {describe(error)}"
        self.log(report(text), Fmi2Status.error)

    def _careful_step(self, t: float, h: float) -> None:
        """A step that checks all.  All or nothing."""
        self._check_step(t, h)
        clock, table = self._clock(), self._table
        try:
            if not (abs(h - self._step) <= SAME_STEP * self._step and self._is_on_grid(t)):
                self._restart_count(t, h)
            self._full_step()
        except BaseException:
            self._recall(clock, table)
            raise
        self._time = t + h
        self._count += 1
        self._time_slack = SAME_TIME * self._step
        self._last_start = self._stop - (1.0 - SAME_TIME) * self._step
        self._step_slack = SAME_STEP * self._step

    def _due_step(self) -> bool:
        """A step before which something is due.  False: the host has drifted off the grid; nothing is changed."""
        return self._is_on_grid(self._time) and self._full_step()

    def _full_step(self) -> bool:
        """A step with all that is due before it: an event, a new map, a new table.  All or nothing.

        A slew has an event in every step, so this is quick, too: 1 us more than a plain step; a careful one 2.5 us.
        """
        data, kept = self._buffer.data, self._kept
        kept[:] = data
        due, table, block = self._pending, self._table, self._block
        try:
            if due:
                self._pending = False
                again = self.event(self._now(), self._step)
                self._pending = self._pending or bool(again)
            if self._plain_step is None or self._is_used_up():
                self._plain_step = self._new_plain_step()
            if not self._plain_step():
                raise Refused(f"the step leads to numbers that are not finite: {self._not_finite()}")
        except BaseException:
            data[:] = kept
            if due:
                self._rebuild()
            self._pending = due
            self._put_table(table, block)
            raise
        self._next_step = self._due_step if self._pending else self._plain_step
        return True

    def _now(self) -> float:
        """Present time on the grid of whole steps, s."""
        return self._origin + self._count * self._step

    def _rebuild(self) -> None:
        """After a failure: the buffer is as before, but what the model derives may be half new."""
        try:
            self._derive()
        except Exception as error:
            report(f"{self.label}: restore() failed as well, after the failure reported next", error)

    def _check_step(self, t: float, h: float) -> None:
        if self._phase != Phase.STEPPING:
            raise Refused(f"no step is possible in phase {self._phase.name.lower()}")
        if not (isfinite(h) and h > 0.0):
            raise Refused(f"step size {h!r} s: expected a finite number above 0")
        if not abs(t - self._time) <= SAME_TIME * h:
            raise Refused(f"current time {t!r} s: expected {self._time!r} s, where the last step ended")
        if t > self._stop - (1.0 - SAME_TIME) * h:
            raise Refused(f"a step from {t!r} s to {t + h!r} s ends beyond the stop time {self._stop!r} s")

    def _is_on_grid(self, t: float) -> bool:
        return abs(self._now() - t) <= SAME_TIME * self._step

    def _restart_count(self, t: float, h: float) -> None:
        known = [step for step, _ in self._maps if abs(step - h) <= SAME_STEP * step]
        self._origin, self._count, self._step = t, 0, known[0] if known else h
        self.discard_rows()

    def _is_used_up(self) -> bool:
        return self.block_rows > 0 and self._count - self._block >= len(self._table)

    def _new_plain_step(self) -> Callable[[], bool]:
        if self.block_rows > 0:
            if self._is_used_up():
                self._fill_table()
            return self._step_by_row()
        step = self._step_by_map(self._map_for(self._step))
        return self._with_finish(step) if self.finishing else step

    def _step_by_map(self, matrix: Array) -> Callable[[], bool]:
        """One product into ``work``, and one copy if it is finite: all or nothing."""
        advance, square, source, work = matrix.dot, self._work.dot, self._source, self._work
        result, target = work.data, self._target.data  # memory views: a third of the time of a copy by numpy

        def step() -> bool:
            advance(source, work)
            if isfinite(square(work)) or np.isfinite(work).all():  # the square overflows above 1e154
                target[:] = result
                return True
            return False

        return step

    def _with_finish(self, step: Callable[[], bool]) -> Callable[[], bool]:
        data, target = self._buffer.data, self._target
        kept = np.empty_like(data)

        def finished() -> bool:
            kept[:] = data
            try:
                if not step():
                    return False
                self.finish_step()
                if not np.isfinite(target).all():
                    raise Refused("finish_step() leads to numbers that are not finite")
            except BaseException:
                data[:] = kept
                raise
            return True

        return finished

    def _step_by_row(self) -> Callable[[], bool]:
        y, rows = self.y, iter(self._table[self._count - self._block :])

        def step() -> bool:
            row = next(rows, None)
            if row is None:
                return False
            y[:] = row
            return True

        return step

    def _map_for(self, h: float) -> Array:
        for step, matrix in self._maps:
            if step == h:
                return matrix
        matrix = self._checked_matrix("step_map", self.step_map(h), self._target.size)
        if len(self._maps) >= _MOST_MAPS:
            del self._maps[0]
        self._maps.append((h, matrix))
        return matrix

    def _checked_matrix(self, what: str, matrix: Array, rows: int) -> Array:
        """An aligned copy, C-contiguous as numpy's fastest product wants it."""
        shape = (rows, self._source.size)
        given = np.asarray(matrix, dtype=np.float64)
        if given.shape != shape:
            raise ValueError(f"{type(self).__name__}.{what} has shape {given.shape}; expected {shape}")
        if not np.isfinite(given).all():
            raise ValueError(f"{type(self).__name__}.{what} has elements that are not finite")
        copy = aligned(*shape)
        copy[:] = given
        return copy

    def _fill_table(self) -> None:
        n = min(self._next_rows, self.block_rows)
        self._table = self._checked_rows(n)
        self._block = self._count
        self._next_rows = min(4 * n, self.block_rows)

    def _checked_rows(self, n: int) -> Array:
        table = np.ascontiguousarray(self.rows(self._now(), self._step, n), dtype=np.float64)
        if table.shape != (n, self.y.size):
            expected = (n, self.y.size)
            raise ValueError(f"{type(self).__name__}.rows has shape {table.shape}; expected {expected}")
        if not np.isfinite(table).all():
            raise ValueError(f"{type(self).__name__}.rows has elements that are not finite")
        return table

    def _derive(self) -> None:
        """Have the model derive everything from the buffer, which stays as it is."""
        self.remap()
        self.discard_rows()
        kept = self._buffer.data.copy()
        try:
            self.restore()
        finally:
            self._buffer.data[:] = kept

    # --- State --------------------------------------------------------------------------

    def _clock(self) -> Clock:
        return Clock(
            phase=self._phase, ready=self._ready, stale=self._stale, pending=self._pending,
            count=self._count, rows=len(self._table), block=self._block,
            start=self._start, stop=self._stop, time=self._time, origin=self._origin, step=self._step,
        )  # fmt: skip

    def _recall(self, clock: Clock, table: Array) -> None:
        """Go back to an earlier clock; ``table`` is the one that belongs to it."""
        self._phase = clock.phase
        self._ready, self._stale, self._pending = clock.ready, clock.stale, clock.pending
        self._count = clock.count
        self._start, self._stop, self._time = clock.start, clock.stop, clock.time
        self._origin, self._step = clock.origin, clock.step
        self._put_table(table, clock.block)
        self._close()

    def _put_table(self, table: Array, block: int) -> None:
        """Go on with a table that begins at count ``block``."""
        self._table, self._block = table, block
        self._next_rows = min(4 * len(table), self.block_rows) if len(table) else _FIRST_ROWS
        self._plain_step = None
        self._next_step = self._due_step

    def _table_again(self, clock: Clock) -> Array:
        """The table that was current at ``clock``, computed from the buffer as it is now."""
        if clock.rows == 0:
            return self._table[:0]
        self._origin, self._count, self._step = clock.origin, clock.block, clock.step
        return self._checked_rows(clock.rows)
