"""Stepping a slave: communication points, maps, tables, events."""

from __future__ import annotations

import weakref
from math import inf, isfinite

import numpy as np

from .buffer import Array, allocate_aligned
from .core import OutputLimits, store_by_columns
from .far import blame
from .guard import ModelError, Refused, escape, report
from .plain import Step, make_holder, make_plain_step
from .state import LifePhase, SlaveClock
from .values import Values

SAME_STEP = 1e-6  # relative: step sizes this close are one; hosts form them as differences of times
SAME_TIME = 1e-3  # of a step: hosts add up times with rounding
_MOST_MAPS = 8  # step sizes remembered: enough for hosts that alternate a few
_FIRST_ROWS = 16  # of the first table after a change of step: hosts with a new step each time pay little


class Stepper(Values):
    """Makes steps: plain ones by :func:`.plain_step`, and all else by :meth:`_step_carefully`.

    A step is a plain one as long as the host goes on at the expected time with the same step size and nothing is due.
    The launcher makes those by itself, from the words in ``_core``; where there is none, and before ``finish_step``,
    :meth:`do_step` does, by the same rule.

    Times are counted in integers (``origin + count * step``) wherever the model sees them, so that they do not
    collect rounding; the host's own times are only compared with each other.
    """

    def _allocate(self) -> None:
        super()._allocate()
        layout = self.layout
        self._source = self._buffer.data[layout.source]
        self._target = self._buffer.data[layout.target]
        self._kept = np.empty_like(self._buffer.data)
        self._plain_step: Step | None = None  # None: out of date
        self._maps: list[tuple[float, Array]] = []  # by columns
        self._table = np.empty((0, self.y.size))
        self._next_rows = _FIRST_ROWS
        self._ready = False  # setup_experiment was called
        self._start, self._stop = 0.0, inf
        self._origin = 0.0

    # --- For models ---------------------------------------------------------------------

    def remap(self) -> None:
        """The map is out of date (new pose, new parameter): ask ``step_map`` again before the next step."""
        self._maps.clear()
        self._renew()

    def discard_rows(self) -> None:
        """The rest of the table is out of date: ask ``rows`` again before the next step."""
        self._table = self._table[:0]
        self._core.block = self._core.count
        self._next_rows = _FIRST_ROWS
        self._renew()

    def request_event(self) -> None:
        """Have ``event`` called before the next step; for ``configure`` of models that start in motion."""
        self._core.pending = True

    @property
    def step_size(self) -> float:
        """Size of the present step, s; for ``finish_step``."""
        return self._core.step

    @property
    def time(self) -> float:
        """Where the next step starts, as the host counts, s."""
        return self._core.time

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
        """One step; True, as the library wants it.  If it raises, nothing has changed.

        A refused step raises, too, and so is fmi2Error: it "could not be carried out at all" (FMI 2.0.4, 4.2.2), or
        would end past the stop time (2.1.6).  False would be fmi2Discard, for a step that was done in part.  Upon that
        FMPy 0.3.32 asks for the same step for ever, or with fmi2Terminated returns what it has without a word; libcosim
        (libcosimpy 0.0.6) leaves out the reason.
        """
        core, step = self._core, self._plain_step
        try:
            if (
                abs(current_time - core.time) <= core.time_slack
                and abs(step_size - core.step) <= core.step_slack
                and current_time <= core.last_start
                and (self._step_if_due() if step is None or core.pending else step())
            ):
                core.time = current_time + step_size
                core.count += 1
            else:
                self._step_carefully(current_time, step_size)
            core.python_steps += 1
            return True
        except BaseException as error:
            if isinstance(error, (ModelError, Refused)):
                error.args = (f"step from t = {core.time:.9g} s refused: {error}",)
            escape(self, error)
            raise

    # --- Behind it ----------------------------------------------------------------------

    def _enter(self, phase: LifePhase) -> None:
        """Another phase, or another time: the next step is a careful one."""
        self._phase = phase
        self._core.stepping = phase == LifePhase.STEPPING
        self._core.step_slack = -1.0
        self._forget_lists()

    def _renew(self) -> None:
        """The plain step is out of date: the next step makes a new one."""
        self._plain_step = None
        self._core.use_nothing()

    def _describe_not_finite(self) -> str:
        """The outputs and states that are not finite after a map, and how large what they come from is."""
        bad = np.flatnonzero(~np.isfinite(self._core.arrays["work"])).tolist()
        names = [self.layout.describe(place) for place in bad[:5]]
        more = " ..." if len(bad) > 5 else ""
        return f"{', '.join(names)}{more}; largest operand {np.abs(self._source).max():g}"

    def _step_carefully(self, t: float, h: float) -> None:
        """A step that checks all.  All or nothing."""
        self._check_step(t, h)
        core, clock, table = self._core, self._read_clock(), self._table
        try:
            if not (abs(h - core.step) <= SAME_STEP * core.step and self._is_on_grid(t)):
                self._restart_count(t, h)
            self._step_fully()
        except BaseException:
            self._recall(clock, table)
            raise
        core.time = t + h
        core.count += 1
        core.time_slack = SAME_TIME * core.step
        core.last_start = self._stop - (1.0 - SAME_TIME) * core.step
        core.step_slack = SAME_STEP * core.step

    def _step_if_due(self) -> bool:
        """A step before which something is due.  False: the host has drifted off the grid; nothing is changed."""
        return self._is_on_grid(self._core.time) and self._step_fully()

    def _step_fully(self) -> bool:
        """A step with all that is due before it: an event, a new map, a new table.  All or nothing.

        Some models have an event in every step, so this is quick, too: 1.5 us less than a careful step.
        """
        core, data, kept = self._core, self._buffer.data, self._kept
        kept[:] = data
        due, table, block = core.pending, self._table, core.block
        try:
            if due:
                core.pending = False
                again = self.event(self._get_time(), core.step)
                core.pending = core.pending or bool(again)
            if self._plain_step is None or self._is_used_up():
                self._plain_step = self._make_plain_step()
            if not self._plain_step():
                raise Refused(f"the step leads to numbers that are not finite: {self._describe_not_finite()}")
        except BaseException as error:
            data[:] = kept
            if due:
                self._rebuild()
            core.pending = due
            self._put_table(table, block)
            blame(error, self.layout, kept, core.step, self.default_step)
            raise
        return True

    def _get_time(self) -> float:
        """Present time on the grid of whole steps, s."""
        return self._origin + self._core.count * self._core.step

    def _rebuild(self) -> None:
        """After a failure: the buffer is as before, but what the model derives may be half new."""
        try:
            self._derive()
        except Exception as error:
            report(f"{self.label}: restore() failed as well, after the failure reported next", error)

    def _check_step(self, t: float, h: float) -> None:
        if self._phase != LifePhase.STEPPING:
            raise Refused(f"no step is possible in phase {self._phase.name.lower()}")
        if not (isfinite(h) and h > 0.0):
            raise Refused(f"step size {h!r} s: expected a finite number above 0")
        if not abs(t - self._core.time) <= SAME_TIME * h:
            raise Refused(f"current time {t!r} s: expected {self._core.time!r} s, where the last step ended")
        if not t < t + h < inf:
            raise Refused(f"step size {h!r} s: expected one that leads from {t!r} s to a later time")
        if t > self._stop - (1.0 - SAME_TIME) * h:
            raise Refused(f"a step from {t!r} s to {t + h!r} s ends beyond the stop time {self._stop!r} s")

    def _is_on_grid(self, t: float) -> bool:
        return abs(self._get_time() - t) <= SAME_TIME * self._core.step

    def _restart_count(self, t: float, h: float) -> None:
        known = [step for step, _ in self._maps if abs(step - h) <= SAME_STEP * step]
        self._origin = t
        self._core.count, self._core.step = 0, known[0] if known else h
        self.discard_rows()

    def _is_used_up(self) -> bool:
        return self.block_rows > 0 and self._core.count - self._core.block >= len(self._table)

    def _make_plain_step(self) -> Step:
        core = self._core
        if self.block_rows > 0:
            if self._is_used_up():
                self._fill_table()
            core.use_table(self._table)
        else:
            core.use_map(self._find_map(core.step))
        limits = self._compute_limits()
        core.finishing = self.finishing
        if not self.finishing:
            core.use_limits(limits)
            return make_plain_step(core)
        core.use_limits(None)
        return self._add_finish(make_plain_step(core), limits)

    def _add_finish(self, step: Step, limits: OutputLimits | None) -> Step:
        data, target, y = self._buffer.data, self._target, self.y
        kept = np.empty_like(data)
        hold = None if limits is None else make_holder(limits)
        model = weakref.proxy(self)  # it keeps this function: a cycle would stay, with all buffers, until collected

        def finished() -> bool:
            kept[:] = data
            try:
                if not step():
                    return False
                model.finish_step()
                if not np.isfinite(target).all():
                    raise Refused("finish_step() leads to numbers that are not finite")
            except BaseException:
                data[:] = kept
                raise
            if hold is not None:
                hold(y)
            return True

        return finished

    def _find_map(self, h: float) -> Array:
        for step, matrix in self._maps:
            if step == h:
                return matrix
        matrix = store_by_columns(self._check_matrix("step_map", self.step_map(h), self._target.size))
        if len(self._maps) >= _MOST_MAPS:
            del self._maps[0]
        self._maps.append((h, matrix))
        return matrix

    def _check_matrix(self, what: str, matrix: Array, rows: int) -> Array:
        """An aligned copy, C-contiguous as numpy's fastest product wants it."""
        shape = (rows, self._source.size)
        given = np.asarray(matrix, dtype=np.float64)
        if given.shape != shape:
            raise ValueError(f"{type(self).__name__}.{what} has shape {given.shape}; expected {shape}")
        if not np.isfinite(given).all():
            raise ModelError(f"{type(self).__name__}.{what} has elements that are not finite")
        copy = allocate_aligned(*shape)
        copy[:] = given
        return copy

    def _fill_table(self) -> None:
        n = min(self._next_rows, self.block_rows)
        self._table = self._compute_rows(n)
        self._core.block = self._core.count
        self._next_rows = min(4 * n, self.block_rows)

    def _compute_rows(self, n: int) -> Array:
        table = np.ascontiguousarray(self.rows(self._get_time(), self._core.step, n), dtype=np.float64)
        if table.shape != (n, self.y.size):
            expected = (n, self.y.size)
            raise ValueError(f"{type(self).__name__}.rows has shape {table.shape}; expected {expected}")
        if not np.isfinite(table).all():
            raise ModelError(f"{type(self).__name__}.rows has elements that are not finite")
        return table

    def _compute_limits(self) -> OutputLimits | None:
        limits = self.limits()
        if limits is None:
            return None
        lower, upper = (np.array(limit, dtype=np.float64) for limit in limits)
        if not (lower.shape == upper.shape == self.y.shape and (lower <= upper).all()):
            raise ValueError(f"{type(self).__name__}.limits: expected two arrays ({self.y.size},), lower <= upper")
        return OutputLimits(lower, upper, self.layout.reference.get(self.limit_flag, -1))

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

    def _read_clock(self) -> SlaveClock:
        core = self._core
        return SlaveClock(
            phase=self._phase, ready=self._ready, stale=self._stale, pending=bool(core.pending),
            count=core.count, rows=len(self._table), block=core.block,
            start=self._start, stop=self._stop, time=core.time, origin=self._origin, step=core.step,
        )  # fmt: skip

    def _recall(self, clock: SlaveClock, table: Array) -> None:
        """Go back to an earlier clock; ``table`` is the one that belongs to it."""
        core = self._core
        self._ready, self._stale, core.pending = clock.ready, clock.stale, clock.pending
        self._start, self._stop, self._origin = clock.start, clock.stop, clock.origin
        core.count, core.time, core.step = clock.count, clock.time, clock.step
        self._put_table(table, clock.block)
        self._enter(clock.phase)

    def _put_table(self, table: Array, block: int) -> None:
        """Go on with a table that begins at count ``block``."""
        self._table, self._core.block = table, block
        self._next_rows = min(4 * len(table), self.block_rows) if len(table) else _FIRST_ROWS
        self._renew()

    def _compute_table_again(self, clock: SlaveClock) -> Array:
        """The table that was current at ``clock``, computed from the buffer as it is now."""
        if clock.rows == 0:
            return self._table[:0]
        self._origin = clock.origin
        self._core.count, self._core.step = clock.block, clock.step
        return self._compute_rows(clock.rows)
