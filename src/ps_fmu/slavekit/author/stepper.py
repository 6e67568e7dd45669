"""Stepping a slave: communication points, maps, events."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from math import inf, isfinite, ulp

import numpy as np

from .blocks import Matrices, make_blocks, store_by_columns
from .buffer import Array
from .continuous import hold_inputs
from .core import FOUND_DUE, MESSAGE_NONE, MESSAGE_REFUSAL, MESSAGE_WARNING, Elements, Map, OutputLimits, Step
from .elements import Element, StepMap, compile_elements, find_full_delay
from .far import blame
from .guard import ModelError, Refused, report
from .state import Derived, LifePhase, SlaveClock, SlaveState
from .values import Values

SAME_STEP = 1e-6  # relative: step sizes this close are one; hosts form them as differences of times
SAME_TIME = 1e-3  # of a step: hosts add up times with rounding
_ROUNDING = 4  # units in the last place of a time: more than 1e-3 of a step, if times are such as 1.4e9 s
_MOST_MAPS = 8  # step sizes remembered: enough for hosts that alternate a few


class Stepper(Values):
    """Makes steps: plain ones by :meth:`.Core.make_step`, and all else by :meth:`_step_carefully`.

    A step is a plain one as long as the host goes on at the expected time with the same step size and nothing is due.
    The launcher makes those by itself, from the words in ``_core``; where there is none, :meth:`do_step`
    does, by the same rule.

    Times are counted in integers (``origin + count * step``) wherever the model sees them, so that they do not
    collect rounding; the host's own times are only compared with each other.
    """

    def _allocate(self) -> None:
        super()._allocate()
        layout = self.layout
        self._source = self._core.source
        self._target = self._buffer.data[layout.target]
        self._kept = np.empty_like(self._buffer.data)
        self._plain_step: Step | None = None  # None: out of date
        self._maps: list[StepMap] = []
        self._compiled: tuple[tuple[Sequence[Element], ...], Elements] = ((), Elements())
        self._ready = False  # setup_experiment was called
        self._start = 0.0
        self._derived = object()  # another one whenever the model has derived anything from the buffer

    # --- For models ---------------------------------------------------------------------

    def remap(self) -> None:
        """The map is out of date (new pose, new parameter): ask ``step_map`` again before the next step."""
        self._maps.clear()
        self._core.linear_holds = False
        self._derived = object()
        self._renew()

    def request_event(self) -> None:
        """Have ``event`` called before the next step; for ``configure`` of models that start in motion."""
        self._core.pending = True

    @property
    def time(self) -> float:
        """Where the next step starts, as the host counts, s."""
        return self._core.time

    @property
    def start_time(self) -> float:
        """Start time of the experiment, s."""
        return self._start

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
            self._pass_warning()
            return True
        except (ModelError, Refused) as error:
            error.args = (f"step from t = {core.time:.9g} s refused: {error}",)
            raise

    # --- Behind it ----------------------------------------------------------------------

    def _get_time(self) -> float:
        """Present time on the grid of whole steps, s."""
        return self._core.origin + self._core.count * self._core.step

    def _enter(self, phase: LifePhase) -> None:
        """Another phase, or another time: the next step is a careful one."""
        self._phase = phase
        self._core.stepping = phase == LifePhase.STEPPING
        self._core.step_slack = -1.0

    def _renew(self) -> None:
        """The plain step is out of date: the next step makes a new one."""
        self._plain_step = None
        self._core.use_nothing()

    def _describe_not_finite(self) -> str:
        """The outputs and states that are not finite after a map, and how large what they come from is."""
        largest = f"largest operand {np.abs(self._source).max():g}"
        for found in self._core.maps:
            bad = np.flatnonzero(~np.isfinite(found.work)).tolist()
            if bad:
                names = [self.layout.describe(self._find_place(found.target) + place) for place in bad[:5]]
                more = " ..." if len(bad) > 5 else ""
                return f"{', '.join(names)}{more}; {largest}"
        return f"in an element before or after the map; {largest}"

    def _find_place(self, view: Array) -> int:
        """Where a view of the buffer begins in it."""
        return (view.ctypes.data - self._buffer.data.ctypes.data) // 8

    def _step_carefully(self, t: float, h: float) -> None:
        """A step that checks all.  All or nothing."""
        self._check_step(t, h)
        core, clock = self._core, self._read_clock()
        try:
            if not (abs(h - core.step) <= SAME_STEP * core.step and self._is_on_grid(t)):
                self._restart_count(t, h)
            self._step_fully()
        except BaseException:
            self._recall(clock)
            raise
        core.time = t + h
        core.count += 1
        core.time_slack = _compute_time_slack(t, core.step)
        core.last_start = self._core.stop - core.step + core.time_slack
        core.step_slack = SAME_STEP * core.step

    def _step_if_due(self) -> bool:
        """A step before which something is due.  False: the host has drifted off the grid; nothing is changed."""
        if not self._is_on_grid(self._core.time):
            return False
        return self._step_fully()

    def _step_fully(self) -> bool:
        """A step with all that is due before it: an event, a new map.  All or nothing.

        Some models have an event in every step, so this is quick, too: 1.5 us less than a careful step.
        """
        core, data, kept = self._core, self._buffer.data, self._kept
        kept[:] = data
        due = core.pending
        try:
            while not self._handle_event_and_step():
                if core.pending != FOUND_DUE:
                    if core.message_status == MESSAGE_REFUSAL:
                        raise Refused(self._read_message())
                    if full := find_full_delay(core.elements, kept, core.step):
                        raise Refused(full)
                    raise Refused(f"the step leads to numbers that are not finite: {self._describe_not_finite()}")
        except BaseException as error:
            data[:] = kept
            if due or not core.watching:
                self._rebuild()
            core.pending = due == 1  # an element will find it again
            self._renew()
            blame(error, self.layout, kept, core.step, self.default_step)
            raise
        finally:
            core.watching = 1
        return True

    def _read_message(self) -> str:
        """What an element has to say of the step."""
        return self._core.message.decode("utf-8", "replace")

    def _pass_warning(self) -> None:
        """Send the host the warning that an element has left."""
        if self._core.message_status == MESSAGE_WARNING:
            self._core.message_status = MESSAGE_NONE
            self.warning(self._read_message())

    @abstractmethod
    def warning(self, text: str) -> None:
        """Send a warning to the host."""

    def _handle_event_and_step(self) -> bool:
        core = self._core
        core.message_status = MESSAGE_NONE
        if core.pending:
            core.pending, core.watching = 0, 0
            self._derived = object()
            again = self.event(self._get_time(), core.step)
            core.pending = core.pending or bool(again)
        if self._plain_step is None:
            self._plain_step = self._make_plain_step()
        return self._plain_step()

    def _prepare(self) -> None:
        """Make the plain step of models with ``any_step``: their first one needs no Python, either."""
        if self.any_step and self._plain_step is None:
            self._plain_step = self._make_plain_step()

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
        slack = _compute_time_slack(t, h)
        if not abs(t - self._core.time) <= slack:
            raise Refused(f"current time {t!r} s: expected {self._core.time!r} s, where the last step ended")
        if not t < t + h < inf:
            raise Refused(f"step size {h!r} s: expected one that leads from {t!r} s to a later time")
        if t > self._core.stop - h + slack:
            stop = self._core.stop
            raise Refused(f"a step from {t!r} s to {t + h!r} s ends beyond the stop time {stop!r} s")

    def _is_on_grid(self, t: float) -> bool:
        return abs(self._get_time() - t) <= _compute_time_slack(t, self._core.step)

    def _restart_count(self, t: float, h: float) -> None:
        known = [found.step for found in self._maps if abs(found.step - h) <= SAME_STEP * found.step]
        self._core.origin = t
        self._core.count, self._core.step = 0, known[0] if known and not self.any_step else h
        self._renew()

    def _make_plain_step(self) -> Step:
        core = self._core
        step_map = self._find_map(self.default_step if self.any_step else core.step)
        core.use_maps(*step_map.maps)
        if core.elements is not step_map.elements:
            core.use_elements(step_map.elements)
        core.use_limits(self._compute_limits())
        return core.make_step()

    def _find_map(self, h: float) -> StepMap:
        for found in self._maps:
            if found.step == h:
                return found
        before, matrices = self.before_map(h), self.continuous()
        if matrices is None:
            maps = self._make_maps(h)
        else:
            maps, held = self._make_continuous_maps(matrices)
            before = [*before, *held]
        elements = self._compile_elements(before, self.after_map(h))
        if len(self._maps) >= _MOST_MAPS:
            del self._maps[0]
        self._maps.append(StepMap(h, maps, elements))
        return self._maps[-1]

    def _make_maps(self, h: float) -> tuple[Map, ...]:
        matrix = self.step_map(h)
        return () if matrix is None else (self._make_map("step_map", matrix, self._target),)

    def _make_continuous_maps(self, matrices: Matrices) -> tuple[tuple[Map, ...], list[Element]]:
        """The maps of states and outputs, and the element that renews the first for another size of steps."""
        A, B, C, D = (np.asarray(matrix, dtype=np.float64) for matrix in matrices)
        n, m = self.n_states, self._source.size - self.n_states
        shapes = (n, n), (n, m), (self.y.size, n), (self.y.size, m)
        for name, matrix, shape in zip("ABCD", (A, B, C, D), shapes, strict=True):
            if matrix.shape != shape:
                raise ValueError(f"{type(self).__name__}.continuous: {name} has shape {matrix.shape}; expected {shape}")
        outputs = self._make_map("continuous (C, D)", np.hstack([C, D]), self.y)
        if not n:
            return (outputs,), []
        states = self._make_map("continuous (A, B)", np.hstack([A, B]), self.x)
        return (states, outputs), [hold_inputs(A, B, self._source, self.x)]

    def _make_map(self, what: str, matrix: Array, target: Array) -> Map:
        by_columns = store_by_columns(self._check_matrix(what, matrix, target.size))
        taken = slice(None)
        if not (by_columns.size and by_columns[0].any() and by_columns[-1].any()):
            used = np.flatnonzero(by_columns.any(axis=1))
            taken = slice(int(used[0]), int(used[-1]) + 1) if used.size else slice(0, 0)
        return Map.make(make_blocks(by_columns[taken]), self._source[taken], target)

    def _compile_elements(self, before: Sequence[Element], after: Sequence[Element]) -> Elements:
        lists, elements = self._compiled
        if not (lists and lists[0] is before and lists[1] is after):
            elements = compile_elements(self.layout, self._buffer.data, before, after)
            self._compiled = ((before, after), elements)
        return elements

    def _check_matrix(self, what: str, matrix: Array, rows: int) -> Array:
        """The matrix as numbers."""
        shape = (rows, self._source.size)
        given = np.asarray(matrix, dtype=np.float64)
        if given.ndim != 2 or len(given) != rows or given.shape[1] > shape[1]:
            raise ValueError(f"{type(self).__name__}.{what} is of shape {given.shape}; expected {shape}")
        if not np.isfinite(given).all():
            raise ModelError(f"{type(self).__name__}.{what} contains numbers that are not finite")
        return given

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
        self._renew()
        self._compiled = ((), Elements())
        kept = self._buffer.data.copy()
        try:
            self.restore()
        finally:
            self._buffer.data[:] = kept

    # --- State --------------------------------------------------------------------------

    def _find_derived(self, state: SlaveState) -> Derived | None:
        """What was derived when this instance gave the state, if it still holds; None: it has to be rebuilt.

        Between events the model changes the buffer alone.
        """
        stepping = self._phase == state.clock.phase == LifePhase.STEPPING
        found = state.derived
        return found if stepping and found and found.model is self._derived else None

    def _has_steps_of(self, clock: SlaveClock) -> bool:
        """Whether the present steps are those of an earlier clock."""
        core = self._core
        here = core.step, self._core.origin, self._start, self._core.stop
        there = clock.step, clock.origin, clock.start, clock.stop
        return here == there

    def _go_back(self, clock: SlaveClock) -> None:
        """To an earlier clock of the same steps, for which all is derived."""
        core = self._core
        core.pending, core.count, core.time = clock.pending, clock.count, clock.time

    def _read_clock(self) -> SlaveClock:
        core = self._core
        return SlaveClock(
            phase=self._phase, ready=self._ready, stale=self._stale, pending=core.pending == 1,
            count=core.count,
            start=self._start, stop=self._core.stop, time=core.time, origin=self._core.origin, step=core.step,
        )  # fmt: skip

    def _recall(self, clock: SlaveClock) -> None:
        """Go back to an earlier clock."""
        core = self._core
        self._ready, self._stale, core.pending = clock.ready, clock.stale, clock.pending
        self._start, self._core.stop, self._core.origin = clock.start, clock.stop, clock.origin
        core.count, core.time, core.step = clock.count, clock.time, clock.step
        self._renew()
        self._enter(clock.phase)


def _compute_time_slack(t: float, h: float) -> float:
    """How far apart two statements of one time may be, s."""
    return max(SAME_TIME * h, _ROUNDING * ulp(t))
